"""Frames on CAN, and the interface of a kind of motor controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Frame:
    """CAN frame."""

    id: int
    data: bytes
    extended: bool = True
    fd: bool = False


@dataclass(slots=True)
class MotorState:
    """Latest measurements of a motor controller; NaN until measured."""

    heard_s: float = float("-inf")
    """When its speed was last measured."""
    speed_rad_per_s: float = float("nan")
    current_a: float = float("nan")
    voltage_v: float = float("nan")
    temperature_c: float = float("nan")
    fault: str = ""
    """Fault that it reports, or ""."""
    timed_out: bool = False
    """Whether its dead-man has stopped it."""
    timeout_s: float = float("nan")
    """Time without a command after which it stops, as read from it."""


class Motors(Protocol):
    """Motor controllers of one kind; speeds are of the wheels, rad/s."""

    states: list[MotorState]

    def questions(self) -> Sequence[Frame]:
        """Return the frames that request the settings checked before the first arming."""
        ...

    def problem(self, i: int) -> str:
        """Return why motor `i` must not be armed, or ""; asked after `questions`."""
        ...

    def drive(self, speeds: Sequence[float]) -> Sequence[Frame]:
        """Return the frames that turn the wheels."""
        ...

    def stop(self, *, armed: bool) -> Sequence[Frame]:
        """Return the frames that turn the motors off; only if disarmed they clear a time-out."""
        ...

    def receive(self, frame: Frame, now_s: float) -> None:
        """Update the states."""
        ...
