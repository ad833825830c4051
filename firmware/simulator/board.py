# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated controller board in virtual time: the compiled firmware and its pins."""

from __future__ import annotations

import _ctypes
import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tsd_twin.dynamixel.control_table import ResetCause

FIRMWARE = Path(__file__).parents[1]
BUILD = FIRMWARE / "build"
HZ = 16_000_000
_US = HZ // 1_000_000
_Request = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint32)


def build() -> Path:
    """Build the firmware and the library that runs it, if need be; return the firmware."""
    goals = ["build/firmware.elf", "simulator"]
    run = ["make", "-s", "-C", str(FIRMWARE), *goals]
    subprocess.run(run, check=True)  # noqa: S603
    return BUILD / "firmware.elf"


def build_native() -> Path:
    """Build the firmware as a library for this machine, if need be; return it."""
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), "native"], check=True)  # noqa: S603, S607
    return BUILD / "native/libfirmware.so"


def table_address(elf: Path) -> int:
    """Address of the control table in memory; a library counts from there."""
    return 0 if elf.suffix == ".so" else _symbol(elf, "table")


def _symbol(elf: Path, name: str) -> int:
    run = ["avr-nm", str(elf)]
    listing = subprocess.run(run, check=True, capture_output=True, text=True).stdout  # noqa: S603
    found = [line.split()[0] for line in listing.splitlines() if line.split()[-1] == name]
    return int(found[0], 16) & 0xFFFF


VECTORS = {
    "receiver": 11,
    "tick": 13,
    "host_byte": 25,
    "host_empty": 26,
    "bus_byte": 36,
    "bus_empty": 37,
    "bus_sent": 38,
    "radio_byte": 54,
}
"""Interrupts of the firmware, by their numbers in the ATmega2560."""


@dataclass(frozen=True)
class Timing:
    """What the chip was busy with, in cycles of 1/16 us, since the board was opened."""

    interrupts: dict[str, int]
    """The longest that each interrupt took, from its call to its return."""
    lost: tuple[int, int]
    """Bytes from the PC and from the servos that found no room in the chip."""
    longest_wait: tuple[int, int]
    """The longest that a byte from the PC, and from a servo, waited to be read."""
    turn_around: int
    """The longest from the last stop bit of a request until the board let go of the servo bus."""
    stack: int
    """Bytes of stack."""


@dataclass(frozen=True)
class Pulse:
    """Pulses measured on the line to a speed controller."""

    count: int
    us: float
    """Width of the newest; 0 when they have ceased."""
    unarmed_us: float
    """Width of the widest pulse in disarmed mode."""
    first_s: float
    """When the first began."""


