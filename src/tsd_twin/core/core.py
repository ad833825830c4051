"""The robot core: commands and measured joints in, set-points and an estimated state out.

Pure: time and data are arguments, nothing is read or sent, so the rules that run on a simulated
robot in a test are the rules that run on the machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tsd_twin.authority import ARMED, LATCHED, Authority, Facts, Mode
from tsd_twin.core.estimator import Estimator
from tsd_twin.core.following import Following
from tsd_twin.core.gearbox import Gearbox
from tsd_twin.core.lease_status import lease_status
from tsd_twin.core.spaces import SPACES
from tsd_twin.drives import Drive, JointKind
from tsd_twin.errors import MessageError
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.command import Sample
from tsd_twin.messages.ros import ODOM, JointState, Odometry
from tsd_twin.messages.service import (
    Event,
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    SetOrientationRequest,
    SetPoseRequest,
    SpeedRequest,
    StopRequest,
    decode_request,
)
from tsd_twin.messages.status import (
    CommandStatus,
    ConflictStatus,
    LimitStatus,
    LoopStatus,
    Status,
)
from tsd_twin.motion import TwistLimiter, within_reason
from tsd_twin.robots import Robot
from tsd_twin.topics import Service

SILENT_S = 0.1
"""Joints that are not measured for this long are a fault while armed."""
LONGEST_STEP_S = 0.02
"""The most time that one step towards another speed makes use of."""
_CLAMP_REPORT_S = 0.5
_SUSPECT_REPORT_S = 1.0


class RobotCore:
    """Everything between the bus and the joints of one robot."""

    def __init__(
        self,
        robot: Robot,
        new_lease_id: Callable[[], bytes],
        *,
        pose: SE2 | SO3 | None = None,
    ) -> None:
        """`pose`, of the drive's space, is where the robot is taken to be; the identity if not."""
        self.robot = robot
        self._gearbox = Gearbox(robot)
        self.authority = Authority(robot, new_lease_id)
        self._estimator = Estimator(robot)
        if pose is not None:
            self._estimator.set_pose(pose)
        self._space = SPACES[self.drive.space]
        self._names = [joint.name for joint in self.drive.joints]
        self._is_angle = self._estimator.is_angle
        self._sensors = robot.sensors
        self._sensor_is_angle = [s.kind is JointKind.POSITION for s in self._sensors]
        self._wheels = np.flatnonzero(~self._is_angle)
        self._limiter = TwistLimiter(self.drive, robot.limits)
        self._components = np.array(self.drive.components)
        self._now_s = -math.inf
        self._applied_share = 1.0
        self._clamp_reported_s = -math.inf
        angles = np.flatnonzero(self._is_angle)
        self._angles = angles
        self._following = Following([self._names[i] for i in angles])
        self._evidence: ConflictStatus | None = None
        self._suspect: str | None = None
        self._suspect_reported_s = -math.inf
        self._events: list[Event] = []
        self.twist = np.zeros(3)
        """(3,): the twist that is commanded to the joints, in the base frame."""
        self.setpoint = self._estimator.joints.copy()
        """(n,): what the joints shall do."""

    @property
    def drive(self) -> Drive[Any]:
        """The kinematics, with wheels that always spin in the gear of this moment."""
        return self._gearbox.drive

    # The control loop.

    def step(
        self, now_s: float, measured: Array | None, samples: Sequence[Sample], fault: str = ""
    ) -> Array:
        """Return the set-point (n,) for the period that begins at `now_s`.

        `measured` (n + s,) are the joints and then the sensors of the robot, NaN where a number is
        not measured; None when there is no measurement. `samples` are all that came in on the
        command key since the last step.
        `fault` says what the board below the joints objects to, if anything.
        """
        dt_s = now_s - self._now_s if math.isfinite(self._now_s) else 0.01
        self._now_s = now_s
        if dt_s > 0.0:
            self._estimator.advance(now_s, measured, self.setpoint, dt_s)
        self._take_poses(now_s)
        for sample in samples:
            self.authority.receive(sample, now_s)
        self.authority.step(self._facts(now_s, fault), now_s)
        self._shift(now_s, max(dt_s, 0.0))
        self._command(now_s, max(dt_s, 0.0))
        return self.setpoint

    def see(self, poses: Sequence[Sample], now_s: float, wall_ns: int) -> None:
        """Take what came in on `in/pose`; `wall_ns` is what the wall clock shows at `now_s`."""
        self._estimator.outside.receive(poses, now_s, wall_ns)

    def _take_poses(self, now_s: float) -> None:
        at_rest = self.authority.mode not in (Mode.DRIVING, Mode.STOPPING)
        event = self._estimator.outside.step(now_s, at_rest=at_rest)
        if event is not None:
            self._events.append(event)

    def _facts(self, now_s: float, fault: str) -> Facts:
        silent = now_s - self._estimator.measured_s > SILENT_S
        at_rest = not any(self.twist)
        if silent and not fault:
            fault = f"the joints have not been measured for {SILENT_S * 1000:.0f} ms"
        fault = fault or self._stuck(now_s)
        if self.authority.mode is not Mode.ARMING:
            return Facts(neutral=False, at_speed=False, at_rest=at_rest, fault=fault)
        neutral, at_speed = self._estimator.neutral_and_at_speed(self._gearbox.inverse(np.zeros(3)))
        return Facts(neutral and not silent, at_speed, at_rest, fault)

    def _stuck(self, now_s: float) -> str:
        if self.authority.mode not in ARMED or not len(self._angles):
            self._following.forget()
            if self.authority.mode is not Mode.FAULT:
                self._evidence = None
            return ""
        stuck = self._following.step(now_s, self.setpoint[self._angles], self.joints[self._angles])
        if stuck:  # What it was told by stays to be seen until the reset.
            self._evidence = self._estimator.conflict(wheels_spin=self.authority.wheels_spin)
        return stuck

    def _shift(self, now_s: float, dt_s: float) -> None:
        mode, lease = self.authority.mode, self.authority.lease_in_force(now_s)
        armed = mode in ARMED
        if self._gearbox.advance(
            min(dt_s, LONGEST_STEP_S),
            lease.id if lease else None,
            self._estimator.spin_after,
            armed=armed,
            ramps=armed and mode is not Mode.ARMING,
        ):
            self._limiter = TwistLimiter(self.drive, self.robot.limits)
            # What slower wheels cannot do is given up by the whole twist, not gimbal by gimbal.
            self.twist = self.twist / max(1.0, float(self.drive.demand(self.twist)))

    def _command(self, now_s: float, dt_s: float) -> None:
        authority = self.authority
        if authority.mode in (Mode.DRIVING, Mode.STOPPING):
            request, goal = np.zeros(3), np.zeros(3)
            lease = authority.lease_in_force(now_s)
            if authority.command is not None and lease is not None:
                request = self._request()
                share = lease.speed_cap_mps / self.robot.limits.speed_mps
                goal = self._limiter.cap(request, share)
            if dt_s > 0.0:
                # After a loop that was held up, speed is not gained in one leap; it may be lost so,
                # since the robot has been driving on all the while.
                step_s = min(dt_s, LONGEST_STEP_S) if any(goal) else dt_s
                self.twist = self._limiter.approach(self.twist, goal, step_s)
            self._report_clamp(request, goal, now_s)
        else:
            # Not at rest only when latched: the limiter starts from zero again, nothing jumps.
            self.twist = np.zeros(3)
            self._applied_share = 1.0
        self.setpoint = self._gearbox.inverse(self.twist)
        if not authority.wheels_spin:
            self.setpoint[self._wheels] = 0.0

    def _request(self) -> Array:
        """Return the commanded twist (3,) in the base frame."""
        command = self.authority.command
        assert command is not None  # noqa: S101  The caller has looked; this tells the type checker.
        twist = command.twist[self._components]
        if command.frame == ODOM:
            twist = self._space.into_base(self._estimator.pose, within_reason(twist))
        return twist

    def _report_clamp(self, request: Array, capped: Array, now_s: float) -> None:
        # By the largest number of each, since they differ by a factor: no square overflows.
        length = _largest(request)
        self._applied_share = _largest(capped) / length if length > 0.0 else 1.0
        if self._applied_share < 0.999 and now_s - self._clamp_reported_s >= _CLAMP_REPORT_S:
            self._clamp_reported_s = now_s
            self._events.append(
                Event(
                    "clamp",
                    f"The limits let {100 * self._applied_share:.0f} % of the command through.",
                    requested=request.tolist(),
                    applied=capped.tolist(),
                    rule="limits of speed, turn rate and tilt",
                    robot_s=now_s,
                )
            )

    # What operators ask for.

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Return the answer to a request, also to one that cannot be read: never silence."""
        try:
            match service:
                case Service.LEASE:
                    return self.authority.lease(decode_request(payload, LeaseRequest), now_s)
                case Service.ARM | Service.DISARM | Service.RESET:
                    authority = self.authority
                    ask = {
                        Service.ARM: authority.arm,
                        Service.DISARM: authority.disarm,
                        Service.RESET: authority.reset,
                    }[service]
                    return ask(decode_request(payload, HolderRequest).lease, now_s)
                case Service.SET_POSE:
                    return self._set_pose(decode_request(payload, self._space.request()), now_s)
                case Service.SPEED:
                    return self._choose_speed(decode_request(payload, SpeedRequest), now_s)
                case Service.STOP:
                    return self.stop(payload, now_s)
                case Service.DESC:
                    return Reply(False, "the node answers this")
        except MessageError as error:
            refusal = self._refused(service, str(error), now_s)
            if service is Service.LEASE:
                return LeaseReply(False, reason=refusal.reason, ok=False)
            return refusal

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Stop and latch, whatever the payload is: a stop needs nothing to count."""
        try:
            request = decode_request(payload, StopRequest)
        except MessageError:
            request = StopRequest()
        return self.authority.stop(request, now_s)

    def _set_pose(self, request: SetPoseRequest | SetOrientationRequest, now_s: float) -> Reply:
        pose = self._space.asked(request)
        if not self.authority.holds(request.lease, now_s):
            return self._refused(Service.SET_POSE, "take control first", now_s)
        if pose is None:
            return self._refused(Service.SET_POSE, "a pose must be finite numbers", now_s)
        if self.authority.mode in (Mode.DRIVING, Mode.STOPPING):
            # A command in the world's axes would turn with the heading.
            return self._refused(Service.SET_POSE, "the pose can be set at rest only", now_s)
        self._estimator.set_pose(pose)
        return Reply(True)

    def _choose_speed(self, request: SpeedRequest, now_s: float) -> Reply:
        authority, lease = self.authority, request.lease
        if not authority.holds(lease, now_s):
            refusal = "take control first"
        elif authority.mode in LATCHED:
            refusal = f"the robot is {authority.mode}: reset first"
        else:
            refusal = self._gearbox.choose(request.cruise_speed_rpm, bytes.fromhex(lease))
        if refusal:
            return authority.refuse("change the drive speed", refusal, now_s)
        return Reply(True)

    def _refused(self, service: Service, reason: str, now_s: float) -> Reply:
        return self.authority.refuse(service.removeprefix("srv/"), reason, now_s)

    # What there is to see.

    def note_status_sent(self, seq: int, now_s: float) -> None:
        """Remember when a status went out: commands echo its number."""
        self.authority.gate.note_status(seq, now_s)

    def take_events(self) -> list[Event]:
        """Return what has happened since the last call."""
        events = self.authority.take_events() + self._events
        self._events = []
        return events

    @property
    def joints(self) -> Array:
        """(n,): measured joints; speeds that are not measured come from the model of the motors."""
        return self._estimator.joints

    def joint_state(self, stamp_ns: int) -> JointState:
        """Return the measured joints, and after them what the other sensors measure."""
        state = self._joint_state(self.joints, self._estimator.rates, stamp_ns)
        if not self._sensors:
            return state
        values, is_angle = self._estimator.sensors, self._sensor_is_angle
        return JointState(
            [*state.names, *(sensor.name for sensor in self._sensors)],
            np.append(state.position_rad, np.where(is_angle, values, np.nan)),
            np.append(state.velocity_rad_per_s, np.where(is_angle, np.nan, values)),
            stamp_ns,
        )

    def setpoint_state(self, stamp_ns: int) -> JointState:
        """Return the commanded joints."""
        return self._joint_state(self.setpoint, np.full(len(self.setpoint), np.nan), stamp_ns)

    def _joint_state(self, joints: Array, rates: Array, stamp_ns: int) -> JointState:
        position = np.where(self._is_angle, joints, np.nan)
        return JointState(self._names, position, np.where(self._is_angle, rates, joints), stamp_ns)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return the estimate: pose in `odom`, twist in `base_link`, with covariances."""
        return self._estimator.odometry(stamp_ns)

    def other_odometry(self, stamp_ns: int) -> Odometry | None:
        """Return the estimate that `odometry` is not, where the robot has two; see docs/bus.md."""
        return self._estimator.other_odometry(stamp_ns)

    def status(self, now_s: float, loop: LoopStatus, hardware: Mapping[str, Any]) -> Status:
        """Return what `state/status` says."""
        authority, limits = self.authority, self.robot.limits
        lease = authority.lease_in_force(now_s)
        conflict = self._evidence or self._estimator.conflict(wheels_spin=authority.wheels_spin)
        self._report_suspect(conflict.suspect, now_s)
        share = lease.speed_cap_mps / limits.speed_mps if lease else 1.0
        age_s = now_s - authority.command_s
        return Status(
            mode=authority.mode,
            stop_reason=authority.reason,
            stops=authority.stops,
            arming=authority.arming(now_s),
            lease=lease_status(authority, lease, now_s),
            command=CommandStatus(
                seq=authority.command_seq,
                age_s=round(age_s, 4) if math.isfinite(age_s) else None,
                echo_s=None if authority.gate.echo_s is None else round(authority.gate.echo_s, 4),
                accepted=authority.gate.accepted,
                dropped=authority.gate.dropped,
            ),
            limits=LimitStatus(
                speed_mps=limits.speed_mps * share,
                turn_rate_rad_per_s=limits.turn_rate_rad_per_s * share,
                max_command_age_s=lease.max_age_s if lease else limits.max_command_age_s,
                applied=round(self._applied_share, 3),
            ),
            conflict=conflict,
            gear=self._gearbox.status(float(self.joints[self._wheels].mean())),
            outside=self._estimator.outside.status(now_s),
            loop=loop,
            hardware=hardware,
        )

    def _report_suspect(self, suspect: str | None, now_s: float) -> None:
        """Say whom the others contradict, each time that it is another, but not in a flood."""
        if suspect in (None, self._suspect) or now_s - self._suspect_reported_s < _SUSPECT_REPORT_S:
            return
        self._suspect, self._suspect_reported_s = suspect, now_s
        text = f"{suspect} contradicts the others."
        self._events.append(Event("conflict", text, rule="conflict monitor", robot_s=now_s))


def _largest(twist: Array) -> float:
    return max(map(abs, twist.tolist()))
