"""Common parts of the programs: flags, signals, errors of one sentence, experiments."""