class Board:
    """The controller board with its firmware; nothing happens but in `run`.

    `elf` is the firmware for the ATmega2560, run cycle by cycle at 16 MHz, or the library of it for
    this machine: the same program, which takes no time. `mode_address` is the address of the board
    mode in memory; pulses are classified by it.
    """

    def __init__(self, elf: Path, mode_address: int = 0) -> None:
        self._lib = _library(elf)
        self._board = self._lib.board_open(str(elf).encode(), mode_address)
        if not self._board:
            raise OSError(f"cannot load {elf}")
        self._native = elf.suffix == ".so"
        if not self._native:
            self._lib.board_paint(self._board, _symbol(elf, "_end"))
        self._receive = ctypes.create_string_buffer(65536)
        self._call: ctypes._FuncPointer | None = None
        self._raised: BaseException | None = None

    def close(self) -> None:
        """Free it."""
        if self._board:
            self._lib.board_close(self._board)
            if self._native:
                _ctypes.dlclose(self._lib._handle)  # noqa: SLF001
        self._board = None

    @property
    def now_s(self) -> float:
        """Time since power came."""
        return self._lib.board_cycle(self._board) / HZ

    @property
    def resets(self) -> int:
        """Number of resets, of any cause."""
        return self._lib.board_resets(self._board)

    def run(self, seconds: float) -> None:
        """Let time pass.

        Raises:
            RuntimeError: the program counter of the firmware left its code.
        """
        end = self._lib.board_cycle(self._board) + round(seconds * HZ)
        if not self._lib.board_run(self._board, end):
            raise RuntimeError("the firmware crashed")
        if self._raised is not None:
            raised, self._raised = self._raised, None
            raise raised

    def send(self, data: bytes) -> None:
        """Send bytes to the board as the PC does, at the rate of the line."""
        self._lib.board_send(self._board, data, len(data))

    def receive(self) -> bytes:
        """Return what the board sent to the PC since the last call."""
        count = self._lib.board_receive(self._board, self._receive, len(self._receive))
        return ctypes.string_at(self._receive, count)

    def on_request(self, call: Callable[[bytes], None]) -> None:
        """Have `call` called with each request on the servo bus, when it is over."""

        def guarded(data: ctypes._Pointer[ctypes.c_uint8], count: int) -> None:
            try:
                call(ctypes.string_at(data, count))
            except BaseException as error:  # Nothing can be raised through C.
                self._raised = error

        self._call = _Request(guarded)
        self._lib.board_on_request(self._board, self._call)

    def reply(self, data: bytes, delay_us: int) -> None:
        """Send bytes to the board as servos do, `delay_us` from now."""
        self._lib.board_reply(self._board, data, len(data), delay_us)

    def bus_faults(self) -> tuple[int, int, int, int]:
        """Return bytes sent while listening, requests cut by the pin, replies talked over, and
        bytes that came before the board listened.
        """
        counts = (ctypes.c_uint32 * 4)()
        self._lib.board_bus_faults(self._board, counts)
        return tuple(counts)  # type: ignore[return-value]

    def pulse(self, index: int) -> Pulse:
        """Return what is on the wire to one speed controller."""
        facts = (ctypes.c_uint64 * 4)()
        self._lib.board_esc(self._board, index, facts)
        count, width, unarmed, first = facts
        return Pulse(count, width / _US, unarmed / _US, first / HZ)

    @property
    def light(self) -> bool:
        """Whether the light on the board is on; without the chip only."""
        return self._lib.board_light(self._board)

    def timing(self) -> Timing:
        """Return what the chip was busy with; not without the chip."""
        facts = (ctypes.c_uint64 * 2)()
        uarts: list[tuple[int, ...]] = []
        for index in range(2):
            self._lib.board_uart(self._board, index, facts)
            uarts.append(tuple(facts))
        (host_lost, host_wait), (bus_lost, bus_wait) = uarts
        interrupts = {
            name: self._lib.board_interrupt(self._board, vector) for name, vector in VECTORS.items()
        }
        return Timing(
            interrupts, (host_lost, bus_lost), (host_wait, bus_wait),
            self._lib.board_turn_around(self._board), self._lib.board_stack(self._board),
        )  # fmt: skip

    def send_frames(self, *, on: bool = True, flags: int = 0) -> None:
        """Have the receiver send frames of SBUS instead of pulses, with such flags."""
        self._lib.board_sbus(self._board, on, flags)

    def send_from_receiver(self, data: bytes, errors: int = 0) -> None:
        """Send bytes on the serial line of the receiver, with such error flags of the UART."""
        self._lib.board_radio(self._board, data, len(data), errors)

    def start_parallel_pulses(self, seconds: float) -> None:
        """Have the pulses of all channels of the receiver begin at once, first in `seconds`."""
        self._lib.board_parallel_rc(self._board, max(1, round(seconds * HZ)))

    def set_receiver(self, us: Sequence[int]) -> None:
        """Set the widths of the receiver's six channels; 0 is no pulse."""
        self._lib.board_set_rc(self._board, (ctypes.c_uint32 * 6)(*us))

    def set_adc(self, channel: int, volts: float) -> None:
        """Set the voltage at an analogue input."""
        self._lib.board_set_adc(self._board, channel, round(1000.0 * volts))

    def cut_adc(self, channel: int) -> None:
        """Take the wire of an analogue input off; not at the simulated chip."""
        self._lib.board_set_adc(self._board, channel, 0xFFFFFFFF)

    def set_supply(self, volts: float) -> None:
        """Set the supply of the board, which is the reference of its analogue inputs."""
        self._lib.board_set_supply(self._board, round(1000.0 * volts))

    def peek(self, address: int) -> int:
        """Byte of memory."""
        return self._lib.board_peek(self._board, address)

    def stop_tick(self) -> None:
        """Stop the timer of the millisecond, and nothing else, until the next reset."""
        self._lib.board_stop_tick(self._board)

    def peek_eeprom(self, address: int) -> int:
        """Return a byte of the EEPROM; not of the simulated chip."""
        return int(self._lib.board_peek_eeprom(self._board, address))

    def poke_eeprom(self, address: int, value: int) -> None:
        """Change a byte of the memory that outlives power."""
        self._lib.board_poke_eeprom(self._board, address, value)

    def lose_byte(self) -> None:
        """Flag the next byte from the PC as one that came after a lost one; without the chip only.

        simavr has too much room for bytes to lose any.
        """
        self._lib.board_overrun(self._board)

    def keep_busy(self, seconds: float) -> None:
        """Have the main loop take that long for its next turn; without the chip only."""
        self._lib.board_busy(self._board, round(1e6 * seconds))

    def hang(self) -> None:
        """Make the firmware hang with interrupts off, until the next reset."""
        self._lib.board_hang(self._board)

    def off(self) -> None:
        """Take its power away: no pin is driven."""
        self._lib.board_off(self._board)

    def on(self, cause: ResetCause, *, lose_memory: bool = True) -> None:
        """Start it again."""
        self._lib.board_on(self._board, int(cause), lose_memory)

    def reset(self, *, power: bool = False) -> None:
        """Reset it by its pin, or as power does that comes back."""
        self._lib.board_reset(self._board, power)

    def count_answered(
        self, cases: Sequence[bytes], ping: bytes, answer: bytes, patience_s: float
    ) -> int:
        """Send each case and `ping` behind it; return how many were followed by `answer` in time.

        It ends with the first that was not.
        """
        lengths = (ctypes.c_uint32 * len(cases))(*map(len, cases))
        patience_us = round(1e6 * patience_s)
        return self._lib.board_ask(
            self._board, b"".join(cases), lengths, len(cases),
            ping, len(ping), answer, len(answer), patience_us,
        )  # fmt: skip


