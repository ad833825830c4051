"""Foxglove: live WebSocket with all topics of the robots on the bus, `cmd_vel`, and recordings."""

from tsd_twin.adapters.foxglove.gateway import FOXGLOVE_ORIGIN, Access
from tsd_twin.adapters.foxglove.sdk import load_sdk
from tsd_twin.adapters.foxglove.sources import serve_live, serve_recording

__all__ = ["FOXGLOVE_ORIGIN", "Access", "load_sdk", "serve_live", "serve_recording"]
