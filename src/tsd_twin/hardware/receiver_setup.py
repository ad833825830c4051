"""Guided setup of a radio control and the speed controllers, for the calibration file.

Determines type of receiver, channels, stick ranges, rest positions, dead band and fail-safe, and
the pulse range of the speed controllers.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec

from tsd_twin.hardware.controller_board import find_board, read_block
from tsd_twin.hardware.dynamixel.control_table import (
    ESCS,
    RECEIVER_CHANNELS,
    STICKS,
    SWITCH_US,
    Radio,
    RcChannel,
    Telemetry,
)
from tsd_twin.hardware.joints import (
    HIGH_US,
    LOW_US,
    EscCalibration,
    Receiver,
    ServoCalibration,
)
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport

_LOOK_S = 0.5
"""Time for which channels are watched at rest."""
_MOVE_S = 10.0
"""Time for moving all sticks to their ends."""
_TRAVEL_US = 150
"""Minimum travel from the centre; a smaller one means not moved or not connected."""
_STEADY_US = 20
_DEAD_US = (20, 100)
_PERIOD_S = 0.02
_STEPS: dict[RcChannel, tuple[str, bool]] = {
    RcChannel.FORWARD: ("Hold the stick 'forward' at its front end", True),
    RcChannel.LEFT: ("Hold the stick 'left' at its left end", True),
    RcChannel.TURN: ("Hold the stick 'turn' at its left end", True),
    RcChannel.SPEED: ("Hold the stick 'speed' at full speed", True),
    RcChannel.KILL: ("All sticks at rest, speed at zero, kill switch at 'kill'", False),
    RcChannel.MANUAL: ("Kill switch at 'run', manual switch at 'radio control'", True),
}
"""Instruction that reveals the channel of a function, and whether its pulse gets longer."""

Ask = Callable[[str], object]
"""Shows an instruction and returns the user's input."""
Pulses = tuple[int, ...]
"""Pulses of all channels, microseconds; 0 if missing."""


def watch_channels(transport: SerialTransport, seconds: float) -> list[Pulses]:
    """Return the pulses that a disarmed board received: 16 SBUS channels, then six wires.

    Raises:
        HardwareError: If the drive has power, because an unknown channel could enable radio
            control and another set the speed.
    """
    if read_block(transport, Telemetry).drive_on:
        raise HardwareError("the speed controllers have power: open the contactor first")
    end_s = time.monotonic() + seconds
    found: list[Pulses] = []
    while time.monotonic() < end_s:
        found.append(read_block(transport, Radio).channel)
        time.sleep(_PERIOD_S)
    return found


def learn_receiver(
    watch: Callable[[float], Sequence[Pulses]], ask: Ask, move_s: float = _MOVE_S
) -> Receiver:
    """Guide the user through the steps; return the receiver settings.

    Raises:
        HardwareError: If a channel is missing, a stick was not moved, or the fail-safe is not set.
    """
    ask(
        "Transmitter on. Sticks at rest, speed at zero, kill switch at 'run', manual switch at "
        "'PC'. Then press Enter."
    )
    rest = watch(_LOOK_S)
    kind = _kind(rest)
    wires = slice(RECEIVER_CHANNELS, None) if kind == "pulses" else slice(RECEIVER_CHANNELS)
    centre = _steady(rest, wires)
    channels = _learn_channels(lambda: watch(_LOOK_S)[-1][wires], ask, centre)
    ask(
        "Manual switch at 'PC'. Press Enter, then move all four sticks to both of their ends, for "
        f"{move_s:.0f} s."
    )
    moved = [pulses[wires] for pulses in (*rest, *watch(move_s))]
    moved = [pulses for pulses in moved if all(pulses[channel] for channel in channels)]
    ends = [_ends(moved, channel, centre, name) for name, channel in _sticks(channels)]
    ask("Let go of the sticks, speed at zero. Then press Enter.")
    dead_us = _dead_band(watch(_LOOK_S)[-1][wires], channels, centre)
    ask("Transmitter off. Then press Enter.")
    if watch(_LOOK_S)[-1][wires][channels[RcChannel.KILL]] > SWITCH_US:
        raise HardwareError(
            "without its transmitter the receiver goes on with 'run': set its fail-safe to kill"
        )
    learned = {
        "kind": kind,
        "channels": [channel + 1 for channel in channels],
        "low_us": [low for low, _ in ends],
        "centre_us": [centre[channel] for channel in channels[:STICKS]],
        "high_us": [high for _, high in ends],
        "dead_us": dead_us,
    }
    return msgspec.convert(learned, Receiver)


def _kind(rest: Sequence[Pulses]) -> str:
    frames = any(any(pulses[:RECEIVER_CHANNELS]) for pulses in rest)
    wires = any(any(pulses[RECEIVER_CHANNELS:]) for pulses in rest)
    if frames == wires:
        raise HardwareError(
            "two receivers are connected: one with SBUS, one with pulses"
            if frames
            else "no receiver is heard: its power, its wires, or the inverter of SBUS"
        )
    return "sbus" if frames else "pulses"


def _steady(rest: Sequence[Pulses], wires: slice) -> list[int]:
    columns = list(zip(*(pulses[wires] for pulses in rest), strict=True))
    for number, column in enumerate(columns, 1):
        if any(column) and (not all(column) or max(column) - min(column) > _STEADY_US):
            raise HardwareError(f"channel {number} does not stand still")
    if sum(map(any, columns)) < len(RcChannel):
        silent = [str(number) for number, column in enumerate(columns, 1) if not any(column)]
        raise HardwareError(f"no pulses of channel {', '.join(silent)}: check the wires")
    return [round(sum(column) / len(column)) for column in columns]


