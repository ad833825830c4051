"""Simulated machines with wiring errors, in virtual time, and a person who tends them."""

from __future__ import annotations

import math
import re
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace

import can
import pytest
import serial

from tests.support.can_motors import Motor, MotorBus
from tests.support.pty_devices import PretendBoard, ServoChain
from tests.support.virtual_robot import TurnTaking, VirtualPort
from tests.support.virtual_time import VirtualClock
from tests.support.x_series import XServo
from tsd_twin.hardware import (
    arduino_mega,
    can_wheels,
    dynamixel_wheels,
    serial_transport,
    u2d2,
    wheel_bus,
)
from tsd_twin.hardware.dynamixel.control_table import (
    ZERO_THROTTLE,
    BoardCommand,
    ResetCause,
    Wheels,
)

PUSH_STEPS = 12
BATTERY_V = 12.0
MEASURED = {
    "Resistance from + to -": "8000",
    "at the fuse holder": "12.4",
    "diode test": "0.6",
    "precharge button": "15",
    "board's 5 V wire off": "5.05",
    "board's 5 V pin": "0",
    "are all lights": "y",
    "Mean voltage at D15": "4.9",
    "CAN high": "60",
    "Voltage of the battery": "12.0",
    "Pull the fuse": "y",
    "beep once for zero": "y",
    "press and release the stop: did": "y",
    "Press the stop: did": "y",
    "do all controllers have power": "y",
}
"""Answers at a machine without errors, by part of the question."""


Answer = Callable[[bytes, float], bytes]
_IDLE_S, _EXCHANGE_S = 0.02, 0.002
_ASKED_S = 1.0


class Bench:
    """Devices in virtual time, at which the program takes its turns."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.clock = VirtualClock(patch)
        self.ports: dict[str, Answer] = {}
        self.motors: VirtualMotors | None = None
        bench = self

        class Turns(TurnTaking):
            """Device that also idles while the program waits for a person."""

            def __init__(self, port: str, device: serial_transport.Device) -> None:
                super().__init__(port, device)
                bench.idle.append(self.cycle)

            def cycle(self) -> None:
                super().cycle()
                bench.cycled_s = bench.clock.now_s

            def close(self) -> None:
                if self.cycle in bench.idle:
                    bench.idle.remove(self.cycle)
                    super().close()

        self.idle: list[Callable[[], object]] = []
        self.cycled_s = self.clock.now_s
        """End of the latest cycle of a serial device."""
        self.most_driven = 0
        """Most wheels that were driven at once."""
        patch.setattr(serial_transport, "open_port", self._open)
        for module in (arduino_mega, dynamixel_wheels, u2d2):
            patch.setattr(module, "DeviceThread", Turns)
        patch.setattr(can_wheels, "open_bus", lambda *_, **__: self.motors)
        # Their default is the real clock.
        for made in (can_wheels.CanWheelsIO, wheel_bus.WheelBus):
            patch.setattr(made.__init__, "__defaults__", (lambda: self.clock.now_s,))
        patch.setattr(can_wheels.CanWheelsIO, "cycle", can_wheels.CanWheelsIO.step)
        turn = partial(_CanTurn, self.idle)
        patch.setattr(can_wheels, "threading", SimpleNamespace(Event=threading.Event, Thread=turn))

    def _open(self, name: str, _baud: int, timeout_s: float) -> VirtualPort:
        answers: deque[bytes] = deque()
        answer = self.ports.get(name)
        if answer is None:
            raise serial_transport.HardwareError(f"{name} is not there")

        def check() -> None:
            if self.ports.get(name) is not answer:
                raise serial.SerialException("unplugged")

        def send(data: bytes) -> None:
            check()
            answers.append(answer(data, self.clock.now_s))

        def receive() -> bytes:
            check()
            return b"".join(answers.popleft() for _ in range(len(answers)))

        return VirtualPort(self.clock, timeout_s, send, receive)

    def plug_in(self, name: str, answer: Answer) -> None:
        """Connect a device under a name; a port that was opened before stays dead."""
        self.ports[name] = partial(answer)

    def unplug(self, name: str) -> None:
        """Remove a device."""
        self.ports.pop(name, None)

    def watch(self, wheels: Sequence[WatchedMotor | WatchedServo]) -> None:
        """Count how many wheels are driven at once."""

        def count(_now_s: float) -> None:
            self.most_driven = max(self.most_driven, sum(wheel.driven for wheel in wheels))

        self.clock.machines.append(count)

    def think(self) -> None:
        """Let the time pass in which a person reads, acts and answers."""
        self.idle_for(_ASKED_S)

    def idle_for(self, seconds: float) -> None:
        """Let the I/O threads run alone."""
        end_s = self.clock.now_s + seconds
        while self.clock.now_s < end_s:
            for cycle in self.idle:
                cycle()
            self.clock.advance(_IDLE_S)


class Wires(Bench):
    """Devices in virtual time, whose I/O threads run while a test sleeps."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        super().__init__(patch)
        self._is_cycling = False
        self.clock.wait = self._wait

    def plug_in(self, name: str, answer: Answer) -> None:
        """Connect a device, which answers after the time that a line takes."""

        def late(data: bytes, _now_s: float) -> bytes:
            self.clock.advance(_EXCHANGE_S)
            return answer(data, self.clock.now_s)

        super().plug_in(name, late)

    def _wait(self, seconds: float) -> None:
        self.clock.advance(seconds)
        if self._is_cycling or self.clock.now_s < self.cycled_s + _IDLE_S:
            return
        self._is_cycling = True
        for cycle in list(self.idle):
            cycle()
        self._is_cycling = False


