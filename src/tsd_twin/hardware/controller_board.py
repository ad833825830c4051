"""Controller board: handshake, setup, arming, and messages for trips, refusals and restarts."""

from __future__ import annotations

import time
from enum import Enum, auto

from tsd_twin.dynamixel.blocks import Command, Identity, Setup, Telemetry
from tsd_twin.dynamixel.control_table import (
    BOARD_ID,
    MODEL,
    TABLE_VERSION,
    BoardMode,
    Refusal,
    ResetCause,
    Trip,
)
from tsd_twin.dynamixel.packets import ALERT, Fault, Status, protocol2
from tsd_twin.dynamixel.servo_models import MODELS
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport

REST_COMMAND = Command()
"""Disarmed, zero throttle, neutral gimbals."""
READ_DELAY = protocol2.read(BOARD_ID, Telemetry.ADDRESS, Telemetry.LAYOUT.size)
SETTLE_S = 0.03
"""After this silence, no response to an earlier request can arrive."""
_BOOT_S = 4.0
"""Opening the port resets the board, and its boot loader then waits about 1 s for uploads."""
_RUN_DOWN_S = 3.0
"""Timeout for the setup, which the board refuses for 2 s after the last throttle."""
_AGAIN_S = 0.1
_ZERO_MOVES = "it takes another zero throttle only while the speed controllers have no power"
_TRY_S = 0.3
_TRIES = 3


def handshake(transport: SerialTransport, setup: Setup, baud: int) -> Telemetry:
    """Disarm and configure a board; return its telemetry.

    Raises:
        HardwareError: If the board is missing, another device, or refuses.
    """
    find_board(transport, baud)
    telemetry = Telemetry.unpack(request_data(transport, READ_DELAY, Telemetry.LAYOUT.size))
    size = Setup.LAYOUT.size
    has = request_data(transport, protocol2.read(BOARD_ID, Setup.ADDRESS, size), size)
    # Without a written setup, a board does not arm, even if its defaults match.
    if not telemetry.setup_known or has != setup.pack():
        if telemetry.mode == BoardMode.RC:
            raise HardwareError(
                f"the controller board at {transport.name} cannot be set up while the radio "
                "control has the robot: switch manual off"
            )
        _write_setup(transport, setup)
    return telemetry


def find_board(transport: SerialTransport, baud: int) -> None:
    """Wait for a board, check its model, and disarm it.

    Raises:
        HardwareError: If the board is missing or another device.
    """
    _wait_for_answer(transport, baud)
    size = Identity.LAYOUT.size
    read = protocol2.read(BOARD_ID, Identity.ADDRESS, size)
    identity = Identity.unpack(request_data(transport, read, size))
    if identity.model in MODELS:
        raise HardwareError(
            f"the device at {transport.name} is a servo, {MODELS[identity.model].name}, with the "
            f"id {BOARD_ID} of the controller board: give it another, and choose the board's port"
        )
    if identity.model != MODEL or identity.table_version != TABLE_VERSION:
        raise HardwareError(
            f"the device at {transport.name} is model {identity.model} with control table "
            f"{identity.table_version}: this program needs model {MODEL} with table "
            f"{TABLE_VERSION}; flash the firmware that comes with it"
        )
    # A board that was not reset may still be armed and would refuse the setup.
    request_data(transport, protocol2.write(BOARD_ID, Command.ADDRESS, REST_COMMAND.pack()))


def _write_setup(transport: SerialTransport, setup: Setup) -> None:
    """Write the setup, retrying until the wheels have run down.

    Raises:
        HardwareError: If the board refuses or does not respond.
    """
    request = protocol2.write(BOARD_ID, Setup.ADDRESS, setup.pack())
    end_s = time.monotonic() + _RUN_DOWN_S
    while True:
        error = _request(transport, request).error & ~ALERT
        if not error:
            return
        if error != Fault.ACCESS or time.monotonic() > end_s:
            raise HardwareError(
                f"the controller board at {transport.name} refuses its set-up: error {error}"
                + ("; open the contactor: " + _ZERO_MOVES if error == Fault.ACCESS else "")
            )
        time.sleep(_AGAIN_S)


def _wait_for_answer(transport: SerialTransport, baud: int) -> None:
    end_s = time.monotonic() + _BOOT_S
    while not any(answer.data for answer in transport.request(protocol2.ping(BOARD_ID), 1, _TRY_S)):
        if time.monotonic() > end_s:
            raise HardwareError(
                f"nothing at {transport.name} answers as a controller board at {baud} Bd: "
                "is its firmware flashed, and is it the right port?"
            )
    transport.drain(SETTLE_S)


