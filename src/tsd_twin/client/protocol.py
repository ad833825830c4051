"""Sans-I/O operator protocol: commands, motions, setpoint timeout. See `held_lease` for the lease.

The caller passes in received messages and the monotonic time in seconds, and sends the returned
commands and requests. `robot`, `aio`, the simulator and the dashboard provide the transport.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tsd_twin.client.arguments import checked_twist
from tsd_twin.client.echoes import Echoes
from tsd_twin.client.errors import ClientError, RobotSilent, RobotStopped
from tsd_twin.client.held_lease import HeldLease
from tsd_twin.client.lease_signing import LeaseSigning
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.status import RobotStatus
from tsd_twin.motion.prediction import CommandDelay
from tsd_twin.robots import RobotDescription

COMMAND_PERIOD_S = 0.02
"""Commands are sent at 50 Hz during a motion."""
SETPOINT_TIMEOUT_S = 0.2
"""A velocity setpoint is replaced by zero after this time without a refresh."""
_SHORTEST_SETPOINT_S = 0.06
"""Lower bound on slow links; the robot then rejects commands that are too old."""
_ZERO_LEAD_S = 0.03
"""Time from the end of a setpoint until its zero is accepted, in addition to the round trip."""
STATUS_TIMEOUT_S = 1.0
"""The robot counts as silent after this time without a status (20 periods)."""
_GRANT_LATENCY_S = 0.3
"""A status received this soon after a grant may predate it."""
_SHORTEST_PERIOD_S = 0.01
"""A setpoint refreshed faster than this is sent with the next due command."""
_MAX_REORDER = 20
"""A smaller drop of the status number is reordering; a larger one means a robot restart."""
_SEQ_GAP = 1000
"""Sequence-number gap between leases, larger than any previous holder can have in flight."""
_MAX_SAFE_SEQ = 2**53
"""A larger number reported by the robot is ignored, because the next one may overflow."""
_STILL_MPS, _STILL_RAD_PER_S = 0.02, 0.05
ZERO_TWIST = (0.0, 0.0, 0.0)
_MODES = frozenset(Mode)
_ARMED_AND_READY = frozenset({Mode.READY, Mode.DRIVING, Mode.STOPPING})


@dataclass(frozen=True, slots=True, eq=False)
class TwistCommand:
    """Command to publish on `cmd/<operator>/twist`."""

    operator: str
    seq: int
    payload: bytes
    """CDR of a `geometry_msgs/msg/TwistStamped`."""
    attachment: bytes
    """Sequence number, lease id and number of the echoed status; the tag of a signed command."""
    twist: Array
    """(3,): m/s and rad/s in `frame`."""
    frame: str


@dataclass(frozen=True, slots=True)
class _Setpoint:
    """Repeated velocity, with the status echoed for its input."""

    twist: tuple[float, ...]
    frame: str
    status_seq: int
    expires_s: float


class ControlProtocol(HeldLease):
    """State machine for an operator's control of a robot: lease, sequence numbers, setpoint.

    Not thread-safe; callers must hold a lock.
    """

    def __init__(
        self,
        robot_id: str,
        robot: RobotDescription,
        operator: str,
        name: str = "",
        signing: LeaseSigning | None = None,
    ) -> None:
        """Prepare for one robot; see `HeldLease` for `name` and `signing`.

        Raises:
            BusError: If the operator name is not valid in a bus key.
        """
        super().__init__(robot_id, operator, robot.limits.max_command_age_s, name, signing)
        self.robot = robot
        self.kinematics: Kinematics[Any] = robot.kinematics()
        self._axes = list(self.kinematics.twist_axes)
        self.status: RobotStatus | None = None
        self._echoes = Echoes()
        self._xy_heading: Array | None = None
        self._twist: Array | None = None
        self._status_s = self._odometry_s = -math.inf
        self._seq = 0
        self._stops_at_start: int | None = None
        self._motion = 0
        self._stale_before = 0
        self._setpoint: _Setpoint | None = None
        self._sent_s = self._refreshed_s = -math.inf
        self._rest_seq: int | None = None
        self._failure: ClientError | None = None
        self._delay = CommandDelay()

    # Received messages.

    def receive_status(self, status: RobotStatus, seq: int, now_s: float) -> None:
        """Process a `state/status` with its number; ignore outdated ones."""
        if self.status_seq - _MAX_REORDER <= seq < self.status_seq or status.mode not in _MODES:
            return
        if seq != self.status_seq:
            self._delay.add_status(status.command, now_s)
            self._echoes.add(seq, now_s)
        self.status, self.status_seq, self._status_s = status, seq, now_s
        settled = now_s - self._granted_s > max(_GRANT_LATENCY_S, self.max_age_s)
        if self._lease and settled and status.lease.holder != self.operator:
            holder = status.lease.holder
            taken = holder and because(Code.HAS_CONTROL_NOW, holder=holder)
            self._lose(taken or because(Code.LEASE_ENDED))

    def receive_odometry(self, xy_heading: Array, twist: Array, now_s: float) -> None:
        """Process pose (3,) and twist (3,) from `state/odom`; the pose is unused for spheres."""
        self._xy_heading, self._twist, self._odometry_s = xy_heading, twist, now_s

    def delay_s(self, now_s: float) -> float | None:
        """Return the measured delay from a command to its effect in a state, or None if unknown."""
        return self._delay.median_s(now_s)

    def grant(self, reply: LeaseReply, now_s: float) -> None:
        """Process the reply that grants the lease."""
        super().grant(reply, now_s)
        self._failure = self._stops_at_start = self._setpoint = self._rest_seq = None
        # Start above any number the robot has reported, so that its status can acknowledge ours.
        counted = 0 if self.status is None else self.status.command.seq
        self._seq = max(self._seq, counted if counted < _MAX_SAFE_SEQ else 0) + _SEQ_GAP

    def _lose(self, why: Reason) -> None:
        super()._lose(why)
        self._setpoint = self._stops_at_start = None

    # Motions.

    @property
    def latest_status(self) -> RobotStatus:
        """Latest status.

        Raises:
            RobotSilent: If no status has arrived.
        """
        if self.status is None:
            raise RobotSilent(f"{self.robot_id} has sent no status", "no_status")
        return self.status

    @property
    def mode(self) -> Mode:
        """Mode in the latest status; raises as `latest_status` does."""
        return Mode(self.latest_status.mode)

    @property
    def in_motion(self) -> bool:
        """Whether a motion is active."""
        return self._stops_at_start is not None

    def begin_motion(self, now_s: float) -> int:
        """Begin a motion and return its number; it ends if the robot stops automatically.

        Raises:
            ClientError: If the lease is not held, the robot is silent or not ready, or another
                motion is active.
        """
        if self._stops_at_start is not None:
            raise ClientError(
                f"{self.robot_id} is in another motion of this script", "other_motion"
            )
        self.check_ready(now_s)
        return self._begin()

    def begin_rest(self, now_s: float) -> int:
        """End any motion of this script and begin stopping; return the new motion's number."""
        self.check_lease()
        self._check_silence(now_s)
        if self.mode not in _ARMED_AND_READY:
            raise self._stopped("is not ready", "not_ready")
        return self._begin()

    def _begin(self) -> int:
        status = self.latest_status
        self._stops_at_start, self._stale_before = status.stops, status.command.dropped.stale
        self._setpoint = self._rest_seq = None
        self._motion += 1
        return self._motion

    def check_ready(self, now_s: float) -> None:
        """Check that the robot is ready and at rest under this lease."""
        self.check_lease()
        mode = self.mode
        self._check_silence(now_s)
        if mode is not Mode.READY:
            raise self._stopped("is not ready", "not_ready")

    def is_active(self, motion: int) -> bool:
        """Return whether a motion is active and was not superseded by `rest`."""
        return self.in_motion and motion == self._motion

    def end_motion(self, motion: int | None = None) -> None:
        """End a motion (by default the active one) without sending anything."""
        if motion is None or motion == self._motion:
            self._stops_at_start = self._setpoint = self._rest_seq = None

    def check_motion(self, now_s: float, motion: int | None = None) -> None:
        """Check that a motion (by default the active one) may continue.

        Raises:
            ClientError: If control is lost, the robot is silent or stopped automatically, or `rest`
                was called.
        """
        self.check_lease()
        self._check_silence(now_s)
        if motion is not None and motion != self._motion:
            raise ClientError(f"rest has ended this motion of {self.robot_id}", "motion_ended")
        if self._stops_at_start is None:
            raise ClientError(f"{self.robot_id} is in no motion", "no_motion")
        has_stopped = self.latest_status.stops > self._stops_at_start
        if has_stopped or self.mode not in (Mode.READY, Mode.DRIVING):
            raise self._stopped("stopped by itself", "stopped_by_itself")

    @property
    def stale_commands(self) -> int:
        """Number of commands rejected as too old since the motion began."""
        stale = 0 if self.status is None else self.status.command.dropped.stale
        return max(stale - self._stale_before, 0)

    def command(
        self,
        twist: Sequence[float] | Array,
        frame: str,
        now_s: float,
        status_seq: int | None = None,
    ) -> TwistCommand:
        """Return the next command for a twist (3,) in `base_link` or `odom`.

        It echoes `status_seq`, by default the latest status received.

        Raises:
            ControlLost: If the lease is not held.
            ClientError: If a number is not finite.
        """
        self.check_lease()
        numbers = checked_twist(twist, frame)
        spatial = np.zeros(6)
        spatial[self._axes] = numbers
        self._seq += 1
        self._sent_s = now_s
        self._delay.add_sent(self._seq, now_s)
        echo = self.status_seq if status_seq is None else status_seq
        attachment = encode_attachment(self._seq, self._lease, echo)
        payload = encode_twist(TwistStamped(frame, spatial))
        if self.signing is not None:
            attachment += self.signing.command_tag(self.operator, attachment, payload)
        return TwistCommand(self.operator, self._seq, payload, attachment, numbers, frame)

    def has_counted(self, seq: int) -> bool:
        """Return whether the latest status acknowledges command `seq` or a later one."""
        return self.status is not None and seq <= self.status.command.seq <= self._seq

    def at_rest_since(self, seq: int) -> bool:
        """Return whether the robot accepted command `seq` or a later one and is at rest."""
        return self.has_counted(seq) and self.mode is Mode.READY

    def is_still(self) -> bool:
        """Return whether the odometry speed is near zero."""
        if self._twist is None:
            return False
        twist, twist_scale_m = np.abs(self._twist), self.kinematics.twist_scale_m
        slow = twist_scale_m * float(np.hypot(twist[0], twist[1])) < _STILL_MPS
        return slow and float(twist[2]) < _STILL_RAD_PER_S

    # Velocity setpoints.

    def set_velocity(
        self, twist: Sequence[float], frame: str, now_s: float, given_s: float | None = None
    ) -> TwistCommand | None:
        """Set the velocity for `SETPOINT_TIMEOUT_S`; return a command to send now.

        Returns None within 10 ms of the previous call; `poll_command` sends the setpoint then.
        `given_s` is the time of the input, by default now. Each repetition echoes the status that
        was current then, which lets the robot bound the time from the input to the end of the
        motion. The setpoint expires early enough for a zero to arrive before the robot stops
        automatically.

        Raises:
            ClientError: As for `begin_motion` and `check_motion`, or the error that ended the last
                setpoint.
        """
        checked_twist(twist, frame)
        self.raise_failure()
        if self._setpoint is None:
            self.begin_motion(now_s)
        self.check_motion(now_s)
        given_s = now_s if given_s is None else min(given_s, now_s)
        seq, received_s = self._echoes.at(given_s)
        expires_s = self._setpoint_expires_s(received_s, now_s)
        self._setpoint = _Setpoint(tuple(twist), frame, seq, expires_s)
        self._rest_seq = None
        # Measure from the last refresh, not the last repetition, which would delay this one.
        if now_s - self._refreshed_s < _SHORTEST_PERIOD_S:
            return None
        self._refreshed_s = now_s
        return self.command(twist, frame, now_s, seq)

    def _setpoint_expires_s(self, received_s: float, now_s: float) -> float:
        trip_s = self.delay_s(now_s)
        trip_s = self.round_trip_s if trip_s is None else trip_s
        counts_s = received_s + self.max_age_s - now_s - trip_s - _ZERO_LEAD_S
        return now_s + min(max(counts_s, _SHORTEST_SETPOINT_S), SETPOINT_TIMEOUT_S)

    def poll_command(self, now_s: float) -> TwistCommand | None:
        """Return the due command for the active setpoint, or a zero once it has expired.

        A failure ends the motion without another command; the next `set_velocity` raises it.
        """
        if self._setpoint is None:
            return None
        try:
            self.check_motion(now_s)
        except ClientError as error:
            self._failure = error
            self.end_motion()
            return None
        if self._rest_seq is not None and self.at_rest_since(self._rest_seq):
            self.end_motion()
            return None
        if now_s - self._sent_s < COMMAND_PERIOD_S - 1e-6:
            return None
        setpoint = self._setpoint
        if now_s < setpoint.expires_s:
            return self.command(setpoint.twist, setpoint.frame, now_s, setpoint.status_seq)
        command = self.command(ZERO_TWIST, BASE, now_s)
        self._rest_seq = command.seq if self._rest_seq is None else self._rest_seq
        return command

    def raise_failure(self) -> None:
        """Raise the error that ended the last setpoint, once.

        Raises:
            ClientError: If there is such an error.
        """
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    @property
    def next_due_s(self) -> float:
        """Time of the next call to `poll_command`, valid while a setpoint is active."""
        return self._sent_s + COMMAND_PERIOD_S

    @property
    def has_setpoint(self) -> bool:
        """Whether a setpoint or its final zero is being sent."""
        return self._setpoint is not None

    def end_setpoint(self) -> None:
        """Expire the setpoint now."""
        if self._setpoint is not None:
            self._setpoint = replace(self._setpoint, expires_s=-math.inf)

    # Latest state.

    def pose(self, now_s: float) -> SE2:
        """Return the estimated pose on the floor.

        Raises:
            RobotSilent: If the estimate is older than the maximum command age.
            ClientError: If the robot turns a sphere.
        """
        if self.kinematics.pose_type is SO3:
            raise ClientError(
                f"{self.robot_id} turns a sphere in place: it goes nowhere", "goes_nowhere"
            )
        if self._xy_heading is None or now_s - self._odometry_s > self.max_age_s:
            raise RobotSilent(
                f"{self.robot_id} has sent no odometry for {self.max_age_s:g} s", "no_status"
            )
        return SE2(self._xy_heading)

    @property
    def estimated_twist(self) -> Array | None:
        """(3,): latest estimated twist in the base frame, or None before any."""
        return self._twist

    def latch_reason(self) -> str:
        """Return the reason why the robot is latched, or ""."""
        return self._describe_mode("") if self.mode in LATCHED else ""

    def _check_silence(self, now_s: float) -> None:
        if now_s - self._status_s > STATUS_TIMEOUT_S:
            raise RobotSilent(
                f"{self.robot_id} has sent no status for {STATUS_TIMEOUT_S:g} s", "no_status"
            )

    def _stopped(self, what: str, code: str) -> RobotStopped:
        status = self.latest_status
        code = code if status.mode in _ARMED_AND_READY else f"robot_{status.mode}"
        return RobotStopped(self._describe_mode(what), code, status.stop)

    def _describe_mode(self, what: str) -> str:
        status = self.latest_status
        is_ready = status.mode in _ARMED_AND_READY
        text = f"{self.robot_id} {what if is_ready else f'is {status.mode}'}"
        return f"{text}: {status.stop_reason}" if status.stop_reason else text
