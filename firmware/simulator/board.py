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

from tsd_twin.hardware.dynamixel.control_table import ResetCause

FIRMWARE = Path(__file__).parents[1]
BUILD = FIRMWARE / "build"
HZ = 16_000_000
_US = HZ // 1_000_000
_DDRB, _PORTB, _LIGHT = 0x24, 0x25, 0x80
_Request = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint32)


def build() -> Path:
    """Build the firmware and its simulator library if outdated; return the firmware's path."""
    goals = ["build/firmware.elf", "simulator"]
    run = ["make", "-s", "-C", str(FIRMWARE), *goals]
    subprocess.run(run, check=True)  # noqa: S603
    return BUILD / "firmware.elf"


def build_native() -> Path:
    """Build the firmware as a library for this machine if outdated; return its path."""
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), "native"], check=True)  # noqa: S603, S607
    return BUILD / "native/libfirmware.so"


def table_address(elf: Path) -> int:
    """Return the address of the control table in memory; in a library, addresses start there."""
    if elf.suffix == ".bin":
        return _symbol(elf.with_suffix(".elf"), "table", "arm-none-eabi-nm")
    return 0 if elf.suffix == ".so" else _symbol(elf, "table") & 0xFFFF


def _symbol(elf: Path, name: str, lister: str = "avr-nm") -> int:
    run = [lister, str(elf)]
    listing = subprocess.run(run, check=True, capture_output=True, text=True).stdout  # noqa: S603
    found = [line.split()[0] for line in listing.splitlines() if line.split()[-1] == name]
    return int(found[0], 16)


VECTORS = {
    "receiver": 11,
    "tick": 13,
    "host_byte": 25,
    "host_empty": 26,
    "bus_byte": 36,
    "bus_empty": 37,
    "bus_sent": 38,
    "wheels": 47,
    "radio_byte": 54,
}
"""Interrupt vector numbers of the ATmega2560."""


@dataclass(frozen=True)
class Timing:
    """Timing of the chip since the board was opened, in cycles of 1/16 us."""

    interrupts: dict[str, int]
    """Maximum duration of each interrupt, from call to return."""
    lost: tuple[int, int]
    """Bytes from the PC and from the servos lost because the chip's buffer was full."""
    longest_wait: tuple[int, int]
    """Maximum time until a byte from the PC, and from a servo, was read."""
    turn_around: int
    """Maximum time from the last stop bit of a request until the board released the servo bus."""
    stack: int
    """Maximum stack size, bytes."""


@dataclass(frozen=True)
class Pulse:
    """Pulses measured on the line to a speed controller."""

    count: int
    us: float
    """Width of the last pulse; 0 if they ceased."""
    unarmed_us: float
    """Width of the widest pulse in disarmed mode."""
    first_s: float
    """Start of the first pulse."""


