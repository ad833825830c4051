"""Foxglove: live WebSocket with all topics of the robots on the bus, `cmd_vel`, and recordings."""
