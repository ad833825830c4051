"""Wheels driven by Dynamixel X servos in velocity mode, on a U2D2 or an OpenRB-150 in pass-through.

There is no controller board: this program sends zero speed when its command is old, and the bus
watchdog of each servo stops it when this program is silent. Any packet feeds that watchdog, also a
read, so only the rules here keep an old command from driving on.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from struct import Struct

import numpy as np

from tsd_twin.hardware.cables import CableMonitor
from tsd_twin.hardware.drive_latch import BatteryWatch, DriveLatch, WheelFollowing
from tsd_twin.hardware.dynamixel.packets import StatusPacket, protocol2
from tsd_twin.hardware.dynamixel.wheel_models import (
    LOAD_PERCENT,
    SERVOS,
    VELOCITY_LIMIT,
    VELOCITY_LIMIT_SIZE,
    VELOCITY_UNIT_RAD_PER_S,
    WHEEL_MODELS,
    WheelModel,
)
from tsd_twin.hardware.joints import JointCommand, ServoCalibration, ServoNames
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport
from tsd_twin.hardware.servo_line import (
    ANSWER_S,
    BUS_WATCHDOG,
    RETURN_DELAY,
    TORQUE_ENABLE,
    WATCHDOG_EXPIRED,
    WHEEL_WATCHDOG,
    ServoExchange,
    ServoLine,
    ServoMeasurement,
    ServoReport,
)
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence
from tsd_twin.robots import OmniDescription
from tsd_twin.safety import Heartbeat

_LOG = logging.getLogger(__name__)
GOAL_VELOCITY = 104
GOAL = Struct("<i")
_ZERO = GOAL.pack(0)
_STATE_CYCLES = 4
"""Cycles between two reads of the torque of all servos, and of their watchdogs."""
HOT_MARGIN_C = 5.0
"""A servo stops the robot this far below the temperature at which it switches itself off."""


@dataclass(frozen=True, slots=True)
class WheelReport(ServoReport):
    """Latest measurements of the servos, by index from 0."""

    expired: int = 0
    """Mask of servos that their bus watchdog has stopped."""
    unguarded: int = 0
    """Mask of servos whose bus watchdog is off, as after a restart."""

    @property
    def unready(self) -> int:
        """Mask of servos that need their set-up again before they may turn."""
        return self.limp | self.expired | self.unguarded

    @property
    def supply_v(self) -> float:
        """Estimated battery voltage: the highest voltage of all servos."""
        return max(servo.voltage_v for servo in self.present.values())


class WheelBus(ServoExchange):
    """Servo bus as the device of a `DeviceThread`.

    Other threads write `command` and read `report`. Goals are zero unless an armed command is
    fresh and nothing is wrong; after a trouble only a new arming turns wheels again.
    """

    def __init__(
        self,
        robot: OmniDescription,
        calibration: ServoCalibration,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        drive = robot.kinematics()
        self.names = ServoNames([joint.name for joint in drive.joints])
        ids = calibration.ids(self.names.names)
        line = ServoLine(ids, self.names.names, SERVOS, "bring its firmware to Protocol 2.0")
        super().__init__(line, CableMonitor(self.names), clock)
        count = len(self.names.names)
        self.command = JointCommand(np.zeros(count), Heartbeat(False, 0), 0.0)
        self.report: WheelReport | None = None
        self.trouble: Reason | None = because(Code.DEVICE_DISCONNECTED, device="servo_bus", text="")
        """Reason why wheels may not turn, or None; replaced as a whole."""
        self.power_cuts = 0
        """Times that all servos had lost their memory together with the line."""
        self.models: dict[int, WheelModel] = {}
        """Models by index."""
        self._top_rad_per_s = drive.max_speed_rad_per_s
        self._hot_c = robot.servo_limit_c - HOT_MARGIN_C
        self._limit_c = robot.servo_limit_c
        self._signs = np.array(calibration.signs(self.names.names))
        self._latch = DriveLatch()
        self._following = WheelFollowing(self.names.names, self._top_rad_per_s)
        self._battery = BatteryWatch(robot.battery.arm_v, robot.battery.stop_v)
        self._was_connected = False
        self._cycles = 0

    @property
    def lost(self) -> Reason | None:
        """Reason why wheels do not turn although the robot is armed, or None."""
        return self._latch.lost

    def connect(self, transport: SerialTransport) -> None:
        """Find all servos, check their settings, and set them up with zero speed.

        Raises:
            HardwareError: If a servo does not respond, has a wrong setting, or is too slow for the
                robot; the message names it.
        """
        for device in self._line.ids:
            self._line.find(transport, device)
        if self._was_connected and self._has_restarted(transport):
            self.power_cuts += 1
            every = self.names.named(self.names.servos)
            _LOG.warning("%s", sentence(because(Code.SERVOS_RESTARTED, servos=every)))
        for device in self._line.ids:
            self._check(transport, device)
            self._prepare(transport, device)
        self._was_connected = True

    def cycle(self, transport: SerialTransport) -> bool:
        """Write goals and read measurements in one exchange; return whether any servo responded.

        Raises:
            HardwareError: If the port is gone, or a servo that restarted is another one.
        """
        began_s, command = self._clock(), self.command
        self.trouble = self._trouble(command, began_s)
        drives = self._latch.step(command, self.trouble, began_s)
        request = self._line.to_all(GOAL_VELOCITY, self._goals(command.setpoint, drives=drives))
        any_answered = self._exchange(transport, request, began_s)
        if not command.heartbeat.armed:
            self._prepare_again(transport)
        return any_answered

    def disconnected(self) -> None:
        """Discard the report; wheels turn only after a new arming."""
        text = self.health.disconnect_reason
        self._latch.lock(because(Code.DEVICE_DISCONNECTED, device="servo_bus", text=text))
        self.cables.add_reconnect()
        self.report = None

    def rest(self, transport: SerialTransport) -> None:
        """Stop the wheels; the servos hold them, and their watchdogs then refuse any speed."""
        for _ in range(2):
            transport.request(
                self._line.to_all(GOAL_VELOCITY, [_ZERO] * len(self.names.names)), 0, 0.0
            )

    def speeds(self, report: WheelReport, now_s: float) -> Array:
        """Return the wheel speeds (n,), rad/s; NaN where there is no recent measurement."""
        alive = report.alive(now_s)
        units = [
            float(report.present[i].velocity_units) if alive >> i & 1 else math.nan
            for i in range(len(self.names.names))
        ]
        return self._signs * np.array(units) * VELOCITY_UNIT_RAD_PER_S

    def current_a(self, i: int, present: ServoMeasurement) -> float:
        """Return the measured current of servo `i`, A; NaN if it reports its load instead."""
        model = self.models[i]
        amperes = 1e-3 * model.servo.current_ma * present.current_units
        return math.nan if model.reports_load else amperes

    def load_percent(self, i: int, present: ServoMeasurement) -> float:
        """Return the load of servo `i`, percent of its PWM; NaN if it reports a current instead."""
        loads = self.models[i].reports_load
        return LOAD_PERCENT * present.current_units if loads else math.nan

    def _goals(self, setpoint: Array, *, drives: bool) -> list[bytes]:
        if not drives:
            return [_ZERO] * len(self.names.names)
        most = self._top_rad_per_s
        speeds = self._signs * np.clip(setpoint, -most, most) / VELOCITY_UNIT_RAD_PER_S
        return [GOAL.pack(int(unit)) for unit in np.rint(speeds)]

    def _trouble(self, command: JointCommand, now_s: float) -> Reason | None:
        """Return why wheels may not turn, or None."""
        report, armed = self.report, command.heartbeat.armed
        silent = self.health.connection_fault(report and report.newest_s, now_s)
        if silent is not None or report is None:
            return silent
        if trouble := self._servo_trouble(report):
            return trouble
        if trouble := self._battery.step(report.supply_v, now_s, armed=armed):
            return trouble
        if not armed or self._latch.lost is not None:
            self._following.reset()
            return None
        return self._following.step(command.setpoint, self.speeds(report, now_s), now_s)

    def _servo_trouble(self, report: WheelReport) -> Reason | None:
        names = self.names
        if dead := names.servos & ~report.alive(self.cycled_s):
            return names.silent(dead)
        if report.faults:
            return names.about(report.faults, Code.SERVO_ERROR)
        hot = [i for i, it in report.present.items() if it.temperature_c >= self._hot_c]
        if hot:
            mask = sum(1 << i for i in hot)
            return names.about(mask, Code.SERVO_TOO_HOT, limit_c=self._hot_c)
        if report.expired:
            return names.about(report.expired, Code.WATCHDOG_EXPIRED)
        if report.unguarded:
            return names.about(report.unguarded, Code.SERVOS_RESTARTED)
        return names.about(report.limp, Code.SERVO_LIMP) if report.limp else None

    def _add_responses(self, answers: Sequence[StatusPacket]) -> None:
        now_s = self._clock()
        before = self.report or WheelReport({}, now_s)
        present, faults = self._line.measured(answers, before.faults, now_s)
        self.cables.add_voltages({i: servo.voltage_v for i, servo in present.items()})
        if present:
            every = {**before.present, **present}
            self.report = replace(before, present=every, newest_s=now_s, faults=faults)

    def _read_state(self, transport: SerialTransport, answered: list[int]) -> None:
        """Read torque in one cycle and watchdogs in another; both are rare to change."""
        self._cycles += 1
        at = {0: TORQUE_ENABLE, 2: BUS_WATCHDOG}.get(self._cycles % _STATE_CYCLES)
        if at is None or self.report is None or not answered:
            return
        request = protocol2.sync_read(answered, at, 1)
        found = {
            self._line.bit(answer.id): answer.data[0]
            for answer in transport.request(request, len(answered), ANSWER_S)
            if answer.id in answered and len(answer.data) == 1
        }

        def updated(mask: int, *values: int) -> int:
            for bit, value in found.items():
                mask = mask | bit if value in values else mask & ~bit
            return mask

        if at == TORQUE_ENABLE:
            self.report = replace(self.report, limp=updated(self.report.limp, 0))
            return
        expired = updated(self.report.expired, WATCHDOG_EXPIRED)
        others = set(found.values()) - {WHEEL_WATCHDOG, WATCHDOG_EXPIRED}
        unguarded = updated(self.report.unguarded, *others)
        self.cables.add_restarts(unguarded & ~self.report.unguarded, self._clock())
        self.report = replace(self.report, expired=expired, unguarded=unguarded)

    def _has_restarted(self, transport: SerialTransport) -> bool:
        """Return whether all servos have lost their memory."""
        read = self._line.read
        return all(
            read(transport, device, BUS_WATCHDOG, 1) == read(transport, device, TORQUE_ENABLE, 1)
            == b"\x00"
            for device in self._line.ids
        )  # fmt: skip

    def _check(self, transport: SerialTransport, device: int) -> None:
        """Check model, settings, temperature limit and speed of a servo.

        Raises:
            HardwareError: If one does not fit the robot.
        """
        number = self._line.check_settings(transport, device).number
        model = self.models[self._line.ids.index(device)] = WHEEL_MODELS[number]
        named, name = f"servo {self._line.named(device)}", model.servo.name
        if self._limit_c > model.temperature_limit_c:
            raise HardwareError(
                f"{named}: an {name} switches off at {model.temperature_limit_c} °C, and the robot "
                f"expects {self._limit_c:g} °C: set motor.temperature_limit_c in its description"
            )
        limit = self._line.read(transport, device, VELOCITY_LIMIT, VELOCITY_LIMIT_SIZE)
        most_rad_per_s = int.from_bytes(limit, "little") * VELOCITY_UNIT_RAD_PER_S
        if self._top_rad_per_s > most_rad_per_s:
            rpm = 30.0 / math.pi
            raise HardwareError(
                f"{named}: an {name} turns at {most_rad_per_s * rpm:.1f} rpm at most (velocity "
                f"limit, register {VELOCITY_LIMIT}), and the wheels of the robot at "
                f"{self._top_rad_per_s * rpm:.1f} rpm: correct [motor] in its description"
            )

    def _prepare(self, transport: SerialTransport, device: int) -> None:
        """Set a servo up with zero speed.

        Its torque is off while the watchdog is cleared, because a servo whose watchdog is cleared
        may turn at its old goal again. Torque returns once a goal of zero was read back.

        Raises:
            HardwareError: If the servo refuses or does not respond.
        """
        line = self._line
        line.write(transport, device, TORQUE_ENABLE, 0)
        if (delay := line.read(transport, device, RETURN_DELAY, 1)[0]) != 0:
            _LOG.info("servo %s: return delay time is %s, set to 0", line.named(device), delay)
            line.write(transport, device, RETURN_DELAY, 0)
        line.write(transport, device, BUS_WATCHDOG, 0)
        line.write(transport, device, GOAL_VELOCITY, 0, GOAL.size)
        line.write(transport, device, BUS_WATCHDOG, WHEEL_WATCHDOG)
        goal = line.read(transport, device, GOAL_VELOCITY, GOAL.size)
        watchdog = line.read(transport, device, BUS_WATCHDOG, 1)
        if goal != _ZERO or watchdog != bytes([WHEEL_WATCHDOG]):
            raise HardwareError(f"servo {line.named(device)} does not keep its set-up")
        line.write(transport, device, TORQUE_ENABLE, 1)

    def _prepare_again(self, transport: SerialTransport) -> None:
        """Set up one servo that restarted or expired, while the robot is disarmed."""
        report, now_s = self.report, self._clock()
        if report is None or now_s - report.newest_s > SILENT_S:
            return
        ready = report.alive(now_s) & ~report.faults
        for device in self._line.ids:
            bit = self._line.bit(device)
            if report.unready & ready & bit:
                if report.unguarded & bit:  # It restarted, and may be another servo.
                    self._check(transport, device)
                self._prepare(transport, device)
                done = {k: getattr(report, k) & ~bit for k in ("limp", "expired", "unguarded")}
                self.report = replace(self.report or report, **done)
                return