class _CanTurn:
    """I/O thread of CAN, in turn with the program."""

    def __init__(
        self, idle: list[Callable[[], object]], target: Callable[[], None], **_: object
    ) -> None:
        self._idle, self._target = idle, target
        self._cycle: Callable[[], object] = target.__self__.step

    def start(self) -> None:
        self._idle.append(self._cycle)

    def join(self, _timeout_s: float) -> None:
        self._idle.remove(self._cycle)
        self._target()


class VirtualMotors(MotorBus):
    """Controllers on a CAN bus in virtual time, and the bus as the program sees it."""

    def __init__(self, clock: VirtualClock, motors: Sequence[Motor]) -> None:
        self.motors = list(motors)
        self._fd = self.motors[0].kind == "moteus"
        self.off_s = self._since_s = 0.0
        self._lived_s = clock.now_s
        self._clock = clock
        self._waiting: deque[can.Message] = deque()
        clock.machines.append(lambda now_s: self.step(None, now_s))

    def _send(self, identifier: int, data: bytes) -> None:
        self._waiting.append(can.Message(arbitration_id=identifier, data=data, is_fd=self._fd))

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        """Deliver a message of the program; `timeout` as in python-can."""
        del timeout
        self.step(message, self._clock.now_s)

    def recv(self, timeout: float) -> can.Message | None:
        """Return the next message, or None after the timeout."""
        if not self._waiting:
            self._clock.advance(max(timeout, 1e-6))
        return self._waiting.popleft() if self._waiting else None

    def shutdown(self) -> None:
        """End nothing, because no thread runs."""


class WiredMega(PretendBoard):
    """Board at a machine whose wires may be wrong."""

    def __init__(self) -> None:
        super().__init__()
        self.closed = self.welded = self.a1_upstream = False
        self.recloses = self.ineffective_stop = self.no_seal_in = False
        self.drive_fuse = True
        self.divider = 1.0
        self.servo_order = list(range(6))
        self.servo_signs = [1] * 6
        self.esc_order = [0, 1, 2]
        self.esc_signs = [1, 1, 1]
        self.speed_factor = 1.0
        self.sensor_rpm = 0.0
        """Speed of a turning wheel; 0 without wheel sensors."""
        self.sensor_wheels: list[int | None] = [0, 1, 2]
        """Wheel at each sensor input."""
        self.hand_turned: int | None = None
        self.noise = 0
        """Servo errors for each telemetry."""
        self.pushed: int | None = None
        """Gimbal that a hand deflects."""
        self.agreed = False
        self.moved_unasked = False
        self.throttles = [ZERO_THROTTLE] * 3
        """Largest throttles since they were last read."""
        self.report(
            supply_mv=5000,
            voltage=(120,) * 6,
            temperature=(30,) * 6,
            rc=(1500, 1500, 1500, 1100, 1900, 1100),
        )

    def start(self) -> None:
        self.closed = self.drive_fuse and not self.no_seal_in

    def stop(self) -> None:
        self.closed = self.closed and (self.recloses or self.ineffective_stop)

    def _write(self, address: int, data: bytes) -> None:
        super()._write(address, data)
        if address == BoardCommand.ADDRESS:
            command = BoardCommand.unpack(data)
            moves = bool(command.arm == 1 or any(command.goal))
            self.moved_unasked |= moves and not self.agreed
            if command.arm == 1:
                pairs = zip(self.throttles, command.throttle, strict=True)
                self.throttles = [max(pair) for pair in pairs]

    def _refresh(self) -> None:
        goal = self.commands[-1].goal if self.commands else (0,) * 6
        position = list(goal)
        if self.pushed is not None:
            i = self.pushed
            position[self.servo_order[i]] += self.servo_signs[i] * PUSH_STEPS
        power = self.closed or self.welded or self.a1_upstream
        drive_mv = round(1000 * BATTERY_V) if power else 100
        self.report(
            position=tuple(position),
            drive_mv=drive_mv,
            drive_on=int(power),
            battery_mv=round(1000 * BATTERY_V * self.divider),
            servo_errors=self.telemetry.servo_errors + self.noise,
        )
        self._measure_wheels()
        super()._refresh()

    def _measure_wheels(self) -> None:
        """Measure wheels that turn by their motors, or by hand."""
        turns = [False] * 3
        if self.commands and self.commands[-1].arm == 1:
            for esc, throttle in zip(self.esc_order, self.commands[-1].throttle, strict=True):
                turns[esc] = throttle > ZERO_THROTTLE
        rpm = [self.sensor_rpm * self.speed_factor * turns[i] for i in range(3)]
        if self.hand_turned is not None:
            rpm[self.hand_turned] = 60.0
        seen = [
            round(rpm[i]) if i is not None and self.sensor_rpm else 0 for i in self.sensor_wheels
        ]
        measured = self.wheels.wheel_measured | sum(1 << i for i, it in enumerate(seen) if it)
        ages = tuple(5 if it else 255 for it in seen)
        self.wheels = Wheels(measured, tuple(seen), ages)

    def turned(self) -> tuple[int, bool]:
        """Return the wheel that turned, from 1, and whether along its arrow."""
        esc = max(range(3), key=lambda i: self.throttles[i])
        self.throttles = [ZERO_THROTTLE] * 3
        return self.esc_order[esc] + 1, self.esc_signs[esc] > 0

    def young(self) -> None:
        """Be reset by the opened port."""
        self.report(millis=1000, reset_cause=int(ResetCause.EXTERNAL), battery_mv=12000)


