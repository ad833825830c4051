"""Wheels with motor controllers on CAN: `RobotIO` for omni robots, and the wheels of gimbals.

The only module that imports python-can, which is licensed under the LGPL and an extra.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import can
import numpy as np

from tsd_twin.hardware.drive_latch import BatteryWatch, DriveLatch, WheelFollowing
from tsd_twin.hardware.joints import JointCommand, MotorControllers
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.motors.base import Frame, Motors, MotorState
from tsd_twin.hardware.motors.moteus import MoteusMotors
from tsd_twin.hardware.motors.vesc import LEAST_ERPM, VescMotors
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.hardware.wheel_bus import HOT_MARGIN_C
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence
from tsd_twin.robots import (
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    description_of_kind,
)
from tsd_twin.safety import Heartbeat

_LOG = logging.getLogger(__name__)
GONE = (can.CanError, OSError, ValueError)
_IDLE_S = 0.02
_COLLECT_S = 0.004
"""Time in which replies to a cycle are awaited; later ones count for the next."""
_CONNECT_S = 2.0
_LEAVE_S = 2.0
_PAUSE_S = 0.1
"""Pause of this program after which the controllers' watchdogs may have expired."""


def motors_of(controllers: MotorControllers) -> Motors:
    """Return the motor controllers in a calibration."""
    ids, signs = controllers.ids, controllers.signs
    if controllers.kind == "vesc":
        return VescMotors(ids, controllers.pole_pairs, signs)
    return MoteusMotors(ids, signs)


def open_bus(address: str, *, fd: bool) -> can.BusABC:
    """Open a CAN bus given as `interface:channel`, such as `socketcan:can0`.

    Raises:
        HardwareError: If it cannot be opened.
    """
    interface, _, channel = address.partition(":")
    try:
        return can.Bus(interface=interface, channel=channel, fd=fd)
    except (*GONE, ImportError) as error:
        raise HardwareError(f"the CAN bus {address} cannot be opened: {error}") from error


