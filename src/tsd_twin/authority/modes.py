"""The modes of a robot and the ways between them."""

from __future__ import annotations

from enum import StrEnum


class Mode(StrEnum):
    """What a robot is doing; only `driving` moves it."""

    DISARMED = "disarmed"
    """Gimbals neutral, wheels at rest."""
    ARMING = "arming"
    """Neutral tilt is checked, speed controllers see zero throttle, wheels spin up."""
    READY = "ready"
    """Wheels spin, tilt is neutral, commands are obeyed."""
    DRIVING = "driving"
    """A counted command is obeyed."""
    STOPPING = "stopping"
    """Controlled stop at the deceleration limit."""
    STOPPED = "stopped"
    """Software stop, latched: neutral tilt at servo speed, zero throttle."""
    FAULT = "fault"
    """As stopped, latched, because something is broken."""


ARMED = frozenset({Mode.ARMING, Mode.READY, Mode.DRIVING, Mode.STOPPING})
"""Modes in which the wheels may spin."""
LATCHED = frozenset({Mode.STOPPED, Mode.FAULT})
"""Modes that only a reset ends."""

TRANSITIONS: dict[tuple[Mode, Mode], str] = {
    (Mode.DISARMED, Mode.ARMING): "arm",
    (Mode.ARMING, Mode.READY): "wheels at speed",
    (Mode.ARMING, Mode.DISARMED): "disarm, no operator, or not neutral",
    (Mode.READY, Mode.DRIVING): "counted non-zero command",
    (Mode.READY, Mode.DISARMED): "disarm, or no operator for 10 s",
    (Mode.DRIVING, Mode.READY): "counted zero command, and at rest",
    (Mode.DRIVING, Mode.STOPPING): "no counted command in time, control lost, or disarm",
    (Mode.STOPPING, Mode.DRIVING): "counted command",
    (Mode.STOPPING, Mode.READY): "at rest",
    (Mode.STOPPING, Mode.DISARMED): "at rest, after disarm",
    (Mode.STOPPED, Mode.DISARMED): "reset",
    (Mode.FAULT, Mode.DISARMED): "reset",
    **{(mode, Mode.STOPPED): "stop" for mode in Mode if mode not in LATCHED},
    **{(mode, Mode.FAULT): "fault" for mode in ARMED},
}
"""Every way there is from one mode to another, with what takes it; there is no other."""
