"""Robot in virtual time with the real node, bridge and firmware."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from firmware.simulator.mx64 import Mx64
from firmware.simulator.simulation import FirmwareSimulation
from tests.support.memory_bus import MemoryBus, Network
from tests.support.pty_devices import ServoChain
from tests.support.robot_node import QUICK
from tests.support.virtual_time import VirtualClock
from tsd_twin import robots
from tsd_twin.hardware import arduino_mega, u2d2
from tsd_twin.hardware import serial_transport as serial
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.board_cycle import BAUD, ControllerBoard
from tsd_twin.hardware.controller_board import read_block
from tsd_twin.hardware.dynamixel.control_table import Refusal, Setup, Telemetry
from tsd_twin.hardware.joints import JointCommand, Receiver, ServoCalibration
from tsd_twin.hardware.u2d2 import U2D2IO
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import Description
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import Sample
from tsd_twin.models import robot_urdf
from tsd_twin.node import RobotNode
from tsd_twin.node.authority import Authority
from tsd_twin.node.timing import RateKeeper
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.safety import Heartbeat, SafetySupervisor
from tsd_twin.simulation import Motors

PERIOD_S = 0.01
ZERO_US = 1001.0
"""Maximum pulse for zero throttle."""
_BYTE_WAIT_S = 0.001


class VirtualPort:
    """Serial port with a function as its peer; time passes in `read`."""

    def __init__(
        self,
        clock: VirtualClock,
        timeout_s: float,
        send: Callable[[bytes], None],
        receive: Callable[[], bytes],
    ) -> None:
        self._clock, self._timeout_s = clock, timeout_s
        self._send, self._receive = send, receive
        self._waiting = b""

    @property
    def in_waiting(self) -> int:
        self._waiting += self._receive()
        return len(self._waiting)

    def read(self, size: int) -> bytes:
        end_s = self._clock.now_s + self._timeout_s
        while not self.in_waiting and self._clock.now_s < end_s:
            self._clock.advance(_BYTE_WAIT_S)
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        self._send(data)
        return len(data)

    def reset_input_buffer(self) -> None:
        self._receive()
        self._waiting = b""

    def close(self) -> None:
        """Do nothing, because nothing is open."""


class TurnTaking:
    """Replacement for `DeviceThread` that runs requested cycles in turn with the node."""

    def __init__(self, port: str, device: serial.Device) -> None:
        self.loop = serial.DeviceLoop(port, device)
        self._stepped_s = time.monotonic()

    def cycle(self) -> None:
        """Exchange data; while disconnected, try to connect when due."""
        if self.loop.connected or time.monotonic() - self._stepped_s >= self.loop.pause_s:
            self.loop.step()
            self._stepped_s = time.monotonic()

    def close(self) -> None:
        self.loop.close()


class VirtualRobot:
    """`tsd` on an in-memory bus: node, bridge, firmware, servos, motors and a radio.

    With `u2d2`, the servos are at the computer, and the board has none.
    """

    id = "tsd"
    late_s = 0.021
    """Time from the end of a command until the node acts: two periods."""

    def __init__(
        self,
        clock: VirtualClock,
        native: Path,
        patch: pytest.MonkeyPatch,
        *,
        bus_servos: bool = False,
        authority: Authority | None = None,
    ) -> None:
        self.clock = clock
        self.network = Network(clock)
        self.bus = MemoryBus(self.network)
        self.firmware = FirmwareSimulation(elf=native, receiver=True)
        self.chain = ServoChain() if bus_servos else None
        self.robot = description_of_kind(
            robots.parse_description(QUICK, self.id), SingularityDescription
        )
        self._chain_answer = b""
        self._start_s = clock.now_s
        self._ticking = False
        self._next_s = math.inf
        self.widest_us = 0.0
        """Widest pulse since `watch`."""
        self.status_sent_s: dict[int, float] = {}
        """Times at which statuses were sent, by number."""
        self.network.takers.append((topics.STATUS.key(self.id), self._note_status))
        clock.machines.append(self._move)
        clock.wait = self.wait
        patch.setattr(serial, "open_port", self._open_port)
        patch.setattr(arduino_mega, "DeviceThread", self._take_turns)
        patch.setattr(u2d2, "DeviceThread", TurnTaking)
        self._see_stop_circuit()
        self.io = self._hardware()
        self.description = Description(QUICK, robot_urdf(self.robot))
        self.node = RobotNode(
            self.bus, self.id, self.robot, self.io, self.description, authority=authority
        )
        self._rate = RateKeeper(PERIOD_S)
        self._next_s = clock.now_s

    def close(self) -> None:
        """Free the firmware."""
        self.firmware.close()

    def _see_stop_circuit(self) -> None:
        """Open and close the stop circuit once after power-up, like an owner."""
        self.firmware.set_contactor(closed=False)
        self.clock.advance(0.2)
        self.firmware.set_contactor(closed=True)

    def _hardware(self) -> ArduinoMegaIO | U2D2IO:
        calibration, motors = ServoCalibration(receiver=Receiver()), Motors.of(self.robot)
        if self.chain is None:
            return ArduinoMegaIO(self.robot, "board", motors, calibration)
        for servo in self.firmware.servos:
            servo.dead = True
        wheels = ArduinoMegaIO(self.robot, "board", motors, calibration, servos=False)
        return U2D2IO(self.robot, wheels, "servos", motors, calibration)

    def _take_turns(self, port: str, device: ControllerBoard) -> TurnTaking:
        self._board = device
        return TurnTaking(port, device)

    def _open_port(self, name: str, _baud: int, timeout_s: float) -> VirtualPort:
        if name == "board":
            board = self.firmware.board
            return VirtualPort(self.clock, timeout_s, board.send, board.receive)
        return VirtualPort(self.clock, timeout_s, self._ask_chain, self._hear_chain)

    def _ask_chain(self, data: bytes) -> None:
        assert self.chain is not None
        self._chain_answer += self.chain.answer(data, self.clock.now_s)

    def _hear_chain(self) -> bytes:
        answer, self._chain_answer = self._chain_answer, b""
        return answer

    def _note_status(self, sample: Sample) -> None:
        number, robot_ns = decode_stamp(sample.attachment)
        self.status_sent_s[number] = robot_ns / 1e9

    # Time.

    def _move(self, now_s: float) -> None:
        self.firmware.run(now_s - self._start_s - self.firmware.board.now_s)
        self.widest_us = max(self.widest_us, *self.firmware.pulses_us())

    def wait(self, seconds: float) -> None:
        """Advance the time, with a node period each 10 ms."""
        end_s = self.clock.now_s + max(seconds, 1e-6)
        while self.clock.now_s < end_s - 1e-9:
            if not self._ticking and self.clock.now_s >= self._next_s - 1e-9:
                self._tick()
            else:
                until_s = end_s if self._ticking else min(end_s, self._next_s)
                self.clock.advance(max(until_s - self.clock.now_s, 1e-6))

    def _tick(self) -> None:
        self._ticking = True
        self._next_s = max(self._next_s + PERIOD_S, self.clock.now_s)
        try:
            self.node.step(self.clock.now_s, self._rate)
        finally:
            self._ticking = False

    # State for tests.

    @property
    def supervisor(self) -> SafetySupervisor:
        """Safety state machine of the node."""
        return self.node.supervisor

    @property
    def telemetry(self) -> Telemetry:
        """Latest telemetry read by the bridge."""
        report = self._board.report
        assert report is not None
        return report.telemetry

    @property
    def setup(self) -> Setup:
        """Setup written by the bridge to the board."""
        return read_block(serial.SerialTransport("board", BAUD), Setup)

    def refusal_past_the_node(self) -> Refusal:
        """Arm the board without checks; return its refusal."""
        board, at_rest = self._board, np.zeros(9)
        transport = serial.SerialTransport("board", BAUD)
        for i in range(6):
            heartbeat = Heartbeat(i > 2, i)
            board.command = JointCommand(at_rest, heartbeat, self.clock.now_s)
            board.cycle(transport)
            self.clock.advance(PERIOD_S)
        return Refusal(self.telemetry.refusal)

    def watch(self) -> None:
        """Reset the record of pulse widths."""
        self.widest_us = 0.0

    @property
    def obeys(self) -> bool:
        """Whether the node obeys a motion command."""
        supervisor = self.supervisor
        command = supervisor.command if supervisor.mode == Mode.DRIVING else None
        return command is not None and bool(command.twist.any())

    @property
    def wheels_off(self) -> bool:
        """Whether every speed controller gets zero throttle."""
        return max(self.firmware.pulses_us()) <= ZERO_US

    @property
    def goals(self) -> Array:
        """(6,): goals of the servos, steps from neutral."""
        goals = self.chain.goals() if self.chain else [s.goal for s in self.firmware.servos]
        return np.array(goals) - 2048

    @property
    def servos(self) -> list[Mx64]:
        """Simulated servos that turn the gimbals."""
        return self.chain.servos if self.chain else self.firmware.servos
