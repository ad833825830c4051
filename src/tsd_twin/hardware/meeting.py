"""The first words with a controller board: is it ours, and does it know how the robot is built."""

from __future__ import annotations

import time

from tsd_twin.hardware.errors import HardwareError
from tsd_twin.hardware.line import Line
from tsd_twin.wire import protocol2
from tsd_twin.wire.blocks import Command, Identity, Setup, Telemetry
from tsd_twin.wire.codes import BoardMode
from tsd_twin.wire.packet import ALERT, Fault
from tsd_twin.wire.table import BOARD_ID, MODEL, TABLE_VERSION

REST = Command()
"""Disarmed, zero throttle, neutral."""
READ = protocol2.read(BOARD_ID, Telemetry.ADDRESS, Telemetry.LAYOUT.size)
SETTLE_S = 0.03
"""Silence after which no answer to an older question comes any more."""
_BOOT_S = 4.0
"""To open its port resets the board, whose boot loader then waits about a second for uploads."""
_TRY_S = 0.3
_TRIES = 3


def meet(line: Line, setup: Setup, baud: int) -> Telemetry:
    """Disarm a board, set it up, and return what it says.

    Raises:
        HardwareError: it is not there, not ours, or refuses.
    """
    _wait_for_answer(line, baud)
    size = Identity.LAYOUT.size
    read = protocol2.read(BOARD_ID, Identity.ADDRESS, size)
    identity = Identity.unpack(_need(line, read, size))
    if identity.model != MODEL or identity.table_version != TABLE_VERSION:
        raise HardwareError(
            f"the device at {line.name} is model {identity.model} with control table "
            f"{identity.table_version}: this program needs model {MODEL} with table "
            f"{TABLE_VERSION}; flash the firmware that comes with it"
        )
    # A board that was not reset may still be armed, which would refuse the set-up.
    _need(line, protocol2.write(BOARD_ID, Command.ADDRESS, REST.pack()))
    said = Telemetry.unpack(_need(line, READ, Telemetry.LAYOUT.size))
    size = Setup.LAYOUT.size
    has = _need(line, protocol2.read(BOARD_ID, Setup.ADDRESS, size), size)
    # While the radio control drives it cannot be written. Else it is written though it be the
    # same: a board that was never told does not arm.
    if said.mode != BoardMode.RC or has != setup.pack():
        _need(line, protocol2.write(BOARD_ID, Setup.ADDRESS, setup.pack()))
    return said


def _wait_for_answer(line: Line, baud: int) -> None:
    end_s = time.monotonic() + _BOOT_S
    while not any(answer.data for answer in line.ask(protocol2.ping(BOARD_ID), 1, _TRY_S)):
        if time.monotonic() > end_s:
            raise HardwareError(
                f"nothing at {line.name} answers as a controller board at {baud} Bd: "
                "is its firmware flashed, and is it the right port?"
            )
    line.drain(SETTLE_S)


def _need(line: Line, request: bytes, size: int = 0) -> bytes:
    """Return the `size` bytes of an answer that must come, sooner or later."""
    for _ in range(_TRIES):
        for answer in line.ask(request, 1, _TRY_S):
            if (error := answer.error & ~ALERT) == Fault.ACCESS:
                raise HardwareError(
                    f"the controller board at {line.name} cannot be set up while the radio "
                    "control has the robot: switch manual off"
                )
            if error:
                raise HardwareError(
                    f"the controller board at {line.name} refuses its set-up: error {error}"
                )
            if len(answer.data) == size:  # Else it answers an older question.
                return answer.data
    raise HardwareError(f"the controller board at {line.name} does not answer as it should")
