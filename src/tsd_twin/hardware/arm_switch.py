"""Arming the board: once for each time that the robot is armed, never again by itself."""

from __future__ import annotations

from enum import Enum, auto

from tsd_twin.wire.blocks import Telemetry
from tsd_twin.wire.codes import BoardMode, Refusal, Trip

ANSWERS = 3
"""A board that is asked to arm has done it, or said why not, after so many cycles."""

TRIPS: dict[int, str] = {
    Trip.NONE: "it does not say why",
    Trip.HEARTBEAT: "no word of an operator came in time",
    Trip.KILL: "the kill switch of the radio control is on",
    Trip.RC_LOST: "the radio control is lost",
    Trip.RC_TOOK_OVER: "the radio control took over",
    Trip.SERVO: "a servo does not answer or has an error",
    Trip.WATCHDOG: "its firmware hung and was restarted",
}
REFUSALS: dict[int, str] = {
    Refusal.NONE: "it does not say why",
    Refusal.ESC_HOLD: "zero throttle must be held for 2 s first",
    Refusal.THROTTLE: "the throttles are not zero",
    Refusal.GOAL: "the goals of the gimbals are not neutral",
    Refusal.SERVO: "a servo does not answer or has an error",
    Refusal.NOT_NEUTRAL: "the gimbals are not at neutral tilt",
    Refusal.KILL: "the kill switch of the radio control is on",
    Refusal.RC: "the radio control has the robot",
    Refusal.SETUP: "it was never told where neutral is",
}


class _State(Enum):
    OFF = auto()
    ASKED = auto()
    ON = auto()
    LOST = auto()


class ArmSwitch:
    """What to write into `arm`, and why the board is not armed although the robot is.

    A board that disarms itself, restarts or is lost stays off until the robot has been disarmed.
    """

    def __init__(self) -> None:
        self._state = _State.OFF
        self._answers = 0
        self.lost = ""
        """Why it is off although it should be on; else empty."""

    def turn(self, wanted: bool) -> int:
        """Return what to write, for a robot that is armed or is not."""
        if not wanted:
            self._state, self.lost = _State.OFF, ""
        elif self._state is _State.OFF:
            self._state, self._answers = _State.ASKED, 0
        return int(self._state in (_State.ASKED, _State.ON))

    def note(self, telemetry: Telemetry) -> None:
        """Take in what the board says."""
        armed = telemetry.mode == BoardMode.ARMED
        if self._state is _State.ASKED:
            self._answers += 1
            if armed:
                self._state = _State.ON
            elif self._answers >= ANSWERS:
                why = REFUSALS.get(telemetry.refusal, f"refusal {telemetry.refusal}")
                self.lose(f"the board does not arm: {why}")
        elif self._state is _State.ON and not armed:
            why = TRIPS.get(telemetry.trip, f"trip {telemetry.trip}")
            self.lose(f"the board disarmed itself: {why}")

    def lose(self, reason: str) -> None:
        """The board is off, whatever it was told; nothing to lose while it is off."""
        if self._state in (_State.ASKED, _State.ON):
            self._state, self.lost = _State.LOST, reason
