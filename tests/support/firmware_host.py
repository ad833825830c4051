"""Host end of the firmware's serial line in virtual time, with valid and invalid behaviour of a
bridge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from firmware.simulator import protocol2
from firmware.simulator.simulation import FirmwareSimulation
from tsd_twin.hardware.dynamixel.control_table import (
    ADDRESS,
    BOARD_ID,
    ZERO_THROTTLE,
    BoardCommand,
    BoardMode,
    ReceiverKind,
    Setup,
    Telemetry,
    TripHistory,
    Wheels,
)
from tsd_twin.hardware.dynamixel.servo_models import MODELS

CYCLE_S = 0.01
MODEL = {1: MODELS[310], 2: MODELS[311]}
"""Models of the simulated servos, by protocol."""
CHECK_S = 2.5
"""Time in which the board reads all settings of all servos again."""
_SET_UP_S = 0.4
"""Time until all servos hold and the setup is in EEPROM."""
HOLD_S = 2.15
"""Time from power-up until the board can be armed."""
CRUISE = (2414, 2411, 2417)
ZERO = (ZERO_THROTTLE,) * 3
NO_GOALS = (0,) * 6


def at(address: int) -> bytes:
    return address.to_bytes(2, "little")


def write(address: int, data: bytes) -> bytes:
    return protocol2.packet(BOARD_ID, protocol2.WRITE, at(address) + data)


def read(address: int, length: int) -> bytes:
    return protocol2.packet(BOARD_ID, protocol2.READ, at(address) + at(length))


def sbus_frame(us: Sequence[int], flags: int) -> bytes:
    """Return the frame of an SBUS receiver."""
    channels = [*us, *(1500,) * (16 - len(us))]
    bits = sum((width_us - 880) * 8 // 5 << 11 * i for i, width_us in enumerate(channels))
    return b"\x0f" + bits.to_bytes(22, "little") + bytes([flags, 0])


READ_TELEMETRY = read(Telemetry.ADDRESS, Telemetry.LAYOUT.size)
PING = protocol2.packet(BOARD_ID, protocol2.PING)


def packets(data: bytes) -> list[bytes]:
    """Split received bytes into packets."""
    found: list[bytes] = []
    while data:
        size = 7 + int.from_bytes(data[5:7], "little")
        found.append(data[:size])
        data = data[size:]
    return found


class FirmwareHost:
    """Simulated robot with the host of its board."""

    def __init__(self, simulation: FirmwareSimulation) -> None:
        self.simulation = simulation
        self.beat = 0
        self.session = (0, 0)
        """Latest nonce of the board."""
        self.sent: list[bytes] = []
        """All bytes sent to the board."""
        self.zero_us = (1000.0,) * 3
        """Pulses of zero throttle."""
        self.missed = 0
        """Number of cycles with a missing response."""

    def ask(self, request: bytes) -> tuple[int, bytes]:
        """Send one packet; return error and data of the response."""
        self.simulation.board.receive()
        self.simulation.board.send(request)
        self.simulation.run(0.005)
        answer = protocol2.parse(self.simulation.board.receive())
        assert answer is not None, "no answer"
        ident, instruction, parameters = answer
        assert (ident, instruction) == (BOARD_ID, protocol2.STATUS)
        return parameters[0], parameters[1:]

    def telemetry(self) -> Telemetry:
        error, data = self.ask(READ_TELEMETRY)
        assert error == 0
        return self._heard(Telemetry.unpack(data))

    def wheels(self) -> Wheels:
        """Read the wheel speeds."""
        error, data = self.ask(read(Wheels.ADDRESS, Wheels.LAYOUT.size))
        assert error == 0
        return Wheels.unpack(data)

    def history(self) -> TripHistory:
        """Read the last trips."""
        error, data = self.ask(read(TripHistory.ADDRESS, TripHistory.LAYOUT.size))
        assert error == 0
        return TripHistory.unpack(data)

    def _heard(self, telemetry: Telemetry) -> Telemetry:
        self.session = telemetry.nonce
        return telemetry

    def mode(self) -> BoardMode:
        return BoardMode(self.telemetry().mode)

    def set_up(self, setup: Setup | None = None) -> int:
        """Write the setup; return the error."""
        setup = Setup() if setup is None else setup
        if self.simulation.sbus:
            setup = replace(setup, receiver_kind=ReceiverKind.SBUS)
        return self.ask(write(Setup.ADDRESS, setup.pack()))[0]

    def command(
        self,
        arm: int,
        throttle: Sequence[int] = ZERO,
        goal: Sequence[int] = NO_GOALS,
        *,
        torque: int = 1,
        fresh: bool = True,
    ) -> bytes:
        """Return a whole command block, as a packet."""
        self.beat = (self.beat + fresh) % 65536
        block = BoardCommand(self.beat, arm, torque, tuple(throttle), tuple(goal), self.session)
        return write(BoardCommand.ADDRESS, block.pack())

    def cycle(
        self,
        arm: int,
        throttle: Sequence[int] = ZERO,
        goal: Sequence[int] = NO_GOALS,
        *,
        torque: int = 1,
        fresh: bool = True,
    ) -> Telemetry | None:
        """Write and read like a bridge in one cycle; return None if a response is missing."""
        command = self.command(arm, throttle, goal, torque=torque, fresh=fresh)
        self.sent.append(command + READ_TELEMETRY)
        self.simulation.board.send(command + READ_TELEMETRY)
        self.simulation.run(CYCLE_S)
        answers = packets(self.simulation.board.receive())
        parsed = protocol2.parse(answers[1]) if len(answers) == 2 else None
        if parsed is None:
            self.missed += 1
            return None
        return self._heard(Telemetry.unpack(parsed[2][1:]))

    def drive(
        self,
        seconds: float,
        arm: int = 1,
        throttle: Sequence[int] = CRUISE,
        goal: Sequence[int] = NO_GOALS,
        *,
        fresh: bool = True,
    ) -> Telemetry:
        """Repeat the command for a time; return the last telemetry."""
        for _ in range(round(seconds / CYCLE_S)):
            self.cycle(arm, throttle, goal, fresh=fresh)
        return self.telemetry()

    def get_ready(self, setup: Setup | None = None) -> FirmwareHost:
        """Set up, and wait until arming is possible."""
        self.simulation.run(HOLD_S)
        assert self.set_up(setup) == 0
        self.simulation.run(_SET_UP_S)
        self.telemetry()  # A bridge has a session.
        return self

    def arm(self, *, at_once: bool = False) -> Telemetry:
        """Switch the arm command from 0 to 1; return the telemetry after it.

        Unless `at_once`, hold zero throttle first for the required time.
        """
        self.telemetry()
        self.cycle(0)
        if not at_once and not self.telemetry().esc_ready:
            self.simulation.run(HOLD_S)
        self.cycle(1)
        return self.telemetry()

    def get_driving(
        self, goal: Sequence[int] = NO_GOALS, setup: Setup | None = None
    ) -> FirmwareHost:
        """Arm and spin the wheels."""
        self.get_ready(setup)
        assert self.arm().mode == BoardMode.ARMED
        assert self.drive(0.2, goal=goal).mode == BoardMode.ARMED
        assert min(self.simulation.pulses_us()) > 1200.0
        return self

    def until_quiet(self, patience_s: float) -> float:
        """Send nothing; return the time until all pulses are zero throttle, in seconds."""
        start_s = self.simulation.board.now_s
        while max(self.simulation.pulses_us()) > 1001.0:
            self.simulation.run(0.001)
            assert self.simulation.board.now_s - start_s < patience_s, "the pulses go on"
        return self.simulation.board.now_s - start_s

    def finish(self) -> None:
        """Check the invariants of the whole run."""
        widest = [self.simulation.board.pulse(i).unarmed_us for i in range(3)]
        faults = self.simulation.board.bus_faults()
        for pulse_us, zero_us in zip(widest, self.zero_us, strict=True):
            assert pulse_us < zero_us + 1.0, f"a pulse of {pulse_us} us in disarmed mode"
        assert faults == (0, 0, 0, 0), "the servo bus was not kept clean"
        reserved = self.simulation.servo_bus.reserved
        assert not reserved, f"reads of reserved registers: {reserved}"


def number(pilot: FirmwareHost, item: str, size: int = 1, index: int = 0) -> int:
    """Return the current value of an item in the control table."""
    at, peek = ADDRESS[item] + size * index, pilot.simulation.board.peek
    at += pilot.simulation.table_address
    return sum(peek(at + i) << 8 * i for i in range(size))


def run_until(
    pilot: FirmwareHost, item: str, value: int, size: int = 1, *, mask: int = 0xFFFF
) -> int:
    """Run until an item has a value; return the board time in milliseconds."""
    end_s = pilot.simulation.board.now_s + 3.0
    while number(pilot, item, size) & mask != value:
        pilot.simulation.run(0.0002)
        assert pilot.simulation.board.now_s < end_s, item
    return number(pilot, "millis", 4)


class Bench:
    """Creates hosts for one firmware build, and checks their invariants at the end."""

    def __init__(self, elf: Path | None = None, **defaults: object) -> None:
        self._elf = elf
        self._defaults = defaults
        self._pilots: list[FirmwareHost] = []

    def pilot(self, version: int | Sequence[int] = 2, **more: object) -> FirmwareHost:
        """Power up a robot; arguments as of `FirmwareSimulation`."""
        more = self._defaults | more
        pilot = FirmwareHost(FirmwareSimulation(version, elf=self._elf, **more))  # type: ignore[arg-type]
        self._pilots.append(pilot)
        return pilot

    def finish(self) -> None:
        """Check the invariants of all hosts."""
        for pilot in self._pilots:
            pilot.finish()

    def close(self) -> None:
        """Free all hosts."""
        for pilot in self._pilots:
            pilot.simulation.close()
