"""Arming of the controller board: the `arm` register, and what telemetry says of trips, refusals,
restarts and wiring.
"""

from __future__ import annotations

from enum import Enum, auto

from tsd_twin.dynamixel.blocks import Telemetry
from tsd_twin.dynamixel.control_table import BoardMode, Refusal, ResetCause, Trip

ANSWERS = 3
"""Cycles within which the board arms or gives its reason for refusing."""

TRIPS: dict[int, str] = {
    Trip.NONE: "it does not say why",
    Trip.HEARTBEAT: "no word of an operator came in time",
    Trip.KILL: "the kill switch of the radio control is on",
    Trip.RC_LOST: "the radio control is lost",
    Trip.RC_TOOK_OVER: "the radio control took over",
    Trip.SERVO: "a servo does not answer or has an error",
    Trip.WATCHDOG: "its firmware hung and was restarted",
    Trip.BATTERY: "the battery is empty",
    Trip.DRIVE: "the stop circuit opened: the speed controllers lost their power",
}
REFUSALS: dict[int, str] = {
    Refusal.NONE: "it does not say why",
    Refusal.ESC_HOLD: "zero throttle must be held for 2 s first",
    Refusal.THROTTLE: "the throttles are not zero",
    Refusal.GOAL: "the goals of the gimbals are not neutral",
    Refusal.SERVO: "a servo does not answer or has an error",
    Refusal.NOT_NEUTRAL: "the gimbals are not at neutral tilt",
    Refusal.RECEIVER: "the radio control is off, or a wire of its receiver",
    Refusal.KILL: "the kill switch of the radio control is on",
    Refusal.RC: "the radio control has the robot",
    Refusal.SETUP: "its set-up was not written: neutral positions are unknown",
    Refusal.BATTERY: "the battery is too low",
    Refusal.DRIVE: "the speed controllers have no power: the stop circuit is open",
}


_STARTED_MS = 4000
"""A board that has run for less was reset when its port was opened, or just got power."""
_MEASURED_MS = 500
"""After this, the board has measured its battery."""
_BATTERY_LEAST_MV = 5000
"""A board that runs although its battery is below this is fed by something else."""
_RESTARTED = "the controller board has restarted"
RESETS: dict[int, str] = {
    ResetCause.POWER_ON: "it had lost its power",
    ResetCause.EXTERNAL: "by its reset pin",
    ResetCause.BROWN_OUT: "its supply had sagged",
    ResetCause.WATCHDOG: "its firmware hung",
}


def restart_reason(cause: int) -> str:
    """Text for a board that has restarted; a boot loader may have cleared the cause."""
    causes = [text for bit, text in RESETS.items() if cause & bit]
    return ": ".join([_RESTARTED, *causes[:1]])


def wiring_faults(telemetry: Telemetry, *, opened: bool, returned: bool) -> dict[str, str]:
    """Mistakes in the wiring of a board that telemetry shows, by a short name; empty without one.

    `opened` says that its port was just opened, `returned` that it was connected before.
    """
    found: dict[str, str] = {}
    young, powered = telemetry.millis < _STARTED_MS, telemetry.reset_cause & ResetCause.POWER_ON
    # A boot loader may have cleared the cause.
    if opened and young and not telemetry.reset_cause & ~ResetCause.EXTERNAL:
        found["auto-reset"] = (
            "opening the port resets the controller board, whose outputs are not driven until its "
            "boot loader ends: cut RESET-EN, or use an adapter without DTR"
        )
    if opened and young and powered and returned:
        found["usb power lost"] = (
            "the controller board lost its power together with the line: unless the battery was "
            "off too, USB feeds it, and no board was there to stop the robot; feed it from the "
            "servo battery, and cut the 5 V of USB"
        )
    if telemetry.millis > _MEASURED_MS and telemetry.battery_mv < _BATTERY_LEAST_MV:
        found["usb power"] = (
            f"the controller board runs with {telemetry.battery_mv / 1000.0:.1f} V of battery: "
            "USB feeds it; cut the 5 V of USB, or the wire to A0 is off"
        )
    return found


class _State(Enum):
    OFF = auto()
    ASKED = auto()
    ON = auto()
    LOST = auto()


class ArmSwitch:
    """Value of the board's `arm` register, and why the board is off while the robot is armed.

    A board that disarms itself, restarts or is lost stays off until the robot has been disarmed.
    """

    def __init__(self) -> None:
        self._state = _State.OFF
        self._answers = 0
        self.lost = ""
        """Reason why it is off although it should be on; else empty."""

    def turn(self, wanted: bool) -> int:
        """Value to write for a robot that is armed or disarmed."""
        if not wanted:
            self._state, self.lost = _State.OFF, ""
        elif self._state is _State.OFF:
            self._state, self._answers = _State.ASKED, 0
        return int(self._state in (_State.ASKED, _State.ON))

    def update(self, telemetry: Telemetry) -> None:
        """Update with the telemetry of the board."""
        armed = telemetry.mode == BoardMode.ARMED
        if self._state is _State.ASKED:
            self._answers += 1
            if armed:
                self._state = _State.ON
            elif self._answers >= ANSWERS:
                why = REFUSALS.get(telemetry.refusal, f"refusal {telemetry.refusal}")
                self.mark_lost(f"the board does not arm: {why}")
        elif self._state is _State.ON and not armed:
            why = TRIPS.get(telemetry.trip, f"trip {telemetry.trip}")
            self.mark_lost(f"the board disarmed itself: {why}")

    def mark_lost(self, reason: str) -> None:
        """Record that the board has lost its armed state; does nothing while it is off."""
        if self._state in (_State.ASKED, _State.ON):
            self._state, self.lost = _State.LOST, reason
