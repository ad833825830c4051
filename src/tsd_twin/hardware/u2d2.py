"""Robot with MX-64 servos (Protocol 2.0) on a U2D2 adapter; the controller board drives only the
motors.

Registers of the servos: https://emanual.robotis.com/docs/en/dxl/mx/mx-64-2/
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from struct import Struct
from typing import Any, Protocol

import numpy as np

from tsd_twin.hardware.approach import Approach
from tsd_twin.hardware.cables import CableMonitor, branches_of
from tsd_twin.hardware.dynamixel.packets import StatusPacket, protocol2
from tsd_twin.hardware.dynamixel.servo_models import MODELS, ServoModel
from tsd_twin.hardware.joints import (
    JointCommand,
    JointConverter,
    ServoCalibration,
    ThrottleLaw,
    hot_servos,
)
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.robot_io import HasBattery, HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import DeviceThread, SerialTransport
from tsd_twin.hardware.servo_line import (
    ANSWER_S,
    BUS_WATCHDOG,
    RETURN_DELAY,
    TORQUE_ENABLE,
    WATCHDOG,
    ServoExchange,
    ServoLine,
    ServoMeasurement,
    ServoReport,
)
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.robots import SingularityDescription
from tsd_twin.safety import Heartbeat

_LOG = logging.getLogger(__name__)
GOAL_POSITION = 116
GOAL = Struct("<i")
POSITION = 132
_OTHER_PROTOCOL = (
    "bring its firmware to 2.0 with the recovery of Dynamixel Wizard 2.0, or connect the servos to "
    "the board, which speaks both"
)
_TORQUE_CYCLES = 4
"""Cycles between two torque checks of all servos."""
_FEED_S = 0.5
"""Period at which the watchdogs are set again, in case one expired during a pause."""


class ServoBus(ServoExchange):
    """Servo bus as the device of a `DeviceThread`.

    Other threads write `command` and read `report`. If this program dies, the servos hold their
    position, and the board stops the robot by shutting off the wheels.
    """

    def __init__(self, joints: JointConverter, calibration: ServoCalibration) -> None:
        self._ids = calibration.ids(joints.names)
        line = ServoLine(self._ids, joints.names, MODELS, _OTHER_PROTOCOL)
        super().__init__(line, CableMonitor(joints, branches_of(joints)), lambda: time.monotonic())
        self.command = JointCommand(np.zeros(joints.count), Heartbeat(False, 0), 0.0)
        self.report: ServoReport | None = None
        self._joints = joints
        self._neutral = calibration.neutral(joints.names)
        self._signs = calibration.signs(joints.names)
        self._rest = np.zeros(joints.count)
        self._models: dict[int, ServoModel] = {}
        """Servo models by index."""
        self._approach = Approach(len(joints.names))
        self._fed_s = 0.0
        self._cycles = 0
        self._armed = False

    @property
    def far(self) -> int:
        """Mask of servos without torque, which have not been near their neutral position yet."""
        return self._approach.far

    def connect(self, transport: SerialTransport) -> None:
        """Find all servos, check their settings, and configure them if needed.

        Raises:
            HardwareError: If a servo does not respond, uses Protocol 1.0, or has a wrong setting;
                the message names it.
        """
        for device in self._ids:
            self._line.find(transport, device)
            model = self._line.check_settings(transport, device)
            self._models[self._ids.index(device)] = model
            self._set_up(transport, device)
        self._fed_s = 0.0

    def cycle(self, transport: SerialTransport) -> bool:
        """Write goals and read measurements in one exchange; return whether any servo responded.

        Raises:
            HardwareError: If the port is gone.
        """
        began_s, command = self._clock(), self.command
        self._armed = command.heartbeat.armed
        request = b""
        if began_s - self._fed_s > _FEED_S:
            self._fed_s = began_s
            request += self._line.to_all(BUS_WATCHDOG, [b"\x00"] * len(self._ids))
            request += self._line.to_all(BUS_WATCHDOG, [bytes([WATCHDOG])] * len(self._ids))
        setpoint = command.setpoint if command.in_force(began_s) else self._rest
        request += self._goals(setpoint, began_s, armed=command.heartbeat.armed)
        return self._exchange(transport, request, began_s)

    def disconnected(self) -> None:
        """Discard the report."""
        self.cables.add_reconnect()
        self.report = None

    def rest(self, transport: SerialTransport) -> None:
        """Send the gimbals to neutral, where the servos hold them."""
        off = self._line.to_all(BUS_WATCHDOG, [b"\x00"] * len(self._ids))
        goals = self._goals(self._rest, time.monotonic(), armed=self.command.heartbeat.armed)
        transport.request(off + goals, 0, 0.0)

    def measured(self, report: ServoReport) -> list[int]:
        """Return steps from neutral, with the joints' signs; 0 if not measured."""
        return [
            self._steps(i, report.present[i].position) if i in report.present else 0
            for i in range(len(self._ids))
        ]

    def current_a(self, i: int, present: ServoMeasurement) -> float:
        """Return the measured current of servo `i`, A."""
        return 1e-3 * self._models[i].current_ma * present.current_units

    def _add_responses(self, answers: Sequence[StatusPacket]) -> None:
        now_s = time.monotonic()
        before = self.report or ServoReport({}, now_s, limp=self.far)
        present, faults = self._line.measured(answers, before.faults, now_s)
        self.cables.add_voltages({i: servo.voltage_v for i, servo in present.items()})
        if present:
            self.report = ServoReport({**before.present, **present}, now_s, faults, before.limp)
        for i, servo in present.items():
            steps = self._steps(i, servo.position)
            self._approach.see(i, steps, holds=not before.limp >> i & 1)

    def _read_state(self, transport: SerialTransport, answered: list[int]) -> None:
        """Check which of the servos that answered have torque; while disarmed, enable it if off."""
        self._cycles += 1
        if self._cycles % _TORQUE_CYCLES != 0 or not answered:
            return
        request = protocol2.sync_read(answered, TORQUE_ENABLE, 1)
        limp = self.report.limp if self.report else 0
        for answer in transport.request(request, len(answered), ANSWER_S):
            if answer.id in answered and len(answer.data) == 1:
                bit = self._line.bit(answer.id)
                limp = limp & ~bit if answer.data[0] else limp | bit
        if self.report is not None:
            lost = limp & ~self.report.limp & self.report.alive(time.monotonic())
            self.cables.add_restarts(lost, time.monotonic())
            self.report = replace(self.report, limp=limp)
        held = limp & ~self.far
        if held and not self._armed:
            on = {device: b"\x01" for device in self._ids if held & self._line.bit(device)}
            transport.request(protocol2.sync_write(TORQUE_ENABLE, on), 0, 0.0)

    def _goals(self, setpoint: np.ndarray, now_s: float, *, armed: bool) -> bytes:
        goals = self._approach.step(self._joints.goals(setpoint), now_s, armed=armed)
        return self._line.to_all(
            GOAL_POSITION, [self._goal(i, steps) for i, steps in enumerate(goals)]
        )

    def _goal(self, i: int, steps: int) -> bytes:
        return GOAL.pack(self._neutral[i] + self._signs[i] * steps)

    def _steps(self, i: int, position: int) -> int:
        """Return steps from neutral, with the sign of the joint."""
        return self._signs[i] * (position - self._neutral[i])

    def _set_up(self, transport: SerialTransport, device: int) -> None:
        if (delay := self._line.read(transport, device, RETURN_DELAY, 1)[0]) != 0:
            # Write only if needed, because a servo without torque does not hold its gimbal.
            servo = self._line.named(device)
            _LOG.warning("servo %s: return delay time is %s, set to 0", servo, delay)
            self._line.write(transport, device, TORQUE_ENABLE, 0)
            self._line.write(transport, device, RETURN_DELAY, 0)
        self._line.write(transport, device, BUS_WATCHDOG, 0)
        self._hold(transport, device)

    def _hold(self, transport: SerialTransport, device: int) -> None:
        """Hold a servo at its position if it is near neutral; otherwise disable its torque."""
        (position,) = GOAL.unpack(self._line.read(transport, device, POSITION, GOAL.size))
        i = self._ids.index(device)
        steps = self._steps(i, position)
        self._approach.see(i, steps, holds=False)
        if self.far >> i & 1:
            self._line.write(transport, device, TORQUE_ENABLE, 0)
            return
        there = protocol2.write(device, GOAL_POSITION, self._goal(i, steps))
        self._line.request(transport, device, there)
        self._line.write(transport, device, TORQUE_ENABLE, 1)


