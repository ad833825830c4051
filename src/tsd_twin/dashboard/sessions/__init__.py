"""Sessions of pages: what a page shows of one robot, by its kind."""
