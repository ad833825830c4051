"""The robot core: commands and measured joints in, set-points and an estimated state out.

Pure: time and data are arguments, nothing is read or sent, so the rules that run on a simulated
robot in a test are the rules that run on the machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tsd_twin.authority import ARMED, Authority, Facts, Mode
from tsd_twin.core.authority_status import command_status, lease_status, limit_status
from tsd_twin.core.clamp import Clamp
from tsd_twin.core.estimator import Estimator
from tsd_twin.core.gearbox import Gearbox
from tsd_twin.core.joint_faults import JointFaults
from tsd_twin.core.joint_states import JointStates
from tsd_twin.core.requests import Requests
from tsd_twin.core.spaces import SPACES
from tsd_twin.core.suspicion import Suspicion
from tsd_twin.drives import Drive
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.command import Sample
from tsd_twin.messages.ros import ODOM, JointState, Odometry
from tsd_twin.messages.service import Event, LeaseReply, Reply
from tsd_twin.messages.status import LoopStatus, Status
from tsd_twin.motion import TwistLimiter, within_reason
from tsd_twin.robots import Robot
from tsd_twin.topics import Service

LONGEST_STEP_S = 0.02
"""The most time that one step towards another speed makes use of."""


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
        self._requests = Requests(self.authority, self._gearbox, self._estimator, self._space)
        self._states = JointStates(robot)
        self._wheels = np.flatnonzero(~self._estimator.is_angle)
        self._limiter = TwistLimiter(self.drive, robot.limits)
        self._components = np.array(self.drive.components)
        self._now_s = -math.inf
        self._clamp = Clamp()
        self._faults = JointFaults(self._estimator)
        self._suspicion = Suspicion()
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
        self._tell(self._estimator.outside.step(now_s, at_rest=at_rest))

    def _tell(self, event: Event | None) -> None:
        if event is not None:
            self._events.append(event)

    def _facts(self, now_s: float, fault: str) -> Facts:
        authority, faults = self.authority, self._faults
        fault = faults.step(now_s, self.setpoint, authority, fault)
        at_rest = not any(self.twist)
        if authority.mode is not Mode.ARMING:
            return Facts(neutral=False, at_speed=False, at_rest=at_rest, fault=fault)
        neutral, at_speed = self._estimator.neutral_and_at_speed(self._gearbox.inverse(np.zeros(3)))
        return Facts(neutral and not faults.silent(now_s), at_speed, at_rest, fault)

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
            self._tell(self._clamp.compare(request, goal, now_s))
        else:
            # Not at rest only when latched: the limiter starts from zero again, nothing jumps.
            self.twist = np.zeros(3)
            self._clamp.forget()
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

    # What operators ask for.

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Return the answer to a request, also to one that cannot be read: never silence."""
        return self._requests.serve(service, payload, now_s)

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Stop and latch, whatever the payload is: a stop needs nothing to count."""
        return self._requests.stop(payload, now_s)

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
        estimator = self._estimator
        return self._states.measured(estimator.joints, estimator.rates, estimator.sensors, stamp_ns)

    def setpoint_state(self, stamp_ns: int) -> JointState:
        """Return the commanded joints."""
        return self._states.told(self.setpoint, stamp_ns)

    def odometry(self, stamp_ns: int) -> Odometry:
        """Return the estimate: pose in `odom`, twist in `base_link`, with covariances."""
        return self._estimator.odometry(stamp_ns)

    def other_odometry(self, stamp_ns: int) -> Odometry | None:
        """Return the estimate that `odometry` is not, where the robot has two; see docs/bus.md."""
        return self._estimator.other_odometry(stamp_ns)

    def status(self, now_s: float, loop: LoopStatus, hardware: Mapping[str, Any]) -> Status:
        """Return what `state/status` says."""
        authority = self.authority
        conflict = self._faults.evidence or self._estimator.conflict(
            wheels_spin=authority.wheels_spin
        )
        self._tell(self._suspicion.step(conflict.suspect, now_s))
        lease = authority.lease_in_force(now_s)
        return Status(
            mode=authority.mode,
            stop_reason=authority.reason,
            stops=authority.stops,
            arming=authority.arming(now_s),
            lease=lease_status(authority, lease, now_s),
            command=command_status(authority, now_s),
            limits=limit_status(self.robot, lease, self._clamp.share),
            conflict=conflict,
            gear=self._gearbox.status(float(self.joints[self._wheels].mean())),
            outside=self._estimator.outside.status(now_s),
            loop=loop,
            hardware=hardware,
        )
