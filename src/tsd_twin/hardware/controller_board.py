"""Controller board: handshake, setup, arming, and messages for trips, refusals and restarts."""

from __future__ import annotations

import time
from enum import Enum, auto
from typing import TypeVar

from tsd_twin.hardware.dynamixel.control_table import (
    BOARD_ID,
    MODEL,
    TABLE_VERSION,
    Block,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Refusal,
    ResetCause,
    Setup,
    Telemetry,
    Trip,
    WheelSensor,
)
from tsd_twin.hardware.dynamixel.packets import (
    ACCESS_ERROR,
    ALERT,
    RANGE_ERROR,
    StatusPacket,
    protocol2,
)
from tsd_twin.hardware.dynamixel.servo_models import MODELS
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport
from tsd_twin.messages.codes import Code, Reason, because

BlockT = TypeVar("BlockT", bound=Block)
REST_COMMAND = BoardCommand()
"""Disarmed, zero throttle, neutral gimbals."""
SETTLE_S = 0.03
"""After this silence, no response to an earlier request can arrive."""
_BOOT_S = 4.0
"""Opening the port resets the board, and its boot loader then waits about 1 s for uploads."""
_RUN_DOWN_S = 3.0
"""Timeout for the setup, which the board refuses for 2 s after the last throttle."""
_AGAIN_S = 0.1
_ZERO_MOVES = "it takes another zero throttle only while the speed controllers have no power"
_NO_TELEMETRY = (
    "the controller board at {} refuses telemetry of the speed controllers: a Mega has one free "
    "serial input for three wires; use a board with an RP2040, or wheel_sensor.kind = 'hall'"
)
_TRY_S = 0.3
_TRIES = 3


def handshake(transport: SerialTransport, setup: Setup, baud: int) -> Telemetry:
    """Disarm and configure a board; return its telemetry.

    Raises:
        HardwareError: If the board is missing, another device, or refuses.
    """
    find_board(transport, baud)
    telemetry, has = read_block(transport, Telemetry), read_block(transport, Setup)
    # Without a written setup, a board does not arm, even if its defaults match.
    if not telemetry.setup_known or has.pack() != setup.pack():
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
    identity = read_block(transport, BoardIdentity)
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
    _request_data(transport, write_request(REST_COMMAND))


def _write_setup(transport: SerialTransport, setup: Setup) -> None:
    """Write the setup, retrying until the wheels have run down.

    Raises:
        HardwareError: If the board refuses or does not respond.
    """
    end_s = time.monotonic() + _RUN_DOWN_S
    while True:
        error = _request(transport, write_request(setup)).error & ~ALERT
        if not error:
            return
        if error == RANGE_ERROR and setup.wheel_sensor == WheelSensor.TELEMETRY:
            raise HardwareError(_NO_TELEMETRY.format(transport.name))
        if error != ACCESS_ERROR or time.monotonic() > end_s:
            raise HardwareError(
                f"the controller board at {transport.name} refuses its set-up: error {error}"
                + ("; open the contactor: " + _ZERO_MOVES if error == ACCESS_ERROR else "")
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


def read_request(block: type[Block]) -> bytes:
    """Return the packet that reads a block of the board."""
    return protocol2.read(BOARD_ID, block.ADDRESS, block.LAYOUT.size)


def write_request(block: Block) -> bytes:
    """Return the packet that writes a block of the board."""
    return protocol2.write(BOARD_ID, block.ADDRESS, block.pack())


def read_block(transport: SerialTransport, block: type[BlockT]) -> BlockT:
    """Read a block of the board.

    Raises:
        HardwareError: If the board refuses or does not respond.
    """
    return block.unpack(_request_data(transport, read_request(block), block.LAYOUT.size))


def _request_data(transport: SerialTransport, request: bytes, size: int = 0) -> bytes:
    answer = _request(transport, request, size)
    if error := answer.error & ~ALERT:
        raise HardwareError(
            f"the controller board at {transport.name} refuses its set-up: error {error}"
        )
    return answer.data


def _request(transport: SerialTransport, request: bytes, size: int = 0) -> StatusPacket:
    """Send a request with retries; return the response with `size` bytes, or an error."""
    for _ in range(_TRIES):
        for answer in transport.request(request, 1, _TRY_S):
            # Skip responses to an earlier request.
            if answer.error & ~ALERT or len(answer.data) == size:
                return answer
    raise HardwareError(f"the controller board at {transport.name} does not answer as it should")


ANSWERS = 3
"""Maximum cycles until the board arms or reports its refusal."""


def trip_word(trip: int) -> str:
    """Word for a trip of the board, as parameter of a reason."""
    return Trip(trip).name.lower() if trip in _TRIPS else f"trip {trip}"


def obstacle_word(refusal: int) -> str:
    """Word for a refusal of the board to arm, as parameter of a reason."""
    return Refusal(refusal).name.lower() if refusal in _REFUSALS else f"refusal {refusal}"


_TRIPS, _REFUSALS = frozenset(Trip), frozenset(Refusal)


_STARTED_MS = 4000
"""A board with a shorter uptime was reset when its port was opened, or just powered on."""
_MEASURED_MS = 500
"""After this uptime, the board has measured its battery."""
_BATTERY_LEAST_MV = 5000
"""If the battery voltage is lower, something else powers the board."""
_RESETS = {
    ResetCause.POWER_ON: "power_on",
    ResetCause.EXTERNAL: "external",
    ResetCause.BROWN_OUT: "brown_out",
    ResetCause.WATCHDOG: "watchdog",
}


def restart_reason(cause: int) -> Reason:
    """Return the reason for a restarted board; a boot loader may have cleared the cause."""
    words = [word for bit, word in _RESETS.items() if cause & bit]
    return because(Code.BOARD_RESTARTED, **({"reset": words[0]} if words else {}))


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


class _ArmState(Enum):
    OFF = auto()
    ASKED = auto()
    ON = auto()
    LOST = auto()


class ArmSwitch:
    """Value of the board's `arm` register, and the reason if it is off while the robot is armed.

    A board that disarms itself, restarts or is lost stays off until the robot is disarmed.
    """

    def __init__(self) -> None:
        self._state = _ArmState.OFF
        self._answers = 0
        self.lost: Reason | None = None
        """Reason why the board is off although it should be on, or None."""

    def turn(self, wanted: bool, *, stop: bool = False) -> int:
        """Return the value to write while the robot is armed, disarmed or stopped."""
        if stop:
            self._state, self.lost = _ArmState.OFF, None
            return STOP
        if not wanted:
            self._state, self.lost = _ArmState.OFF, None
        elif self._state is _ArmState.OFF:
            self._state, self._answers = _ArmState.ASKED, 0
        return int(self._state in (_ArmState.ASKED, _ArmState.ON))

    def update(self, telemetry: Telemetry) -> None:
        """Update with the board's telemetry."""
        armed = telemetry.mode == BoardMode.ARMED
        if self._state is _ArmState.ASKED:
            self._answers += 1
            if armed:
                self._state = _ArmState.ON
            elif self._answers >= ANSWERS:
                what = obstacle_word(telemetry.refusal)
                self.mark_lost(because(Code.BOARD_REFUSES, what=what))
        elif self._state is _ArmState.ON and not armed:
            self.mark_lost(because(Code.BOARD_TRIP, trip=trip_word(telemetry.trip)))

    def mark_lost(self, why: Reason) -> None:
        """Record that the board is no longer armed; no effect if it is off."""
        if self._state in (_ArmState.ASKED, _ArmState.ON):
            self._state, self.lost = _ArmState.LOST, why