def _copy(library: Path) -> ctypes.CDLL:
    """Load a library once more: each copy has its own memory."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copy(library, folder)
        return ctypes.CDLL(copy)


def _library(program: Path) -> ctypes.CDLL:
    lib = _copy(program) if program.suffix == ".so" else ctypes.CDLL(str(BUILD / "libboard.so"))
    lib.board_open.argtypes = [ctypes.c_char_p, ctypes.c_uint16]
    lib.board_open.restype = ctypes.c_void_p
    lib.board_cycle.restype = ctypes.c_uint64
    lib.board_run.restype = ctypes.c_bool
    pointer, u32 = ctypes.c_void_p, ctypes.c_uint32
    for name, *arguments in (
        ("close",),
        ("cycle",),
        ("resets",),
        ("run", ctypes.c_uint64),
        ("send", ctypes.c_char_p, u32),
        ("receive", ctypes.c_char_p, u32),
        ("on_request", _Request),
        ("reply", ctypes.c_char_p, u32, u32),
        ("bus_faults", pointer),
        ("esc", u32, pointer),
        ("set_rc", pointer),
        ("parallel_rc", u32),
        ("sbus", ctypes.c_bool, ctypes.c_uint8),
        ("radio", ctypes.c_char_p, u32, ctypes.c_uint8),
        ("set_adc", u32, u32),
        ("set_supply", u32),
        ("peek", ctypes.c_uint16),
        ("stop_tick",),
        ("poke_eeprom", ctypes.c_uint16, ctypes.c_uint8),
        ("hang",),
        ("off",),
        ("on", ctypes.c_uint8, ctypes.c_bool),
        ("reset", ctypes.c_bool),
        ("ask", ctypes.c_char_p, pointer, u32, ctypes.c_char_p, u32, ctypes.c_char_p, u32, u32),
    ):
        getattr(lib, f"board_{name}").argtypes = [pointer, *arguments]
    if program.suffix == ".so":
        lib.board_overrun.argtypes = [pointer]
        lib.board_busy.argtypes = [pointer, u32]
        lib.board_peek_eeprom.argtypes = [pointer, ctypes.c_uint16]
        lib.board_peek_eeprom.restype = ctypes.c_uint8
        lib.board_light.argtypes = [pointer]
        lib.board_light.restype = ctypes.c_bool
    else:
        lib.board_uart.argtypes = [pointer, u32, pointer]
        lib.board_interrupt.argtypes = [pointer, u32]
        lib.board_stack.argtypes = [pointer]
        lib.board_turn_around.argtypes = [pointer]
        lib.board_paint.argtypes = [pointer, u32]
    lib.board_peek.restype = ctypes.c_uint8
    return lib