class WheelsIO(RobotIO, HasWatchdog, HasBattery, Protocol):
    """Wheels of a robot: a controller board without servos, or motor controllers on CAN."""

    def fault(self, now_s: float) -> Reason | None:
        """Return the fault of the wheels, or None."""
        ...

    def speeds(self, now_s: float) -> Array | None:
        """Return the measured wheel speeds (k,), rad/s, NaN where unmeasured; None without any."""
        ...

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status."""
        ...


class U2D2IO:
    """`RobotIO` for a robot with servos on a line of the PC, with a command watchdog."""

    def __init__(
        self,
        robot: SingularityDescription,
        wheels: WheelsIO,
        servo_port: str,
        throttle: ThrottleLaw,
        calibration: ServoCalibration | None = None,
    ) -> None:
        """Connect to the servos at `servo_port`; `wheels` are connected, and closed with them.

        Raises:
            HardwareError: If a device is missing, of another kind, or does not respond.
        """
        calibration = calibration or ServoCalibration()
        self._joints = JointConverter(robot, throttle)
        self._wheels = wheels
        self._bus = ServoBus(self._joints, calibration)
        self._heartbeat = Heartbeat(False, 0)
        self._read_s = 0.0
        try:
            self._thread = DeviceThread(servo_port, self._bus)
        except Exception:
            self._wheels.close()
            raise

    def read(self, now_s: float) -> Array | None:
        """Return newly measured joints (n,), NaN where unmeasured; None without a measurement."""
        report = self._bus.report
        if report is None or report.newest_s <= self._read_s or now_s - report.newest_s > SILENT_S:
            return None
        self._read_s = report.newest_s
        speeds = self._wheels.speeds(now_s)
        return self._joints.measured(self._bus.measured(report), report.alive(now_s), speeds)

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass the latest setpoint (n,) to both I/O threads.

        Raises:
            ValueError: If the setpoint has the wrong shape or a value is not finite.
        """
        self._wheels.write(setpoint, now_s)
        self._bus.command = JointCommand.checked(
            setpoint, self._joints.count, self._heartbeat, now_s
        )
        self._thread.cycle()

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat to send with the next setpoint."""
        self._heartbeat = heartbeat
        self._wheels.set_heartbeat(heartbeat)

    def fault(self, now_s: float) -> Reason | None:
        """Return the fault of the board, the servos or the lines, or None."""
        return self._wheels.fault(now_s) or self._servo_fault(now_s)

    def battery_v(self, now_s: float) -> float | None:
        """Return the latest battery voltage, or None if unknown."""
        return self._wheels.battery_v(now_s)

    def servo_c(self, now_s: float) -> float | None:
        """Return the latest temperature of the hottest servo, or None if unknown."""
        report = self._bus.report
        if report is None or now_s - report.newest_s > SILENT_S:
            return None
        return report.hottest_c

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status, JSON-serializable."""
        status = self._wheels.hardware() | {"kind": "u2d2"}
        report = self._bus.report
        if report is not None:
            status["servos"] = self._status(report)
            status["cables"] = self._bus.cables.status()
            status["warnings"] = [*status.get("warnings", []), *self._bus.cables.sentences()]
        return status | {"servo_link": self._bus.health.status()}

    def close(self) -> None:
        """Shut off the wheels first, then send the gimbals to neutral."""
        self._wheels.close()
        self._thread.close()

    def _servo_fault(self, now_s: float) -> Reason | None:
        report = self._bus.report
        fault = self._bus.health.connection_fault(report and report.newest_s, now_s)
        if fault is not None or report is None:
            return fault
        if dead := self._joints.servos & ~report.alive(self._bus.cycled_s):
            return self._joints.silent(dead)
        if report.faults:
            return self._joints.about(report.faults, Code.SERVO_ERROR)
        if hot := hot_servos({i: it.temperature_c for i, it in report.present.items()}):
            return self._joints.hot(hot)
        if far := self._bus.far:
            return self._joints.about(far, Code.SERVO_FAR)
        if report.limp:
            return self._joints.about(report.limp, Code.SERVO_LIMP)
        return None

    def _status(self, report: ServoReport) -> dict[str, Any]:
        there = sorted(report.present)
        amperes = [round(self._bus.current_a(i, report.present[i]), 2) for i in there]
        return report.status(len(self._joints.names), time.monotonic()) | {"current_a": amperes}
