"""Interface of a control of a robot, shared by the synchronous and asyncio clients.

Methods that wait for the robot return `DoneT`, as in `core`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from tsd_twin.client import motions, procedures
from tsd_twin.client.arguments import check_numbers, check_optional, check_text
from tsd_twin.client.core import Acquire, BaseClient, DoneT
from tsd_twin.client.errors import ClientError
from tsd_twin.client.link import Link
from tsd_twin.client.motions import goal_along, goal_at
from tsd_twin.client.port import Procedure
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.lie import SO3
from tsd_twin.messages.cdr import BASE

_SHORTEST_SLEEP_S = 0.001

P = ParamSpec("P")
ClientT = TypeVar("ClientT", bound=BaseClient[Any, Any])


class BaseControl(ABC, Generic[ClientT, DoneT]):
    """Control of a robot by one operator: modes, motions, settings, handover."""

    def __init__(self, robot: ClientT, operator: str, arm: bool, acquire: Acquire) -> None:
        self.robot = robot
        self._protocol = robot.link.protocol(operator)
        self._arm, self._acquire = arm, acquire

    def __repr__(self) -> str:
        held = "has control of" if self.is_held else "has no control of"
        return f"<{type(self).__name__}: {self.operator} {held} {self._link.id}>"

    @property
    def operator(self) -> str:
        """Operator name in the lease."""
        return self._protocol.operator

    @property
    def is_held(self) -> bool:
        """Whether the lease is held, as far as the client knows."""
        return self._protocol.has_lease

    @property
    def lost_reason(self) -> str:
        """Reason why the lease ended, or "" if it was never held."""
        return self._protocol.lost_reason

    @property
    def requested_by(self) -> str | None:
        """Operator requesting control, if any."""
        return self._link.state().lease.requested_by

    # Handover and modes.

    def hand_over(self, asker: str | None = None) -> DoneT:
        """Transfer control to the requesting operator; the robot stops and stays armed.

        Raises:
            RequestRefused: If there is no request, or it is from another operator.
        """
        check_text(asker=asker)
        return self._perform(procedures.answer_request, grant=True, asker=asker)

    def deny(self, asker: str | None = None) -> DoneT:
        """Deny the pending request for control.

        Raises:
            RequestRefused: If there is no request, or it is from another operator.
        """
        check_text(asker=asker)
        return self._perform(procedures.answer_request, grant=False, asker=asker)

    def arm(self) -> DoneT:
        """Arm and wait until the robot is ready (about 3 s).

        Raises:
            RequestRefused: If the robot refuses or aborts arming.
            RobotStopped: If it is latched and needs a reset first.
        """
        return self._perform_now(procedures.arm)

    def disarm(self) -> DoneT:
        """Disarm: stop if driving, then spin the wheels down."""
        return self._perform_now(procedures.disarm)

    def stop(self, reason: str = "") -> DoneT:
        """Stop and latch the robot (software stop)."""
        check_text(reason=reason)
        return self.robot.perform(lambda: procedures.stop(self._link.id, self.operator, reason))

    def reset(self) -> DoneT:
        """Unlatch a stopped or faulty robot; it is then disarmed."""
        return self._perform_now(procedures.reset)

    # Motions.

    def drive(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> DoneT:
        """Drive for `duration_s`, then stop; return once the robot is at rest.

        `frame` is `base_link` for robot axes or `odom` for floor axes.

        Raises:
            ControlLost: If the lease ends.
            RobotStopped: If the robot is not ready, is stopped or stops automatically.
            RobotSilent: If the robot sends no status.
        """
        twist = self._planar(vx_mps, vy_mps, omega_rad_per_s)
        return self._perform_now(motions.drive, twist, duration_s, frame)

    def turn(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> DoneT:
        """Turn a sphere in place for `duration_s`, then stop; see `drive`."""
        twist = self._spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        return self._perform_now(motions.drive, twist, duration_s, frame)

    def set_velocity(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        frame: str = BASE,
        given_s: float | None = None,
    ) -> None:
        """Set a velocity for up to 0.2 s and return immediately.

        The library sends it at 50 Hz. Without a refresh it is replaced by zero before the robot
        would reject it as too old. `given_s` is the time of the original input on the clock of
        `robot.time_s`; by default now.

        Raises:
            ControlLost: If the lease has ended.
            RobotStopped: If the robot is not ready, was stopped or stopped automatically.
            RobotSilent: If the robot sends no status.
        """
        twist = self._planar(vx_mps, vy_mps, omega_rad_per_s)
        self._set_velocity(twist, frame, given_s)

    def set_turn_rate(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        frame: str = BASE,
        given_s: float | None = None,
    ) -> None:
        """Set an angular velocity of a sphere for up to 0.2 s; see `set_velocity`."""
        twist = self._spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        self._set_velocity(twist, frame, given_s)

    def rest(self) -> DoneT:
        """Stop the robot and return once it is at rest; it stays armed.

        Ends any other motion of this control.
        """
        return self._perform_now(motions.rest)

    def go_to(
        self,
        *,
        x_m: float,
        y_m: float,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> DoneT:
        """Drive straight to a point in `odom` (closed loop); return once at rest there.

        Feedback is the robot's estimate, `state.odom`, which includes poses of a pose sensor if one
        reports them. Without, the true position is off by the drift of the estimate; see its
        `pose_covariance`. Without `heading_rad`, the heading is kept. `speed_mps` lowers the speed
        limit.

        Raises:
            PathError: If no such path exists.
            MotionFailed: If the robot leaves the path or misses the goal. It is then at rest.
            ClientError: As for `drive`.
        """
        goal = goal_at(x_m, y_m, heading_rad)
        return self._perform_now(motions.follow, goal, speed_mps)

    def follow_path(
        self,
        points: Sequence[Sequence[float]],
        *,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> DoneT:
        """Follow a smooth path through `points` of (x, y) in metres and stop at the last one.

        Raises:
            PathError, MotionFailed, ClientError: As for `go_to`.
        """
        return self._perform_now(motions.follow, goal_along(points, heading_rad), speed_mps)

    # Settings.

    def set_pose(self, *, x_m: float, y_m: float, heading_rad: float = 0.0) -> DoneT:
        """Set the pose estimate; the robot must be at rest.

        Raises:
            RequestRefused: If the robot moves or a number is not finite.
        """
        check_numbers(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        return self._perform(procedures.set_pose, x_m, y_m, heading_rad)

    def set_orientation(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, w: float = 1.0
    ) -> DoneT:
        """Set the orientation estimate (quaternion) of a sphere; the robot must be at rest."""
        check_numbers(x=x, y=y, z=z, w=w)
        return self._perform(procedures.set_orientation, x, y, z, w)

    def set_wheel_speed(self, rpm: float) -> DoneT:
        """Set the speed of continuously spinning wheels until they are switched off.

        Raises:
            RequestRefused: If the robot has no such wheels or `rpm` is out of range.
        """
        check_numbers(rpm=rpm)
        return self._perform(procedures.set_wheel_speed, rpm)

    # Internals.

    @property
    def _link(self) -> Link:
        return self.robot.link

    @property
    def _now_s(self) -> float:
        return self._link.now_s()

    def _planar(self, vx_mps: float, vy_mps: float, omega_rad_per_s: float) -> Sequence[float]:
        """Return a planar twist (3,), in m/s and rad/s.

        Raises:
            ClientError: If the robot turns a sphere or a number is not finite.
        """
        if self._protocol.kinematics.pose_type is SO3:
            raise ClientError(
                f"{self._protocol.robot_id} turns a sphere in place: use turn, set_turn_rate",
                "use_turn",
            )
        check_numbers(vx_mps=vx_mps, vy_mps=vy_mps, omega_rad_per_s=omega_rad_per_s)
        return (vx_mps, vy_mps, omega_rad_per_s)

    def _spherical(
        self, wx_rad_per_s: float, wy_rad_per_s: float, wz_rad_per_s: float
    ) -> Sequence[float]:
        """Return the angular velocity (3,) of a sphere, in rad/s.

        Raises:
            ClientError: If the robot does not turn a sphere or a number is not finite.
        """
        if self._protocol.kinematics.pose_type is not SO3:
            raise ClientError(
                f"{self._protocol.robot_id} turns no sphere: use drive, set_velocity", "use_drive"
            )
        check_numbers(
            wx_rad_per_s=wx_rad_per_s, wy_rad_per_s=wy_rad_per_s, wz_rad_per_s=wz_rad_per_s
        )
        return (wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)

    def _set_velocity(self, twist: Sequence[float], frame: str, given_s: float | None) -> None:
        check_optional(given_s=given_s)
        with self._link.lock:
            command = self._protocol.set_velocity(twist, frame, self._now_s, given_s)
            if command is not None:
                self._link.send(command)
            self._wake_sender()

    def _send_due(self) -> float:
        """Send a due setpoint; return the time of the next one. Requires the lock."""
        now_s = self._now_s
        command = self._protocol.poll_command(now_s)
        if command is not None:
            self._link.send(command)
        return max(self._protocol.next_due_s, now_s + _SHORTEST_SLEEP_S)

    def _perform(
        self,
        begin: Callable[Concatenate[ControlProtocol, P], Procedure[None]],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> DoneT:
        return self.robot.perform(lambda: begin(self._protocol, *args, **kwargs))

    def _perform_now(
        self,
        begin: Callable[Concatenate[ControlProtocol, float, P], Procedure[None]],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> DoneT:
        """Perform a procedure with the time at which it begins."""
        return self.robot.perform(lambda: begin(self._protocol, self._now_s, *args, **kwargs))

    @abstractmethod
    def _wake_sender(self) -> None: ...