class Board:
    """Controller board with its firmware; time passes only in `run`.

    `elf` is either the firmware for the ATmega2560, simulated cycle by cycle at 16 MHz, or its
    library for this machine: the same program, which takes no time. Pulses are classified by the
    board mode at `mode_address`.
    """

    SUPPLY_V = 5.0
    BROWN_OUT = ResetCause.BROWN_OUT
    """Cause that the chip reports after a brown-out."""

    def __init__(self, elf: Path, mode_address: int = 0) -> None:
        self._lib = _library(elf)
        self._board = self._lib.board_open(str(elf).encode(), mode_address)
        if not self._board:
            raise OSError(f"cannot load {elf}")
        self._native = elf.suffix == ".so"
        if not self._native:
            self._lib.board_paint(self._board, _symbol(elf, "_end") & 0xFFFF)
        self._receive = ctypes.create_string_buffer(65536)
        self._pulse = (ctypes.c_uint64 * 4)()
        self._call: ctypes._FuncPointer | None = None
        self._raised: BaseException | None = None

    def close(self) -> None:
        """Free the simulator."""
        if self._board:
            self._lib.board_close(self._board)
            if self._native:
                _ctypes.dlclose(self._lib._handle)  # noqa: SLF001
        self._board = None

    @property
    def now_s(self) -> float:
        """Time since power-on."""
        return self._lib.board_cycle(self._board) / HZ

    @property
    def resets(self) -> int:
        """Number of resets for any reason."""
        return self._lib.board_resets(self._board)

    def run(self, seconds: float) -> None:
        """Run the board.

        Raises:
            RuntimeError: If the firmware's program counter left its code.
        """
        end = self._lib.board_cycle(self._board) + round(seconds * HZ)
        if not self._lib.board_run(self._board, end):
            raise RuntimeError("the firmware crashed")
        if self._raised is not None:
            raised, self._raised = self._raised, None
            raise raised

    def send(self, data: bytes) -> None:
        """Send bytes to the board at the line's rate, as the PC does."""
        self._lib.board_send(self._board, data, len(data))

    def receive(self) -> bytes:
        """Return the bytes sent to the PC since the last call."""
        count = self._lib.board_receive(self._board, self._receive, len(self._receive))
        return ctypes.string_at(self._receive, count)

    def on_request(self, call: Callable[[bytes], None]) -> None:
        """Register a callback for complete requests on the servo bus."""

        def guarded(data: ctypes._Pointer[ctypes.c_uint8], count: int) -> None:
            try:
                call(ctypes.string_at(data, count))
            except BaseException as error:  # Exceptions cannot propagate through C.
                self._raised = error

        self._call = _Request(guarded)
        self._lib.board_on_request(self._board, self._call)

    def reply(self, data: bytes, delay_us: int) -> None:
        """Send bytes to the board after `delay_us`, as servos do."""
        self._lib.board_reply(self._board, data, len(data), delay_us)

    def bus_faults(self) -> tuple[int, int, int, int]:
        """Return fault counts of the bus.

        These are bytes sent while listening, requests cut by the pin, collisions with replies, and
        bytes received before the board listened.
        """
        counts = (ctypes.c_uint32 * 4)()
        self._lib.board_bus_faults(self._board, counts)
        return tuple(counts)  # type: ignore[return-value]

    def pulse(self, index: int) -> Pulse:
        """Return the pulses on the line to a speed controller."""
        self._lib.board_esc(self._board, index, self._pulse)
        count, width, unarmed, first = self._pulse
        return Pulse(count, width / _US, unarmed / _US, first / HZ)

    def pulse_us(self, index: int) -> float:
        """Return the width of the last pulse, as in `pulse`, which takes three times as long."""
        self._lib.board_esc(self._board, index, self._pulse)
        return self._pulse[1] / _US

    @property
    def light(self) -> bool:
        """Whether the board's light is on."""
        if self._native:
            return self._lib.board_light(self._board)
        return bool(self.peek(_PORTB) & self.peek(_DDRB) & _LIGHT)

    def timing(self) -> Timing:
        """Return the timing; simulated chip only."""
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
        """Make the receiver send SBUS frames with `flags` instead of pulses."""
        self._lib.board_sbus(self._board, on, flags)

    def send_from_receiver(self, data: bytes, errors: int = 0) -> None:
        """Send bytes on the receiver's serial line, with error flags of the UART."""
        self._lib.board_radio(self._board, data, len(data), errors)

    def start_parallel_pulses(self, seconds: float) -> None:
        """Start the pulses of all receiver channels simultaneously, first in `seconds`."""
        self._lib.board_parallel_rc(self._board, max(1, round(seconds * HZ)))

    def set_receiver(self, us: Sequence[int]) -> None:
        """Set the pulse widths of the receiver's six channels; 0 for no pulse."""
        self._lib.board_set_rc(self._board, (ctypes.c_uint32 * 6)(*us))

    def set_wheel(self, index: int, hz: float) -> None:
        """Make the sensor of a wheel send `hz` pulses per second."""
        self._lib.board_set_wheel(self._board, index, round(HZ / hz) if hz >= 0.1 else 0)

    def disturb_wheel(self, index: int, *, lost: float = 0.0, extra: float = 0.0) -> None:
        """Lose a fraction of a sensor's pulses, and add one after another; native library only."""
        shares = round(256 * lost), round(256 * extra)
        self._lib.board_disturb_wheel(self._board, index, *shares)

    def send_telemetry(self, index: int, data: bytes, *, broken: bool = False) -> None:
        """Send bytes on the telemetry wire of a speed controller; native library only.

        `broken`: without stop bits.
        """
        self._lib.board_telemetry(self._board, index, data, len(data), broken)

    def set_adc(self, channel: int, volts: float) -> None:
        """Set the voltage at an analogue input."""
        self._lib.board_set_adc(self._board, channel, round(1000.0 * volts))

    def cut_adc(self, channel: int) -> None:
        """Disconnect an analogue input; native library only."""
        self._lib.board_set_adc(self._board, channel, 0xFFFFFFFF)

    def set_supply(self, volts: float) -> None:
        """Set the supply of the board, the reference of its analogue inputs."""
        self._lib.board_set_supply(self._board, round(1000.0 * volts))

    def peek(self, address: int) -> int:
        """Return a byte of memory."""
        return self._lib.board_peek(self._board, address)

    def stop_tick(self) -> None:
        """Stop only the millisecond timer, until the next reset."""
        self._lib.board_stop_tick(self._board)

    def peek_eeprom(self, address: int) -> int:
        """Return a byte of the EEPROM; native library only."""
        return int(self._lib.board_peek_eeprom(self._board, address))

    def poke_eeprom(self, address: int, value: int) -> None:
        """Change a byte of the EEPROM."""
        self._lib.board_poke_eeprom(self._board, address, value)

    def lose_byte(self) -> None:
        """Flag the next byte from the PC as following a lost byte; native library only.

        The UARTs of simavr have too much room to lose bytes.
        """
        self._lib.board_overrun(self._board)

    def keep_busy(self, seconds: float) -> None:
        """Make the next turn of the main loop take `seconds`; native library only."""
        self._lib.board_busy(self._board, round(1e6 * seconds))

    def hang(self) -> None:
        """Make the firmware hang with interrupts disabled, until the next reset."""
        self._lib.board_hang(self._board)

    def off(self) -> None:
        """Switch power off; no pin is driven."""
        self._lib.board_off(self._board)

    def on(self, cause: ResetCause, *, lose_memory: bool = True) -> None:
        """Switch power on."""
        self._lib.board_on(self._board, int(cause), lose_memory)

    def reset(self, *, power: bool = False) -> None:
        """Reset the board by its pin or by a power cycle."""
        self._lib.board_reset(self._board, power)

    def count_answered(
        self, cases: Sequence[bytes], ping: bytes, answer: bytes, patience_s: float
    ) -> int:
        """Send each case followed by `ping`; return how many led to `answer` in time.

        Stops at the first failure.
        """
        lengths = (ctypes.c_uint32 * len(cases))(*map(len, cases))
        patience_us = round(1e6 * patience_s)
        return self._lib.board_ask(
            self._board, b"".join(cases), lengths, len(cases),
            ping, len(ping), answer, len(answer), patience_us,
        )  # fmt: skip


def _copy(library: Path) -> ctypes.CDLL:
    """Load a copy of a library, because each copy has separate memory."""
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
        ("set_wheel", u32, u32),
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
        lib.board_disturb_wheel.argtypes = [pointer, u32, ctypes.c_uint8, ctypes.c_uint8]
        lib.board_busy.argtypes = [pointer, u32]
        lib.board_telemetry.argtypes = [pointer, u32, ctypes.c_char_p, u32, ctypes.c_bool]
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
