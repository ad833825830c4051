"""Modes of a robot with their transitions, and the heartbeat for the hardware watchdog."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Mode(StrEnum):
    """Modes of a robot; it moves in `driving`, and brakes in `stopping`."""

    DISARMED = "disarmed"
    """Gimbals neutral, wheels at rest."""
    ARMING = "arming"
    """Neutral tilt is checked, speed controllers get zero throttle, wheels spin up."""
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
"""All allowed transitions between modes, each with its condition."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Heartbeat that accompanies each set-point, for hardware with its own command watchdog."""

    armed: bool
    """The wheels may spin."""
    counter: int
    """Heartbeat counter; the board trips when it stops incrementing.

    While the robot moves, only counted commands increment it, and once the start of a controlled
    stop. While the robot is at rest with spinning wheels, every step increments it; the state
    machine ends that mode after 10 s without an operator.
    """
