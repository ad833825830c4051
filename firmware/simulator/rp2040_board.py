# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated board with an RP2040 in virtual time: rp2040js in a process of Node.js."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from firmware.simulator.board import BUILD, FIRMWARE, Board, Pulse
from tsd_twin.hardware.dynamixel.control_table import ResetCause

IMAGE = BUILD / "rp2040/firmware.bin"
_SIMULATOR = FIRMWARE / "rp2040js/board.js"
_NS = 1e9
_BAUD = 1_000_000
_DIVIDER_SHARE = 4.0 / 6.0
"""Input voltage relative to the Mega's, whose divider is 30 and 10 kilo-ohm."""
_PAGE, _PAGES, _SECTORS = 256, 32, 0x1FE000


def build_rp2040() -> Path:
    """Build the firmware for the RP2040 if outdated; return its path."""
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), "rp2040"], check=True)  # noqa: S603, S607
    return IMAGE


class Rp2040Board(Board):
    """As `Board`, for firmware of the RP2040, executed instruction by instruction at 48 MHz.

    Voltages at the inputs are what the Mega's dividers would output, so that the same tests apply.
    """

    SUPPLY_V = 3.3
    BROWN_OUT = ResetCause.POWER_ON

    def __init__(self, image: Path, mode_address: int) -> None:
        node = Path(sys.executable).with_name("node")
        self._process = subprocess.Popen(  # noqa: S603
            [node, str(_SIMULATOR), str(image), str(mode_address), str(_BAUD), str(_BAUD)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        assert self._process.stdin is not None  # noqa: S101
        assert self._process.stdout is not None  # noqa: S101
        self._to, self._from = self._process.stdin, self._process.stdout
        self._state: dict[str, Any] = {}
        self._heard = b""
        self._on_asked: Callable[[bytes], None] | None = None
        self._ask("run", 0)

    def close(self) -> None:
        """End the simulator."""
        self._to.close()
        self._from.close()
        self._process.wait()

    def _write(self, name: str, value: Any = None) -> None:
        self._to.write(json.dumps({"name": name, "value": value}).encode() + b"\n")

    def _read(self) -> dict[str, Any]:
        self._to.flush()
        state = json.loads(self._from.readline() or b'{"error": "it ended"}')
        if "error" in state:
            raise RuntimeError(f"the firmware crashed: {state['error']}")
        self._state = state
        self._heard += bytes.fromhex(state["host"])
        return state

    def _ask(self, name: str, value: Any = None) -> dict[str, Any]:
        self._write(name, value)
        state = self._read()
        while "request" in state:
            if self._on_asked is not None:
                self._on_asked(bytes.fromhex(state["request"]))
            self._write("go")
            state = self._read()
        return state

    @property
    def now_s(self) -> float:
        """Time since power-on."""
        return self._state["now"] / _NS

    @property
    def resets(self) -> int:
        """Number of resets for any reason."""
        return self._state["resets"]

    @property
    def light(self) -> bool:
        """Whether the board's light is on."""
        return self._state["light"]

    @property
    def turn_around_us(self) -> float:
        """Maximum time from the last stop bit of a request until the board released the bus."""
        return self._state["turnAround"] / 1000.0

    def run(self, seconds: float) -> None:
        """Run the board.

        Raises:
            RuntimeError: If the firmware accesses an unaligned word or an address without memory.
        """
        self._ask("run", self._state["now"] + round(seconds * _NS))

    def send(self, data: bytes) -> None:
        """Send bytes to the board at the line's rate, as the PC does."""
        self._write("send", data.hex())

    def receive(self) -> bytes:
        """Return the bytes sent to the PC since the last call."""
        data, self._heard = self._heard, b""
        return data

    def on_request(self, call: Callable[[bytes], None]) -> None:
        """Register a callback for complete requests on the servo bus."""
        self._on_asked = call

    def reply(self, data: bytes, delay_us: int) -> None:
        """Send bytes to the board after `delay_us`, as servos do."""
        self._write("reply", [data.hex(), delay_us])

    def bus_faults(self) -> tuple[int, int, int, int]:
        """Return fault counts of the bus, as `Board.bus_faults`."""
        stray, cut, collided, unheard = self._state["faults"]
        return stray, cut, collided, unheard

    def pulse(self, index: int) -> Pulse:
        """Return the pulses on the line to a speed controller."""
        count, width, unarmed, first = self._state["pulses"][index]
        return Pulse(count, width / 1000.0, unarmed / 1000.0, first / _NS)

    def pulse_us(self, index: int) -> float:
        """Return the width of the last pulse; 0 if they ceased."""
        return self.pulse(index).us

    def send_frames(self, *, on: bool = True, flags: int = 0) -> None:
        """Make the receiver send SBUS frames with `flags` instead of pulses."""
        self._write("sbus", [on, flags])

    def send_from_receiver(self, data: bytes, errors: int = 0) -> None:
        """Send bytes on the receiver's serial line, with a wrong parity (4) or no stop bit (16)."""
        self._write("radio", [data.hex(), errors])

    def start_parallel_pulses(self, seconds: float) -> None:
        """Start the pulses of all receiver channels simultaneously, first in `seconds`."""
        self._write("parallel", seconds)

    def set_wheel(self, index: int, hz: float) -> None:
        """Make the sensor of a wheel send `hz` pulses per second."""
        self._write("wheel", [index, _NS / hz if hz >= 0.1 else 0.0])

    def send_telemetry(self, index: int, data: bytes, *, broken: bool = False) -> None:
        """Send bytes on the telemetry wire of a speed controller, `broken` without stop bits."""
        self._write("telemetry", [index, data.hex(), broken])

    def set_receiver(self, us: Sequence[int]) -> None:
        """Set the pulse widths of the receiver's six channels; 0 for no pulse."""
        self._write("receiver", list(us))

    def set_adc(self, channel: int, volts: float) -> None:
        """Set the voltage at an analogue input."""
        self._write("adc", [channel, volts * _DIVIDER_SHARE])

    def cut_adc(self, channel: int) -> None:
        """Disconnect an analogue input, which the chip has discharged before."""
        self._write("adc", [channel, 0.0])

    def set_supply(self, volts: float) -> None:
        """Set the supply of the board, the reference of its analogue inputs."""
        self._write("supply", volts / self.SUPPLY_V)

    def peek(self, address: int) -> int:
        """Return a byte of memory."""
        return self._ask("peek", address)["byte"]

    def stop_tick(self) -> None:
        """Stop only the millisecond timer, until the next reset."""
        self._write("stopTick")

    def hang(self) -> None:
        """Make the firmware hang with interrupts disabled, until the next reset."""
        self._write("hang")

    def off(self) -> None:
        """Switch power off; no pin is driven."""
        self._ask_quietly("off")

    def on(self, cause: ResetCause, *, lose_memory: bool = True) -> None:
        """Switch power on."""
        self._ask_quietly("on", [int(cause), lose_memory])

    def reset(self, *, power: bool = False) -> None:
        """Reset the board by its pin or by a power cycle."""
        self.on(ResetCause.POWER_ON if power else ResetCause.EXTERNAL, lose_memory=power)

    def _ask_quietly(self, name: str, value: Any = None) -> None:
        self._write(name, value)
        self._ask("run", self._state["now"])

    def peek_eeprom(self, address: int) -> int:
        """Return a byte of the latest page in flash."""
        return self._newest()[1][2 + address]

    def poke_eeprom(self, address: int, value: int) -> None:
        """Change a byte of the latest page in flash, and correct the checksum of the page."""
        at, page = self._newest()
        page[2 + address] = value
        page[-2:] = struct.pack("<H", _crc16(bytes(page[:-2])))
        self._write("write", [at, bytes(page).hex()])

    def break_next_page(self) -> None:
        """Write the beginning of the next page in flash, as if power failed then."""
        at, page = self._newest()
        self._write("write", [at + _PAGE, bytes(page[:100]).hex()])

    def _newest(self) -> tuple[int, bytearray]:
        found: dict[int, tuple[int, bytearray]] = {}
        for i in range(_PAGES):
            at = _SECTORS + i * _PAGE
            page = bytearray(self._ask("flash", at + k)["byte"] for k in range(_PAGE))
            number, total = struct.unpack_from("<H", page)[0], struct.unpack("<H", page[-2:])[0]
            if total == _crc16(bytes(page[:-2])) and set(page) != {0xFF}:
                found[number] = at, page
        return found[max(found)]


def _crc16(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x8005 if crc & 0x8000 else 0)) & 0xFFFF
    return crc
