"""Calibration of a robot: data collection, fit, report, and zeroing of gimbals."""
