"""Dynamixel packets and the control table of the controller board; no I/O."""
