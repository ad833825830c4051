"""Robot whose servos, MX-64 with Protocol 2.0, are on a U2D2 adapter at the computer; the
controller board drives the motors only.

Registers of the servos: https://emanual.robotis.com/docs/en/dxl/mx/mx-64-2/
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Any

import numpy as np

from tsd_twin.dynamixel import protocol1, protocol2
from tsd_twin.dynamixel.packets import ALERT, Status
from tsd_twin.hardware.device_thread import SILENT_S, DeviceThread
from tsd_twin.hardware.joints import JointCommand, JointConverter, ServoCalibration, ThrottleLaw
from tsd_twin.hardware.mega import BAUD, MegaHardware
from tsd_twin.hardware.serial_transport import HardwareError, LinkHealth, SerialTransport
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.safety import Heartbeat

RETURN_DELAY = 9
"""Units of 2 us between question and answer; 250 as it comes."""
OPERATING_MODE = 11
POSITION_MODE = 3
TORQUE_ENABLE = 64
"""While it is 1, addresses below 64 cannot be written."""
BUS_WATCHDOG = 98
"""Units of 20 ms without a request until the servo stops; 255 then, until 0 is written."""
BUS_WATCHDOG_S = 0.02
GOAL_POSITION = 116
GOAL = Struct("<i")
PRESENT = 126
_LAYOUT = Struct("<hiiiiHB")
PRESENT_SIZE = _LAYOUT.size
_CURRENT_A = 3.36e-3
_VELOCITY_STEP_PER_S = 0.229 / 60.0 * 4096.0


@dataclass(frozen=True, slots=True)
class Present:
    """Measurements of a servo."""

    position: int
    """Steps."""
    velocity_step_per_s: float
    current_a: float
    voltage_v: float
    temperature_c: int

    @staticmethod
    def unpack(data: bytes) -> Present:
        """Return the measurements decoded from the `PRESENT_SIZE` bytes from `PRESENT` on."""
        current, velocity, position, _, _, voltage, temperature = _LAYOUT.unpack(data)
        return Present(
            position,
            velocity * _VELOCITY_STEP_PER_S,
            current * _CURRENT_A,
            voltage / 10.0,
            temperature,
        )


SERVO_BAUD = 1_000_000
ALIVE_S = 0.05
"""A servo that answered within this counts as alive, as it does for the board."""
_ANSWER_S = 0.02
_SERVO_TRY_S = 0.1
"""Response time-out of a servo during configuration."""
_SERVO_TRIES = 3
_WATCHDOG = 10
"""200 ms: less than the board gives the speed controllers."""
_FEED_S = 0.5
"""Period at which the watchdogs are set again, in case one expired during a pause."""


@dataclass(frozen=True, slots=True)
class ServoReport:
    """Newest measurements of the servos, by index from 0."""

    present: Mapping[int, Present]
    heard_s: Mapping[int, float]
    faults: int
    """Mask of those that report a hardware error."""
    newest_s: float

    def alive(self, now_s: float) -> int:
        """Return the mask of servos that answered within `ALIVE_S`."""
        return sum(1 << i for i, at_s in self.heard_s.items() if now_s - at_s <= ALIVE_S)


class ServoBus:
    """Servo bus as the device of a `DeviceThread`.

    Other threads write `order` and read `news` and `gone`. Servo i + 1 is gimbal i. When this
    program dies, the servos hold their position; the board stops the robot by shutting off the
    wheels.
    """

    name = "the servo bus"
    baud = SERVO_BAUD

    def __init__(self, joints: JointConverter, calibration: ServoCalibration) -> None:
        self.health = LinkHealth("the serial line of the servos")
        self.order = JointCommand(np.zeros(joints.count), Heartbeat(False, 0), 0.0)
        self.news: ServoReport | None = None
        self.gone = ""
        """Reason of a lost connection; else empty."""
        self._joints = joints
        self._ids = range(1, len(joints.names) + 1)
        self._neutral = calibration.neutral(joints.names)
        self._signs = calibration.signs(joints.names)
        self._rest = np.zeros(joints.count)
        self._fed_s = 0.0

    def connect(self, line: SerialTransport) -> None:
        """Find all servos, and configure those that need it.

        Raises:
            HardwareError: one does not answer, or speaks Protocol 1.0; the text names it.
        """
        for device in self._ids:
            self._find(line, device)
            self._set_up(line, device)
        self._fed_s = 0.0
        self.gone = ""

    def cycle(self, line: SerialTransport) -> bool:
        """Write goals and read measurements in one exchange; return whether all servos answered.

        Raises:
            HardwareError: the port is gone.
        """
        began_s, broken = time.monotonic(), line.broken
        order = self.order
        request = b""
        if began_s - self._fed_s > _FEED_S:
            self._fed_s = began_s
            request += self._all(BUS_WATCHDOG, [b"\x00"] * len(self._ids))
            request += self._all(BUS_WATCHDOG, [bytes([_WATCHDOG])] * len(self._ids))
        request += self._goals(order.setpoint if order.in_force(began_s) else self._rest)
        request += protocol2.sync_read(self._ids, PRESENT, PRESENT_SIZE)
        answers = line.request(request, len(self._ids), _ANSWER_S)
        now_s = time.monotonic()
        self._take(answers, now_s)
        self.health.noise.note(line.broken > broken, now_s)
        if len(answers) < len(self._ids):
            self.health.miss()
        else:
            self.health.note(now_s - began_s)
        return bool(answers)

    def lose(self, reason: str) -> None:
        """Record that the connection to the adapter is lost."""
        self.news, self.gone = None, reason
        self.health.reconnects += 1

    def leave(self, line: SerialTransport) -> None:
        """Send the gimbals to neutral; the servos hold it."""
        off = self._all(BUS_WATCHDOG, [b"\x00"] * len(self._ids))
        line.request(off + self._goals(self._rest), 0, 0.0)

    def measured(self, news: ServoReport) -> list[int]:
        """Return steps from neutral, as the joints are drawn; 0 where nothing was measured."""
        return [
            sign * (news.present[i].position - neutral) if i in news.present else 0
            for i, (sign, neutral) in enumerate(zip(self._signs, self._neutral, strict=True))
        ]

    def _take(self, answers: list[Status], now_s: float) -> None:
        before = self.news or ServoReport({}, {}, 0, now_s)
        whole = [a for a in answers if a.id in self._ids and len(a.data) == PRESENT_SIZE]
        if whole:
            faults = before.faults
            for answer in whole:
                bit = 1 << answer.id - 1
                faults = faults | bit if answer.error & ALERT else faults & ~bit
            present = {a.id - 1: Present.unpack(a.data) for a in whole}
            heard_s = dict.fromkeys(present, now_s)
            self.news = ServoReport(
                {**before.present, **present}, {**before.heard_s, **heard_s}, faults, now_s
            )

    def _goals(self, setpoint: np.ndarray) -> bytes:
        goals = self._joints.goals(setpoint)
        steps = [
            GOAL.pack(neutral + sign * goal)
            for neutral, sign, goal in zip(self._neutral, self._signs, goals, strict=True)
        ]
        return self._all(GOAL_POSITION, steps)

    def _all(self, address: int, data: list[bytes]) -> bytes:
        return protocol2.sync_write(address, dict(zip(self._ids, data, strict=True)))

    def _find(self, line: SerialTransport, device: int) -> None:
        for _ in range(_SERVO_TRIES):
            if line.request(protocol2.ping(device), 1, _SERVO_TRY_S):
                return
        servo = self._joints.named(1 << device - 1)
        if line.request(protocol1.ping(device), 1, _SERVO_TRY_S, protocol1):
            raise HardwareError(
                f"{servo} speaks Protocol 1.0: bring its firmware to 2.0 with the recovery of "
                "Dynamixel Wizard 2.0, or connect the servos to the board, which speaks both"
            )
        raise HardwareError(
            f"{servo} does not answer at {line.name} at {self.baud} Bd: "
            "has it power, this id and this rate?"
        )

    def _set_up(self, line: SerialTransport, device: int) -> None:
        wanted = {OPERATING_MODE: POSITION_MODE, RETURN_DELAY: 0}
        other = {
            address: value
            for address, value in wanted.items()
            if self._ask(line, device, protocol2.read(device, address, 1)).data != bytes([value])
        }
        if other:  # Only then: a servo without torque lets go of its gimbal.
            self._write(line, device, TORQUE_ENABLE, 0)
            for address, value in other.items():
                self._write(line, device, address, value)
        self._write(line, device, BUS_WATCHDOG, 0)
        self._write(line, device, TORQUE_ENABLE, 1)

    def _write(self, line: SerialTransport, device: int, address: int, value: int) -> None:
        self._ask(line, device, protocol2.write(device, address, bytes([value])))

    def _ask(self, line: SerialTransport, device: int, request: bytes) -> Status:
        for _ in range(_SERVO_TRIES):
            for answer in line.request(request, 1, _SERVO_TRY_S):
                if answer.error & ~ALERT:
                    raise HardwareError(
                        f"{self._joints.named(1 << device - 1)} refuses its set-up: "
                        f"error {answer.error & ~ALERT}"
                    )
                return answer
        raise HardwareError(f"{self._joints.named(1 << device - 1)} fell silent")


class U2D2Hardware:
    """Hardware interface of a robot on two serial lines: a `RobotIO` with a command watchdog."""

    def __init__(
        self,
        robot: SingularityDescription,
        board_port: str,
        servo_port: str,
        throttle: ThrottleLaw,
        calibration: ServoCalibration | None = None,
        *,
        baud: int = BAUD,
    ) -> None:
        """Connect to the board at `board_port` and the servos at `servo_port`.

        Raises:
            HardwareError: a device is missing, of another kind, or does not answer.
        """
        calibration = calibration or ServoCalibration()
        self._joints = JointConverter(robot, throttle)
        self._wheels = MegaHardware(
            robot, board_port, throttle, calibration, servos=False, baud=baud
        )
        self._bus = ServoBus(self._joints, calibration)
        self._heartbeat = Heartbeat(False, 0)
        self._read_s = 0.0
        try:
            self._keeper = DeviceThread(servo_port, self._bus)
        except Exception:
            self._wheels.close()
            raise

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,), NaN where not measured; None without a new
        measurement.
        """
        news = self._bus.news
        if news is None or news.newest_s <= self._read_s or now_s - news.newest_s > SILENT_S:
            return None
        self._read_s = news.newest_s
        return self._joints.measured(self._bus.measured(news), news.alive(now_s))

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass the newest set-point (n,) to both I/O threads.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        self._wheels.write(setpoint, now_s)
        self._bus.order = JointCommand(self._joints.checked(setpoint), self._heartbeat, now_s)
        self._keeper.cycle()

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat under which the next set-point is sent."""
        self._heartbeat = heartbeat
        self._wheels.set_heartbeat(heartbeat)

    def fault(self, now_s: float) -> str:
        """Return the fault of the board, the servos or the lines; empty without one."""
        return self._wheels.fault(now_s) or self._servo_fault(now_s)

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status, JSON-serializable."""
        facts = self._wheels.hardware() | {"kind": "u2d2"}
        news = self._bus.news
        if news is not None:
            facts["servos"] = self._facts(news)
        return facts | {"servo_link": self._bus.health.status()}

    def close(self) -> None:
        """Shut off the wheels first, then send the gimbals to neutral."""
        self._wheels.close()
        self._keeper.close()

    def _servo_fault(self, now_s: float) -> str:
        news = self._bus.news
        if news is None:
            return f"the servos are not connected: {self._bus.gone}"
        noise = self._bus.health.noise
        if noise.fault:
            return noise.fault
        if now_s - news.newest_s > SILENT_S:
            return noise.suspicion or f"the servos have not answered for {SILENT_S * 1000:.0f} ms"
        if dead := self._joints.servos & ~news.alive(now_s):
            return f"{self._joints.named(dead)}: no answer"
        if news.faults:
            return f"{self._joints.named(news.faults)}: hardware error"
        return ""

    def _facts(self, news: ServoReport) -> dict[str, Any]:
        alive = news.alive(time.monotonic())
        present = [news.present[i] for i in sorted(news.present)]
        return {
            "alive": [bool(alive >> i & 1) for i in range(len(self._joints.names))],
            "voltage_v": [round(p.voltage_v, 1) for p in present],
            "temperature_c": [p.temperature_c for p in present],
            "current_a": [round(p.current_a, 2) for p in present],
        }
