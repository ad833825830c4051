"""Handshake with the controller board: wait for it, check it, disarm it, and write its set-up."""

from __future__ import annotations

import time

from tsd_twin.dynamixel import protocol2
from tsd_twin.dynamixel.blocks import Command, Identity, Setup, Telemetry
from tsd_twin.dynamixel.control_table import BOARD_ID, MODEL, TABLE_VERSION, BoardMode
from tsd_twin.dynamixel.packets import ALERT, Fault, Status
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport

REST_COMMAND = Command()
"""Disarmed, zero throttle, neutral."""
READ_DELAY = protocol2.read(BOARD_ID, Telemetry.ADDRESS, Telemetry.LAYOUT.size)
SETTLE_S = 0.03
"""Silence after which no response to an older request can follow."""
_BOOT_S = 4.0
"""To open its port resets the board, whose boot loader then waits about a second for uploads."""
_RUN_DOWN_S = 3.0
"""The board refuses to be set up for 2 s after the last throttle."""
_AGAIN_S = 0.1
_TRY_S = 0.3
_TRIES = 3


def handshake(transport: SerialTransport, setup: Setup, baud: int) -> Telemetry:
    """Disarm and configure a board; return its telemetry.

    Raises:
        HardwareError: it is missing, another device, or refuses.
    """
    find_board(transport, baud)
    telemetry = Telemetry.unpack(request_data(transport, READ_DELAY, Telemetry.LAYOUT.size))
    size = Setup.LAYOUT.size
    has = request_data(transport, protocol2.read(BOARD_ID, Setup.ADDRESS, size), size)
    # A board without a written set-up does not arm, though it has these values by default.
    if not telemetry.setup_known or has != setup.pack():
        if telemetry.mode == BoardMode.RC:
            raise HardwareError(
                f"the controller board at {transport.name} cannot be set up while the radio "
                "control has the robot: switch manual off"
            )
        _write_setup(transport, setup)
    return telemetry


def find_board(transport: SerialTransport, baud: int) -> None:
    """Wait for a board, check what it is, and disarm it.

    Raises:
        HardwareError: it is missing, or another device.
    """
    _wait_for_answer(transport, baud)
    size = Identity.LAYOUT.size
    read = protocol2.read(BOARD_ID, Identity.ADDRESS, size)
    identity = Identity.unpack(request_data(transport, read, size))
    if identity.model != MODEL or identity.table_version != TABLE_VERSION:
        raise HardwareError(
            f"the device at {transport.name} is model {identity.model} with control table "
            f"{identity.table_version}: this program needs model {MODEL} with table "
            f"{TABLE_VERSION}; flash the firmware that comes with it"
        )
    # A board that was not reset may still be armed, which would refuse the set-up.
    request_data(transport, protocol2.write(BOARD_ID, Command.ADDRESS, REST_COMMAND.pack()))


def _write_setup(transport: SerialTransport, setup: Setup) -> None:
    """Write the set-up; the board takes it once its wheels have run down.

    Raises:
        HardwareError: it refuses, or does not answer.
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
    """Return the `size` bytes of the response."""
    answer = _request(transport, request, size)
    if error := answer.error & ~ALERT:
        raise HardwareError(
            f"the controller board at {transport.name} refuses its set-up: error {error}"
        )
    return answer.data


def _request(transport: SerialTransport, request: bytes, size: int = 0) -> Status:
    """Return the response with `size` bytes, or an error; the request is repeated."""
    for _ in range(_TRIES):
        for answer in transport.request(request, 1, _TRY_S):
            # Otherwise the response belongs to an older request.
            if answer.error & ~ALERT or len(answer.data) == size:
                return answer
    raise HardwareError(f"the controller board at {transport.name} does not answer as it should")
