"""Guided set-up of a radio control: end points, rest and fail-safe, for the calibration file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tsd_twin.dynamixel.blocks import Telemetry
from tsd_twin.dynamixel.control_table import BOARD_ID, STICKS, SWITCH_US, RcChannel
from tsd_twin.dynamixel.packets import protocol2
from tsd_twin.hardware.controller_board import find_board, request_data
from tsd_twin.hardware.joints import Receiver, ServoCalibration
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport

_LOOK_S = 0.5
"""Time for which pulses are watched that should stand still."""
_MOVE_S = 10.0
"""Time in which a person moves all sticks to their ends."""
_TRAVEL_US = 150
"""A stick that moves less from its centre was not moved to its end, or is not connected."""
_STEADY_US = 20
_PERIOD_S = 0.02

Ask = Callable[[str], object]
"""Shows a step to a person, and returns when it is done."""


class PulseWatcher:
    """Reads the pulses of the receiver from a board, which stays disarmed without commands."""

    def __init__(self, transport: SerialTransport, baud: int) -> None:
        """Find the board, and disarm it.

        Raises:
            HardwareError: it is another device, or does not answer.
        """
        self._transport = transport
        find_board(transport, baud)

    def watch(self, seconds: float) -> list[tuple[int, ...]]:
        """Return the pulses, microseconds, that were seen in a while; 0 where there were none."""
        end_s = time.monotonic() + seconds
        found: list[tuple[int, ...]] = []
        size = Telemetry.LAYOUT.size
        request = protocol2.read(BOARD_ID, Telemetry.ADDRESS, size)
        while time.monotonic() < end_s:
            found.append(Telemetry.unpack(request_data(self._transport, request, size)).rc)
            time.sleep(_PERIOD_S)
        return found


def learn_receiver(
    watch: Callable[[float], Sequence[tuple[int, ...]]], ask: Ask, move_s: float = _MOVE_S
) -> Receiver:
    """Lead a person through the steps; return what was learned.

    Raises:
        HardwareError: a channel has no pulses, a stick was not moved, or the fail-safe is not set.
    """
    ask(
        "Transmitter on. Sticks at rest, speed at zero, kill switch at 'run', manual switch at "
        "'PC'. Then press Enter."
    )
    rest = watch(_LOOK_S)
    for channel in RcChannel:
        pulses = [pulse[channel] for pulse in rest]
        if not all(pulses):
            raise HardwareError(f"channel {channel.name.lower()} has no pulses: check its wire")
        if max(pulses) - min(pulses) > _STEADY_US:
            raise HardwareError(f"channel {channel.name.lower()} does not stand still")
    centre = [round(sum(column) / len(rest)) for column in zip(*rest, strict=True)]
    _check_switches(centre)
    ask(f"Press Enter, then move all four sticks to both of their ends, for {move_s:.0f} s.")
    moved = [*rest, *(pulses for pulses in watch(move_s) if all(pulses))]
    low = [min(column) for column in zip(*moved, strict=True)]
    high = [max(column) for column in zip(*moved, strict=True)]
    for channel in list(RcChannel)[:STICKS]:
        below, above = centre[channel] - low[channel], high[channel] - centre[channel]
        one_sided = channel is RcChannel.SPEED
        if above < _TRAVEL_US or (below < _TRAVEL_US and not one_sided):
            raise HardwareError(
                f"stick {channel.name.lower()} went from {low[channel]} to {high[channel]} us "
                f"about {centre[channel]}: move it to both ends, or check its direction"
            )
    ask("Transmitter off. Then press Enter.")
    lost = watch(_LOOK_S)[-1]
    if lost[RcChannel.KILL] > SWITCH_US:
        raise HardwareError(
            "without its transmitter the receiver goes on with 'run': set its fail-safe to kill"
        )
    low[RcChannel.SPEED] = max(low[RcChannel.SPEED], centre[RcChannel.SPEED])
    return Receiver(low_us=_four(low), centre_us=_four(centre), high_us=_four(high))


def _check_switches(pulses: Sequence[int]) -> None:
    if pulses[RcChannel.KILL] <= SWITCH_US:
        raise HardwareError("the kill switch is on, or its channel turned round: 'run' is longer")
    if pulses[RcChannel.MANUAL] > SWITCH_US:
        raise HardwareError("the manual switch is on, or its channel turned round: 'PC' is shorter")


def _four(pulses: Sequence[int]) -> tuple[int, int, int, int]:
    forward, left, turn, speed = pulses[:STICKS]
    return forward, left, turn, speed


def write_receiver(receiver: Receiver, file: Path) -> None:
    """Put the receiver into a calibration file, in place of what it had, and keep the rest."""
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    before, found, after = text.partition("[receiver]\n")
    _, following, rest = after.partition("\n[") if found else ("", "", "")
    rows = [
        f"{name} = {list(getattr(receiver, name))}\n" for name in ("low_us", "centre_us", "high_us")
    ]
    kept = before if not before or before.endswith("\n\n") else before.rstrip("\n") + "\n\n"
    tail = f"\n[{rest}" if following else ""
    file.write_text(f"{kept}[receiver]\n{''.join(rows)}{tail}", encoding="utf-8")


def set_up_receiver(port: str, baud: int, file: Path, ask: Ask = input) -> None:
    """Learn the radio control at the board of a port, and write it into a calibration file.

    Raises:
        HardwareError: the board or the radio control is not as it has to be.
    """
    if file.exists():
        ServoCalibration.read(str(file))
    transport = SerialTransport(port, baud)
    try:
        receiver = learn_receiver(PulseWatcher(transport, baud).watch, ask)
    finally:
        transport.close()
    write_receiver(receiver, file)
    sys.stdout.write(f"{file} has the radio control now\n")
