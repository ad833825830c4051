"""Dynamixel protocols 1.0 and 2.0 and the control table of the controller board; no I/O."""