def request_data(transport: SerialTransport, request: bytes, size: int = 0) -> bytes:
    """Send a request and return the `size` bytes of the response."""
    answer = _request(transport, request, size)
    if error := answer.error & ~ALERT:
        raise HardwareError(
            f"the controller board at {transport.name} refuses its set-up: error {error}"
        )
    return answer.data


def _request(transport: SerialTransport, request: bytes, size: int = 0) -> Status:
    """Send a request with retries; return the response with `size` bytes, or an error."""
    for _ in range(_TRIES):
        for answer in transport.request(request, 1, _TRY_S):
            # Skip responses to an earlier request.
            if answer.error & ~ALERT or len(answer.data) == size:
                return answer
    raise HardwareError(f"the controller board at {transport.name} does not answer as it should")


ANSWERS = 3
"""Maximum cycles until the board arms or reports its refusal."""

TRIPS: dict[int, str] = {
    Trip.NONE: "it does not say why",
    Trip.HEARTBEAT: "no word of an operator came in time",
    Trip.KILL: "the kill switch of the radio control is on",
    Trip.RC_LOST: "the radio control is lost",
    Trip.RC_TOOK_OVER: "the radio control took over",
    Trip.SERVO: "a servo does not answer or has an error",
    Trip.WATCHDOG: "its firmware hung and was restarted",
    Trip.BATTERY: "the battery is empty",
    Trip.TORQUE: "a servo lost its torque",
    Trip.HOT: "a servo is too hot: let it cool",
    Trip.LINE: "the line from the computer lost bytes, and kept the board from its servos",
    Trip.DRIVE: "the stop circuit opened: the speed controllers lost their power",
    Trip.FOLLOWING: "a gimbal does not follow its goal: it is stuck, or its servo is",
    Trip.STOPPED: "STOP",
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
    Refusal.SETTING: "a setting of a servo is not as it must be, or not read yet",
    Refusal.TORQUE: "a servo has no torque",
    Refusal.HOT: "a servo is too hot: let it cool",
    Refusal.DRIVE: "the speed controllers have no power: the stop circuit is open",
    Refusal.STOP_NOT_PROVEN: "the stop was not tested since power came: press and release it once",
    Refusal.RC_WITHOUT_SERVOS: "the radio control drives with all six servos at the board only",
    Refusal.NEUTRAL: "a servo is too far from its neutral position to get torque",
    Refusal.STOPPED: "the robot is stopped: reset first",
}


_STARTED_MS = 4000
"""A board with a shorter uptime was reset when its port was opened, or just powered on."""
_MEASURED_MS = 500
"""After this uptime, the board has measured its battery."""
_BATTERY_LEAST_MV = 5000
"""If the battery voltage is lower, something else powers the board."""
_RESTARTED = "the controller board has restarted"
RESETS: dict[int, str] = {
    ResetCause.POWER_ON: "it had lost its power",
    ResetCause.EXTERNAL: "by its reset pin",
    ResetCause.BROWN_OUT: "its supply had sagged",
    ResetCause.WATCHDOG: "its firmware hung",
}


def restart_reason(cause: int) -> str:
    """Return a message for a restarted board; a boot loader may have cleared the cause."""
    causes = [text for bit, text in RESETS.items() if cause & bit]
    return ": ".join([_RESTARTED, *causes[:1]])


def wiring_faults(telemetry: Telemetry, *, opened: bool, returned: bool) -> dict[str, str]:
    """Return wiring faults that telemetry reveals, by a short name.

    Args:
        telemetry: Latest telemetry.
        opened: Whether the port was just opened.
        returned: Whether the board was connected before.
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


STOP = 2
"""Value of `arm` that locks out all sources, including the radio control, until it is 0."""


class _State(Enum):
    OFF = auto()
    ASKED = auto()
    ON = auto()
    LOST = auto()


class ArmSwitch:
    """Value of the board's `arm` register, and the reason if it is off while the robot is armed.

    A board that disarms itself, restarts or is lost stays off until the robot is disarmed.
    """

    def __init__(self) -> None:
        self._state = _State.OFF
        self._answers = 0
        self.lost = ""
        """Reason why the board is off although it should be on, or ""."""

    def turn(self, wanted: bool, *, stop: bool = False) -> int:
        """Return the value to write while the robot is armed, disarmed or stopped."""
        if stop:
            self._state, self.lost = _State.OFF, ""
            return STOP
        if not wanted:
            self._state, self.lost = _State.OFF, ""
        elif self._state is _State.OFF:
            self._state, self._answers = _State.ASKED, 0
        return int(self._state in (_State.ASKED, _State.ON))

    def update(self, telemetry: Telemetry) -> None:
        """Update with the board's telemetry."""
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
        """Record that the board is no longer armed; no effect if it is off."""
        if self._state in (_State.ASKED, _State.ON):
            self._state, self.lost = _State.LOST, reason
