"""Modes of a robot."""

from __future__ import annotations

from enum import StrEnum


class Mode(StrEnum):
    """Robot modes; the robot moves in `driving` and brakes in `stopping`."""

    DISARMED = "disarmed"
    """Gimbals neutral, wheels at rest."""
    ARMING = "arming"
    """Neutral tilt is checked, speed controllers receive zero throttle, wheels spin up."""
    READY = "ready"
    """Wheels spin, tilt is neutral, commands are accepted."""
    DRIVING = "driving"
    """Following an accepted command."""
    STOPPING = "stopping"
    """Controlled stop at the deceleration limit."""
    STOPPED = "stopped"
    """Software stop, latched: neutral tilt at servo speed, zero throttle."""
    FAULT = "fault"
    """Like stopped and latched, because of a fault."""


ARMED = frozenset({Mode.ARMING, Mode.READY, Mode.DRIVING, Mode.STOPPING})
"""Modes in which the wheels may spin."""
LATCHED = frozenset({Mode.STOPPED, Mode.FAULT})
"""Modes left only by a reset."""