def _learn_channels(look: Callable[[], Pulses], ask: Ask, centre: Sequence[int]) -> list[int]:
    """Return the channel, from 0, that the user moves for each function."""
    found: list[int] = []
    for function, (step, longer) in _STEPS.items():
        ask(f"{step}. Then press Enter.")
        moves = [new - old if new else 0 for new, old in zip(look(), centre, strict=True)]
        channel = max(range(len(moves)), key=lambda i: abs(moves[i]))
        name, move = function.name.lower(), moves[channel]
        if abs(move) < _TRAVEL_US:
            raise HardwareError(f"no channel moved for {name}")
        if (move > 0) != longer:
            raise HardwareError(f"channel {channel + 1}, {name}, is turned round: reverse it")
        if channel in found:
            other = RcChannel(found.index(channel)).name.lower()
            raise HardwareError(f"channel {channel + 1} moved for {name}, and for {other}")
        ends = (centre[channel], centre[channel] + move)
        if function in (RcChannel.KILL, RcChannel.MANUAL) and not min(ends) <= SWITCH_US < max(
            ends
        ):
            raise HardwareError(f"the switch {name} does not pass {SWITCH_US} us")
        found.append(channel)
    return found


def _sticks(channels: Sequence[int]) -> list[tuple[RcChannel, int]]:
    return [(RcChannel(i), channel) for i, channel in enumerate(channels[:STICKS])]


def _ends(
    moved: Sequence[Pulses], channel: int, centre: Sequence[int], function: RcChannel
) -> tuple[int, int]:
    low, high = min(p[channel] for p in moved), max(p[channel] for p in moved)
    below, above = centre[channel] - low, high - centre[channel]
    one_sided = function is RcChannel.SPEED
    if above < _TRAVEL_US or (below < _TRAVEL_US and not one_sided):
        raise HardwareError(
            f"stick {function.name.lower()} went from {low} to {high} us "
            f"about {centre[channel]}: move it to both ends"
        )
    return max(low, centre[channel]) if one_sided else low, high


def _dead_band(now: Pulses, channels: Sequence[int], centre: Sequence[int]) -> int:
    least, most = _DEAD_US
    off = {function: abs(now[channel] - centre[channel]) for function, channel in _sticks(channels)}
    worst = max(off, key=lambda function: off[function])
    if 2 * off[worst] > most:
        raise HardwareError(
            f"stick {worst.name.lower()} does not return to its rest: {off[worst]} us beside it"
        )
    return max(least, 2 * off[worst])


def learn_pulse_ends(ask: Ask) -> EscCalibration:
    """Ask for the pulse ranges of the speed controllers, from their manual or calibration.

    Raises:
        HardwareError: If the input is invalid or out of range.
    """
    low_us: list[float] = []
    high_us: list[float] = []
    for number in range(1, ESCS + 1):
        typed = ask(
            f"Speed controller {number}: pulses of zero and of full throttle in us, then Enter; "
            "Enter alone for 1000 2000."
        )
        try:
            low, high = map(float, (str(typed or "") or "1000 2000").split())
        except ValueError as error:
            raise HardwareError(f"'{typed}' is not two pulses") from error
        low_us.append(low)
        high_us.append(high)
    try:
        return msgspec.convert({"low_us": low_us, "high_us": high_us}, EscCalibration)
    except msgspec.ValidationError as error:
        raise HardwareError(
            f"the board puts out {LOW_US[0]:g} to {LOW_US[1]:g} us for zero throttle, and "
            f"{HIGH_US[0]:g} to {HIGH_US[1]:g} us for full: {error}"
        ) from error


def write_section(name: str, values: msgspec.Struct, file: Path) -> None:
    """Replace a section of a calibration file and keep the rest."""
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    before, found, after = text.partition(f"[{name}]\n")
    _, following, rest = after.partition("\n[") if found else ("", "", "")
    rows = "".join(
        f"{key} = {json.dumps(value)}\n" for key, value in msgspec.to_builtins(values).items()
    )
    kept = before if not before or before.endswith("\n\n") else before.rstrip("\n") + "\n\n"
    tail = f"\n[{rest}" if following else ""
    file.write_text(f"{kept}[{name}]\n{rows}{tail}", encoding="utf-8")


def ask_line(question: str) -> str:
    """Show an instruction and return the entered line.

    Raises:
        HardwareError: If the input has ended.
    """
    try:
        return input(question)
    except EOFError:
        raise HardwareError("no input: the set-up needs a person at the keyboard") from None


def set_up_receiver(port: str, baud: int, file: Path, ask: Ask = ask_line) -> None:
    """Determine radio control and pulse ranges, and write them to a calibration file.

    Raises:
        HardwareError: If the board or the radio control is not as required.
    """
    if file.exists():
        ServoCalibration.read(str(file))
    transport = SerialTransport(port, baud)
    try:
        find_board(transport, baud)  # It also disarms the board.
        receiver = learn_receiver(partial(watch_channels, transport), ask)
    finally:
        transport.close()
    ends = learn_pulse_ends(ask)
    write_section("receiver", receiver, file)
    write_section("speed_controllers", ends, file)
    sys.stdout.write(f"{file} has the radio control and the speed controllers now\n")
