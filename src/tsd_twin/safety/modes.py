"""Modes of a robot with their transitions, and the heartbeat that the hardware watchdog is fed
with.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """What a controller board with a timeout of its own is told beside each set-point."""

    armed: bool
    """The wheels may spin."""
    counter: int
    """Rises as long as an operator stands behind the set-points; what stays the same feeds nobody.

    While the robot moves, only counted commands make it rise, and once the beginning of a
    controlled stop. While it is at rest with spinning wheels, every step does: that somebody has
    control, or had it 10 s ago, is watched by the modes.
    """
