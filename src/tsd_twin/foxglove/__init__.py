"""Foxglove: live WebSocket with all topics of the robots on the bus, `cmd_vel`, and recordings."""

from tsd_twin.foxglove.front import FOXGLOVE_ORIGIN, Access
from tsd_twin.foxglove.sdk import load_sdk
from tsd_twin.foxglove.sources import serve_live, serve_recording

__all__ = ["FOXGLOVE_ORIGIN", "Access", "load_sdk", "serve_live", "serve_recording"]
