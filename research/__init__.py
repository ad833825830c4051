"""Studies that are not of the papers; they are not in the wheel."""