@dataclass
class WatchedMotor(Motor):
    """Motor on CAN whose largest speed a person sees."""

    peak_hz: float = 0.0

    def live(self, seconds: float, now_s: float) -> None:
        super().live(seconds, now_s)
        if abs(self.speed_hz) > abs(self.peak_hz):
            self.peak_hz = self.speed_hz


@dataclass
class WatchedServo(XServo):
    """Wheel servo whose largest speed a person sees."""

    peak_hz: float = 0.0

    def live(self, seconds: float, silent_s: float) -> None:
        super().live(seconds, silent_s)
        speed_hz = self.speed_rad_per_s / (2.0 * math.pi)
        if abs(speed_hz) > abs(self.peak_hz):
            self.peak_hz = speed_hz


@dataclass
class Person:
    """Person at the machine, who answers truthfully."""

    bench: Bench
    answers: dict[str, str] = field(default_factory=dict[str, str])
    """Answers that differ from `MEASURED`, because of an error that only a person can see."""
    mega: WiredMega | None = None
    chain: ServoChain | None = None
    push_sign: int = 1
    """-1 for servos that are mounted the other way round."""
    wheels: Sequence[WatchedMotor | WatchedServo] = ()
    """Motors in the order of the wheels at which they are mounted."""
    wheel_signs: Sequence[int] = (1, 1, 1)
    rpm: float = 0.0
    """Speed that the wheels of a board must have."""
    shown: list[str] = field(default_factory=list[str])
    interrupt: Callable[[str], None] | None = None
    _wheel: int = 0

    def ask(self, question: str) -> str:
        self.shown.append(question)
        self.bench.think()
        if self.interrupt is not None:
            self.interrupt(question)
        if self.mega is not None:
            self.mega.agreed = "start? [y/n]" in question or "Connect?" in question

        for part in (*self.answers, *MEASURED):
            if part in question:
                return self.answers[part] if part in self.answers else MEASURED[part]
        self._act(question)
        return self._look(question)

    def _act(self, question: str) -> None:
        if self.chain is not None:
            self._push(question, self.chain)
        if self.mega is None:
            return
        if "press and release start" in question or "Start again" in question:
            self.mega.start()
        elif "Press and release the hard-wired stop" in question:
            self.mega.stop()
        gimbal = _gimbal(question)
        self.mega.pushed = gimbal if "by hand in its" in question else None
        by_hand = re.search(r"turn wheel (\d).* by hand", question)
        self.mega.hand_turned = int(by_hand[1]) - 1 if by_hand else None

    def _push(self, question: str, chain: ServoChain) -> None:
        for i, servo in enumerate(chain.servos):
            if servo.jammed:
                servo.jammed = False
                chain.angles[i] = 0.0
        gimbal = _gimbal(question)
        if "by hand in its" in question and gimbal is not None:
            chain.servos[gimbal].jammed = True
            chain.angles[gimbal] = self.push_sign * PUSH_STEPS * 2.0 * math.pi / 4096.0

    def _look(self, question: str) -> str:
        if "Number of the wheel" in question:
            self._wheel, along = self._turned()
            self._along = along
            return str(self._wheel)
        if "direction of its arrow" in question:
            return "y" if self._along else "n"
        if "tachometer" in question:
            return f"{self._speed_rpm:.0f}"
        return "y"

    def _turned(self) -> tuple[int, bool]:
        if self.mega is not None:
            self._speed_rpm = self.rpm * self.mega.speed_factor
            return self.mega.turned()
        i = max(range(len(self.wheels)), key=lambda i: abs(self.wheels[i].peak_hz))
        peak_hz = self.wheels[i].peak_hz
        self._speed_rpm = 60.0 * abs(peak_hz)
        for wheel in self.wheels:
            wheel.peak_hz = 0.0
        return i + 1, self.wheel_signs[i] * peak_hz > 0.0


def _gimbal(question: str) -> int | None:
    names = [f"module{m}_{angle}" for m in (1, 2, 3) for angle in ("alpha", "beta")]
    return next((i for i, name in enumerate(names) if name in question), None)
