"""Pages that show a recording."""
