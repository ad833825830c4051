"""Messages about cameras, and the request for a picture on a socket for pictures."""

from __future__ import annotations

import msgspec

from tsd_twin.dashboard.wire.to_page import Message


class CamerasChanged(Message, frozen=True, tag="cameras_changed"):
    """A camera has come or gone; fetch the list again."""


class CameraEntry(msgspec.Struct, frozen=True):
    """Camera that a page may show."""

    key: str
    name: str
    robot: str | None
    """Id of the robot that carries it; None above the floor."""


class PictureRequest(msgspec.Struct, frozen=True):
    """Request for the next picture; acknowledges the previous one."""

    width: int
    """Width of the pane, in pixels of the screen."""
    rtt_ms: float
    """Least recent round trip between page and dashboard."""
    held_ms: float
    """Time from the arrival of the previous picture to this request."""
    h264: bool = False
    """Whether the page can show H.264."""
