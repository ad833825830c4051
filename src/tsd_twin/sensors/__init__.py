"""Sensors: a module has the table of one, and its simulation."""