class CanWheelsIO:
    """`RobotIO` for omni robots with motor controllers on CAN; the wheels of other robots.

    An I/O thread exchanges data. Motors are off unless an armed command is fresh and nothing is
    wrong; a VESC whose time-out does not latch therefore gets no speed until the next arming.
    """

    def __init__(
        self,
        robot: RobotDescription,
        address: str,
        controllers: MotorControllers,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Connect, stop all motors, and check their time-outs.

        Raises:
            HardwareError: If the bus cannot be opened, or a controller does not answer or must not
                be armed.
        """
        joints = robot.kinematics().joints
        self._wheels = [i for i, it in enumerate(joints) if it.kind is JointKind.VELOCITY]
        self.names = [joints[i].name for i in self._wheels]
        if len(controllers.ids) != len(self.names):
            raise HardwareError(
                f"{robot.name} has {len(self.names)} wheels, and the calibration "
                f"{len(controllers.ids)} motor controllers"
            )
        top_rad_per_s = _top_speed(robot)
        _check_least_speed(robot, controllers)
        self._heartbeat = Heartbeat(False, 0)
        self.command = JointCommand(np.zeros(len(joints)), self._heartbeat, 0.0)
        self.trouble: Reason | None = because(Code.WHEELS_SILENT, wheels=", ".join(self.names))
        self.motors = motors_of(controllers)
        self._spins = isinstance(robot, SingularityDescription)
        self._hot_c = robot.servo_limit_c - HOT_MARGIN_C
        self._latch = DriveLatch()
        self._following = WheelFollowing(self.names, top_rad_per_s)
        self._battery = BatteryWatch(robot.battery.arm_v, robot.battery.stop_v)
        self._clock, self._cycled_s = clock, -math.inf
        self._read_s = 0.0
        self._lost_bus = ""
        self._kind = controllers.kind
        self._warn_v = robot.battery.warn_v
        self._bus = open_bus(address, fd=self._kind == "moteus")
        self._stopping, self._requested = threading.Event(), threading.Event()
        try:
            self._connect()
        except HardwareError:
            self._bus.shutdown()
            raise
        self._thread = threading.Thread(target=self._run, name="CAN", daemon=True)
        self._thread.start()

    @property
    def states(self) -> list[MotorState]:
        """Latest measurements of the motor controllers."""
        return self.motors.states

    @property
    def lost(self) -> Reason | None:
        """Reason why wheels do not turn although the robot is armed, or None."""
        return self._latch.lost

    def read(self, now_s: float) -> Array | None:
        """Return newly measured wheel speeds (n,), NaN where unmeasured; None without any."""
        newest_s = max(it.heard_s for it in self.states)
        if newest_s <= self._read_s or now_s - newest_s > SILENT_S:
            return None
        self._read_s = newest_s
        return self.speeds(now_s)

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass the latest setpoint (n,) to the I/O thread.

        Raises:
            ValueError: If the setpoint has the wrong shape or a value is not finite.
        """
        count = len(self.command.setpoint)
        self.command = JointCommand.checked(setpoint, count, self._heartbeat, now_s)
        self.cycle()

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat to send with the next setpoint."""
        self._heartbeat = heartbeat

    def cycle(self) -> None:
        """Request a cycle now, without waiting for it."""
        self._requested.set()

    def speeds(self, now_s: float) -> Array:
        """Return the wheel speeds, rad/s; NaN where there is no recent measurement."""
        fresh = [
            it.speed_rad_per_s if now_s - it.heard_s <= SILENT_S else math.nan for it in self.states
        ]
        return np.array(fresh)

    def fault(self, now_s: float) -> Reason | None:
        """Return the fault of the bus or a controller, or None."""
        if self._lost_bus:
            text = self._lost_bus
            return because(Code.DEVICE_DISCONNECTED, device="can_bus", text=text)
        if now_s - self._cycled_s > SILENT_S:
            return because(Code.DEVICE_SILENT, device="can_bus", ms=1000.0 * SILENT_S)
        return self.trouble or self._latch.lost

    def hardware(self) -> dict[str, Any]:
        """Return the hardware section of the status, JSON-serializable."""
        now_s = time.monotonic()
        volts = self.battery_v(now_s)
        low = volts is not None and volts < self._warn_v
        return {
            "kind": self._kind,
            "connected": not self.fault(now_s),
            "battery_v": volts,
            "wheels": self._status(now_s),
            "warnings": [sentence(because(Code.BATTERY_LOW, volts=self._warn_v))] if low else [],
        }

    def _status(self, now_s: float) -> dict[str, Any]:

        def shown(values: Sequence[float]) -> list[float | None]:
            return [None if math.isnan(value) else round(value, 2) for value in values]

        states = self.states
        return {
            "alive": [now_s - it.heard_s <= SILENT_S for it in states],
            "rpm": shown([it.speed_rad_per_s * 30.0 / math.pi for it in states]),
            "current_a": shown([it.current_a for it in states]),
            "voltage_v": shown([it.voltage_v for it in states]),
            "temperature_c": shown([it.temperature_c for it in states]),
            "timeout_ms": shown([1000.0 * it.timeout_s for it in states]),
        }

    def battery_v(self, now_s: float) -> float | None:  # noqa: ARG002  Part of the interface.
        """Return the highest voltage that a controller measures, or None if unknown."""
        return _most(it.voltage_v for it in self.states)

    def servo_c(self, now_s: float) -> float | None:  # noqa: ARG002  Part of the interface.
        """Return the temperature of the hottest controller, or None if unknown."""
        return _most(it.temperature_c for it in self.states)

    def close(self) -> None:
        """Stop the motors and close the bus."""
        self._stopping.set()
        self._requested.set()
        self._thread.join(_LEAVE_S)

    def _connect(self) -> None:
        """Stop all motors, and ask until all controllers have answered."""
        end_s = self._clock() + _CONNECT_S
        problems = [(0, "it does not answer")]
        while problems and self._clock() < end_s:
            self._send([*self.motors.stop(armed=False), *self.motors.questions()])
            self._collect(5.0 * _COLLECT_S)
            problems = [(i, text) for i in range(len(self.names)) if (text := self._problem(i))]
        if problems:
            i, text = problems[0]
            raise HardwareError(f"motor controller of {self.names[i]}: {text}")

    def _problem(self, i: int) -> str:
        if text := self.motors.problem(i):
            return text
        return "" if self.states[i].heard_s > -math.inf else "it sends no status"

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._requested.wait(_IDLE_S)
            self._requested.clear()
            try:
                self.step()
                self._lost_bus = ""
            except GONE as error:
                self._lose_bus(str(error))
        with contextlib.suppress(*GONE):
            for _ in range(3):
                self._send(self.motors.stop(armed=False))
            self._bus.shutdown()

    def _lose_bus(self, text: str) -> None:
        if not self._lost_bus:
            _LOG.warning("the CAN bus is lost: %s", text)
        self._lost_bus = text or "it is gone"
        self._latch.lock(because(Code.DEVICE_DISCONNECTED, device="can_bus", text=self._lost_bus))

    def step(self) -> None:
        """Run one cycle on the I/O thread: check, send the command and collect measurements.

        Raises:
            can.CanError, OSError, ValueError: If the bus is lost.
        """
        now_s = self._clock()
        command = self.command
        if now_s - self._cycled_s > _PAUSE_S:
            self._latch.lose(because(Code.WHEEL_TIMED_OUT, wheels=", ".join(self.names)))
        self.trouble = self._trouble(command, now_s)
        armed = command.heartbeat.armed
        if self._latch.step(command, self.trouble, now_s):
            self._send(self.motors.drive(command.setpoint[self._wheels].tolist()))
        else:
            self._send(self.motors.stop(armed=armed))
        self._collect(_COLLECT_S)
        self._cycled_s = self._clock()

    def _send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self._bus.send(
                can.Message(
                    arbitration_id=frame.id,
                    data=frame.data,
                    is_extended_id=frame.extended,
                    is_fd=frame.fd,
                    bitrate_switch=frame.fd,
                ),
                timeout=0.01,
            )

    def _collect(self, seconds: float) -> None:
        end_s = self._clock() + seconds
        heard: set[int] = set()
        while len(heard) < len(self.names):
            message = self._bus.recv(max(0.0, end_s - self._clock()))
            if message is None:
                return
            if message.is_error_frame or message.is_remote_frame:
                continue
            before = [it.heard_s for it in self.states]
            frame = Frame(
                message.arbitration_id,
                bytes(message.data),
                extended=message.is_extended_id,
                fd=message.is_fd,
            )
            self.motors.receive(frame, self._clock())
            heard |= {i for i, it in enumerate(self.states) if it.heard_s != before[i]}

    def _trouble(self, command: JointCommand, now_s: float) -> Reason | None:
        """Return why wheels may not turn, or None."""
        states, names = self.states, self.names
        silent = [n for n, it in zip(names, states, strict=True) if now_s - it.heard_s > SILENT_S]
        if silent:
            return because(Code.WHEELS_SILENT, wheels=", ".join(silent))
        for name, state in zip(names, states, strict=True):
            if state.fault:
                return because(Code.WHEEL_FAULT, wheel=name, text=state.fault)
            if state.temperature_c >= self._hot_c:
                text = f"{state.temperature_c:.0f} °C: let it cool"
                return because(Code.WHEEL_FAULT, wheel=name, text=text)
        timed_out = [n for n, it in zip(names, states, strict=True) if it.timed_out]
        if timed_out:
            return because(Code.WHEEL_TIMED_OUT, wheels=", ".join(timed_out))
        armed = command.heartbeat.armed
        volts = self.battery_v(now_s)
        if volts is not None and (low := self._battery.step(volts, now_s, armed=armed)):
            return low
        if not armed or self._spins or self._latch.lost is not None:
            self._following.reset()  # Spinning wheels take seconds, and the estimate watches them.
            return None
        wanted = command.setpoint[self._wheels]
        return self._following.step(wanted, self.speeds(now_s), now_s)


def _most(values: Any) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return max(known) if known else None


def _top_speed(robot: RobotDescription) -> float:
    if isinstance(robot, SingularityDescription):
        return robot.wheel_speed_range.most_rad_per_s
    return description_of_kind(robot, OmniDescription).kinematics().max_speed_rad_per_s


def _check_least_speed(robot: RobotDescription, controllers: MotorControllers) -> None:
    """Check that the robot never asks a VESC for a speed at which it lets its motor go.

    Raises:
        HardwareError: If it may.
    """
    if controllers.kind != "vesc":
        return
    if not isinstance(robot, SingularityDescription):
        raise HardwareError(
            f"{robot.name} has wheels that stand and turn slowly, which a VESC without a sensor "
            f"cannot: below {LEAST_ERPM:.0f} electrical rpm it lets its motor go; use moteus"
        )
    least_rpm = LEAST_ERPM / controllers.pole_pairs
    slowest_rpm = robot.wheel_speed_range.least_rad_per_s * 30.0 / math.pi
    if slowest_rpm < least_rpm:
        raise HardwareError(
            f"{robot.name} may turn its wheels at {slowest_rpm:.0f} rpm, and a VESC lets a motor "
            f"with {controllers.pole_pairs} pole pairs go below {least_rpm:.0f} rpm: raise "
            "motor.start_speed_rpm in the description"
        )
