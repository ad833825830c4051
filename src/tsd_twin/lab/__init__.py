"""Experiments of the papers in virtual time; each writes a figure and a table."""
