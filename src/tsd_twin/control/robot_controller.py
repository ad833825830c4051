"""Control loop of a robot: maps commands and measured joints to setpoints and a state estimate.

Pure: time and data are passed in and there is no I/O. Tests in virtual time and real robots share
this code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tsd_twin.control.goal_rounding import GoalRounding
from tsd_twin.control.monitors import (
    BatteryMonitor,
    FaultReporter,
    HeatMonitor,
    JointFaultMonitor,
    SaturationMonitor,
)
from tsd_twin.control.services import ServiceHandler
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.control.wheel_spin import WheelSpeedController
from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import ODOM, JointState, Odometry
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.events import Event
from tsd_twin.messages.modes import ARMED, Mode
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import LeaseReply, Reply
from tsd_twin.messages.status import (
    CommandStatus,
    LeaseStatus,
    LimitStatus,
    LoopStatus,
    RobotStatus,
)
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.motion import TwistLimiter, clip_to_finite
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import Lease, SafetySupervisor
from tsd_twin.safety.lease import speed_cap_mps


def lease_status(supervisor: SafetySupervisor, lease: Lease | None, now_s: float) -> LeaseStatus:
    """Return the lease part of the status: holder, pending request and reservation."""
    asked = supervisor.hand_over.pending_request(now_s) if lease else None
    reserved = supervisor.hand_over.reservation(now_s)
    return LeaseStatus(
        holder=lease.holder if lease else None,
        remaining_s=round(lease.expires_s - now_s, 3) if lease else 0.0,
        requested_by=asked.operator if asked else None,
        request_expires_in_s=round(asked.until_s - now_s, 3) if asked else 0.0,
        reserved_for=reserved.operator if reserved else None,
        reservation_expires_in_s=round(reserved.until_s - now_s, 3) if reserved else 0.0,
    )


def command_status(supervisor: SafetySupervisor, now_s: float) -> CommandStatus:
    """Return the command part of the status: latest accepted command and drop counts."""
    gate, age_s = supervisor.gate, now_s - supervisor.command_s
    return CommandStatus(
        seq=supervisor.command_seq,
        age_s=round(age_s, 4) if math.isfinite(age_s) else None,
        echo_s=None if gate.echo_s is None else round(gate.echo_s, 4),
        accepted=gate.accepted,
        dropped=gate.dropped,
    )


def limit_status(
    robot: RobotDescription,
    lease: Lease | None,
    applied: float,
    *slowed: BatteryMonitor | HeatMonitor,
) -> LimitStatus:
    """Return the limits under `lease`, or under a default one; `applied` is a fraction."""
    limits = robot.limits
    max_age_s = lease.max_age_s if lease else limits.max_command_age_s
    cap_mps = lease.speed_cap_mps if lease else speed_cap_mps(robot, max_age_s)
    cap_mps = min(cap_mps, *(by.share * limits.speed_mps for by in slowed))
    why = tuple(by.why for by in slowed if by.why is not None)
    return LimitStatus(
        speed_mps=cap_mps,
        turn_rate_rad_per_s=limits.turn_rate_rad_per_s * cap_mps / limits.speed_mps,
        max_command_age_s=max_age_s,
        stop_allowance_m=limits.stop_allowance_m,
        applied=round(applied, 3),
        reason="; ".join(map(sentence, why)),
        why=why,
    )


_REST = np.zeros(3)
LONGEST_STEP_S = 0.02
"""Maximum time step for a change of wheel speed or twist."""


class RobotController:
    """Control loop of a robot: safety, limits, inverse kinematics and state estimation."""

    def __init__(
        self,
        robot: RobotDescription,
        new_lease_id: Callable[[], bytes],
        *,
        pose: SE2 | SO3 | None = None,
    ) -> None:
        """`pose` is the initial pose (`SE2` or `SO3`), by default the identity."""
        self.robot = robot
        self._wheel_speed = WheelSpeedController(robot)
        self.supervisor = SafetySupervisor(robot, new_lease_id)
        self._estimator = StateEstimator(robot)
        if pose is not None:
            self._estimator.set_pose(pose)
        self._services = ServiceHandler(self.supervisor, self._wheel_speed, self._estimator)
        self._is_angle = self._estimator.is_angle
        self._wheels = np.flatnonzero(~self._is_angle)
        self._joint_names = [joint.name for joint in self.kinematics.joints]
        self._sensor_names = [sensor.name for sensor in robot.sensors]
        self._sensor_is_angle = [sensor.kind is JointKind.POSITION for sensor in robot.sensors]
        self._limiter = TwistLimiter(self.kinematics, robot.limits)
        self._capped: tuple[tuple[bytes, float], Array] | None = None
        """Latest request and factor, and the result of `_limiter`."""
        self._solved: tuple[bytes, Array] | None = None
        """Latest twist, and its joints (n,) by inverse kinematics."""
        self._rounding = GoalRounding.of(robot)
        self._components = np.array(self.kinematics.twist_axes)
        self._now_s = -math.inf
        self._saturation = SaturationMonitor()
        self._battery = BatteryMonitor(robot.battery)
        self._heat = HeatMonitor(robot.battery.low_speed_share, robot.servo_limit_c)
        self._faults = JointFaultMonitor(self._estimator)
        self._fault_reporter = FaultReporter()
        self._events: list[Event] = []
        self.twist = np.zeros(3)
        """(3,): commanded twist in the base frame."""
        self.setpoint = self._estimator.joints.copy()
        """(n,): joint setpoints."""

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics at the current speed of continuously spinning wheels."""
        return self._wheel_speed.kinematics

    # The control loop.

    def step(
        self,
        now_s: float,
        measured: Array | None,
        samples: Sequence[Sample],
        fault: Reason | None = None,
        battery_v: float | None = None,
        servo_c: float | None = None,
    ) -> Array:
        """Run one period; return the setpoint (n,) for the period starting at `now_s`.

        Args:
            now_s: Start of the period.
            measured: (n + s,) joints and sensors, NaN where missing; None without a measurement.
            samples: All command samples since the last step.
            fault: Fault reported by the controller board, or None.
            battery_v: Battery voltage, or None if not measured.
            servo_c: Temperature of the hottest servo, or None if not measured.
        """
        dt_s = now_s - self._now_s if math.isfinite(self._now_s) else 0.01
        self._now_s = now_s
        self._add_event(self.supervisor.loop.step(now_s))
        if dt_s > 0.0:
            self._estimator.advance(now_s, measured, self.setpoint, dt_s, battery_v)
        moves = self.supervisor.mode in (Mode.DRIVING, Mode.STOPPING)
        self._add_event(self._estimator.pose_sensor.step(now_s, at_rest=not moves))
        for sample in samples:
            self.supervisor.receive(sample, now_s)
        fault = self._faults.step(now_s, self.setpoint, self.supervisor, fault)
        neutral, at_speed = self._neutral_and_at_speed(now_s)
        at_rest = not any(self.twist.tolist())
        self.supervisor.step(
            now_s, neutral=neutral, at_speed=at_speed, at_rest=at_rest, fault=fault
        )
        armed = self.supervisor.mode in ARMED
        self._add_event(self._battery.step(battery_v, now_s, armed=armed))
        self._add_event(self._heat.step(servo_c, now_s, armed=armed))
        self._update_wheel_speed(now_s, max(dt_s, 0.0))
        self._command(now_s, max(dt_s, 0.0))
        return self.setpoint

    def add_pose_measurements(self, poses: Sequence[Sample], now_s: float, wall_ns: int) -> None:
        """Queue samples of `sensor/pose`; `wall_ns` is the wall-clock time at `now_s`."""
        self._estimator.pose_sensor.receive(poses, now_s, wall_ns)

    def _add_event(self, event: Event | None) -> None:
        if event is not None:
            self._events.append(event)

    def _neutral_and_at_speed(self, now_s: float) -> tuple[bool, bool]:
        if self.supervisor.mode is not Mode.ARMING:
            return False, False
        neutral, at_speed = self._estimator.neutral_and_at_speed(self._inverse(_REST))
        return neutral and not self._faults.silent(now_s), at_speed

    def _update_wheel_speed(self, now_s: float, dt_s: float) -> None:
        mode, lease = self.supervisor.mode, self.supervisor.lease_in_force(now_s)
        armed = mode in ARMED
        if self._wheel_speed.advance(
            min(dt_s, LONGEST_STEP_S),
            lease.id if lease else None,
            self._estimator.spin_after,
            armed=armed,
            ramps=armed and mode is not Mode.ARMING,
        ):
            self._limiter = TwistLimiter(self.kinematics, self.robot.limits)
            self._capped = self._solved = None
            # Slower wheels saturate earlier: scale the whole twist, not each gimbal.
            self.twist = self.twist / max(1.0, float(self.kinematics.joint_utilization(self.twist)))

    def _command(self, now_s: float, dt_s: float) -> None:
        supervisor = self.supervisor
        if supervisor.mode in (Mode.DRIVING, Mode.STOPPING):
            request, goal = np.zeros(3), np.zeros(3)
            lease = supervisor.lease_in_force(now_s)
            if supervisor.command is not None and lease is not None:
                request = self._request()
                share = lease.speed_cap_mps / self.robot.limits.speed_mps
                goal = self._cap(request, min(share, self._battery.share, self._heat.share))
            if dt_s > 0.0:
                # After a delayed period, the speed may fall but must not rise in one step, because
                # the robot has kept moving.
                step_s = min(dt_s, LONGEST_STEP_S) if any(goal.tolist()) else dt_s
                self.twist = self._limiter.approach(self.twist, goal, step_s)
            self._add_event(self._saturation.compare(request, goal, now_s))
        else:
            # Non-zero only when latched. The limiter then starts from zero, without a jump.
            self.twist = np.zeros(3)
            self._saturation.share = 1.0
        self.setpoint = self._inverse(self.twist)
        if self._rounding is not None:
            if any(self.twist.tolist()):
                self.setpoint = self._rounding.step(self.setpoint, min(dt_s, LONGEST_STEP_S))
            else:
                self._rounding.reset()
        if not supervisor.wheels_spin:
            self.setpoint[self._wheels] = 0.0

    def _cap(self, request: Array, share: float) -> Array:
        """Cap a request (3,) to the limits, reusing the last result if unchanged."""
        asked = (request.tobytes(), share)
        if self._capped is None or self._capped[0] != asked:
            self._capped = (asked, self._limiter.cap(request, share))
        return self._capped[1]

    def _inverse(self, twist: Array) -> Array:
        """Return the joints (n,) for a twist (3,), reusing the last solution if unchanged."""
        if not any(twist.tolist()):
            twist = _REST  # A negative zero would miss the last solution.
        asked = twist.tobytes()
        if self._solved is None or self._solved[0] != asked:
            self._solved = (asked, self.kinematics.inverse(twist))
        joints = self._solved[1].copy()
        self._wheel_speed.set_wheels(joints)
        return joints

    def _request(self) -> Array:
        """Return the commanded twist (3,) in the base frame."""
        command = self.supervisor.command
        assert command is not None  # noqa: S101  Checked by the caller.
        twist = command.twist[self._components]
        if command.frame == ODOM:
            twist, pose = clip_to_finite(twist), self._estimator.pose
            if isinstance(pose, SE2):  # The base of a sphere is fixed in the world.
                twist[:2] = pose.inverse().rotate(twist[:2])  # Eq. 1 of Carothers.
        return twist

    # Operator requests.

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Process a request and return the reply; malformed requests are refused."""
        return self._services.serve(service, payload, now_s)

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Latch a stop; any payload is accepted, even a malformed one."""
        return self._services.stop(payload, now_s)

    # State for the bus.

    def record_status_sent(self, seq: int, now_s: float) -> None:
        """Record the send time of a status, whose number commands echo."""
        self.supervisor.gate.record_status(seq, now_s)

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events = self.supervisor.take_events() + self._events
        self._events = []
        return events

    @property
    def mean_twist(self) -> Array:
        """(3,): estimated mean twist during the last step; `odometry` has the twist at its end."""
        return self._estimator.mean_twist

    @property
    def unfused_pose(self) -> Any:
        """Dead-reckoned pose in `odom`, without corrections by a pose sensor."""
        return self._estimator.unfused_pose

    @property
    def pose(self) -> Any:
        """Estimated pose in `odom`: `SE2` or `SO3`, depending on the kinematics."""
        return self._estimator.pose

    @property
    def end_twist(self) -> Array:
        """(3,): estimated twist in `base_link` at the end of the last step."""
        return self._estimator.end_twist

    @property
    def joints(self) -> Array:
        """(n,): measured joints; unmeasured wheel speeds come from the motor model."""
        return self._estimator.joints

    def joint_state(self, stamp_ns: int) -> JointState:
        """Return the measured joints, followed by the other sensors."""
        sensors, is_angle = self._estimator.sensors, self._sensor_is_angle
        state = self._joint_state(self._estimator.joints, self._estimator.rates, stamp_ns)
        if not self._sensor_names:
            return state
        return JointState(
            [*state.names, *self._sensor_names],
            np.append(state.position_rad, np.where(is_angle, sensors, np.nan)),
            np.append(state.velocity_rad_per_s, np.where(is_angle, np.nan, sensors)),
            stamp_ns,
        )

    def setpoint_state(self, stamp_ns: int) -> JointState:
        """Return the joint setpoints."""
        unknown = np.full(len(self.setpoint), np.nan)
        return self._joint_state(self.setpoint, unknown, stamp_ns)

    def _joint_state(self, joints: Array, rates: Array, stamp_ns: int) -> JointState:
        position = np.where(self._is_angle, joints, np.nan)
        velocity = np.where(self._is_angle, rates, joints)
        return JointState(self._joint_names, position, velocity, stamp_ns)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return the estimated pose in `odom` and twist in `base_link`, with covariances."""
        return self._estimator.odometry(stamp_ns)

    def alternative_odometry(self, stamp_ns: int) -> Odometry | None:
        """Return the second estimate, or None if there is only one; see docs/bus.md."""
        return self._estimator.alternative_odometry(stamp_ns)

    def status(self, now_s: float, loop: LoopStatus, hardware: Mapping[str, Any]) -> RobotStatus:
        """Return the `state/status` message."""
        supervisor = self.supervisor
        consistency = self._faults.evidence or self._estimator.consistency(
            wheels_spin=supervisor.wheels_spin
        )
        self._add_event(self._fault_reporter.step(consistency, now_s))
        lease = supervisor.lease_in_force(now_s)
        return RobotStatus(
            mode=supervisor.mode,
            stop_reason=supervisor.reason,
            stop=supervisor.why,
            stops=supervisor.stops,
            arming=supervisor.arming(now_s),
            lease=lease_status(supervisor, lease, now_s),
            refusals=self._services.refusals(now_s),
            command=command_status(supervisor, now_s),
            limits=limit_status(
                self.robot, lease, self._saturation.share, self._battery, self._heat
            ),
            consistency=consistency,
            wheel_speed=self._wheel_speed.status(float(self.joints[self._wheels].mean())),
            pose_sensor=self._estimator.pose_sensor.status(now_s),
            learned=self._estimator.learned(),
            loop=loop,
            hardware=hardware,
            operators=dict(supervisor.operators.by_id),
        )
