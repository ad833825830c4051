"""Common parts of the programs: flags, signals, one-line errors, experiments."""
