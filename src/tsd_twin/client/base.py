"""Common part of the synchronous and the asyncio interface: a robot, and control of it.

Methods that wait for the robot are declared once here, for both: of `RobotControl` they block and
return None, of `AsyncRobotControl` they are awaited.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from tsd_twin.client import motions, procedures
from tsd_twin.client.arguments import (
    check_duration,
    check_numbers,
    check_optional,
    check_text,
)
from tsd_twin.client.link import Link
from tsd_twin.client.motions import goal_along, goal_at
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.state import RobotState
from tsd_twin.client.steps import Procedure
from tsd_twin.errors import ClientError
from tsd_twin.lie import SE2
from tsd_twin.messages.requests import PoseStamped, encode_pose
from tsd_twin.messages.ros import BASE
from tsd_twin.robots import RobotDescription

QUEUE = 64
"""States or events that wait for a slow reader."""
_SHORTEST_SLEEP_S = 0.001

DoneT = TypeVar("DoneT")
"""What a method returns that waits for the robot: None, or an awaitable."""
LinkT = TypeVar("LinkT", bound=Link)
ControlT = TypeVar("ControlT", bound="BaseControl[Any, Any]")


def _usable(link: LinkT, process: int) -> LinkT:
    """Return a link in the process that opened it; its threads do not exist in a forked child."""
    if os.getpid() != process and not link.virtual:
        raise ClientError(
            f"this connection to {link.id} belongs to the parent of this process: connect again in "
            "the child, or start it with the method 'spawn'",
            "connection_of_parent",
        )
    return link


class BaseClient(ABC, Generic[LinkT, ControlT, DoneT]):
    """One robot: its newest state, and what needs no control of it."""

    def __init__(self, link: LinkT, operator: str) -> None:
        """`operator` is the default name of `control`."""
        self._own_link, self._process = link, os.getpid()
        self._operator = operator
        self._controls: list[ControlT] = []

    def __repr__(self) -> str:
        state = "closed" if self.link.closed else repr(self.state)
        return f"<{type(self).__name__} {self.id}: {state}>"

    @property
    def link(self) -> LinkT:
        """The connection; for other parts of this library.

        Raises:
            ClientError: this process is a forked child of the one that connected.
        """
        return _usable(self._own_link, self._process)

    @property
    def id(self) -> str:
        """The id of the robot on the bus."""
        return self.link.id

    @property
    def description(self) -> RobotDescription:
        """The description of the robot, with its limits and its kinematics."""
        return self.link.robot

    @property
    def state(self) -> RobotState:
        """The newest state."""
        return self.link.state()

    @property
    def time_s(self) -> float:
        """The monotonic clock; of a simulated robot, the virtual time."""
        return self.link.now_s()

    def stop(self, reason: str = "") -> DoneT:
        """Stop the robot and latch it; any client may. This is a software stop.

        Raises:
            RobotSilent: the robot did not acknowledge it.
        """
        check_text(reason=reason)
        return self._perform(lambda: procedures.stop(self.id, self._operator, reason))

    def reset(self) -> DoneT:
        """Unlatch a stopped or faulty robot without arming it; the lease is held meanwhile only.

        Raises:
            RequestRefused: it is not latched, or still gets commands.
            ControlDenied: another operator has control.
        """
        held = [control for control in self._controls if control.is_held]
        return held[0].reset() if held else self._perform(self._reset)

    def _reset(self) -> Procedure[None]:
        protocol = ControlProtocol(self.id, self.description, self._operator)
        self.link.attach(protocol)
        try:
            yield from procedures.reset_without_control(protocol, self.time_s)
        finally:
            self.link.detach(protocol)

    def publish_pose(
        self, x_m: float, y_m: float, heading_rad: float, *, stamp_s: float | None = None
    ) -> None:
        """Publish a pose that a sensor has measured, in `odom`; the robot fuses it.

        `stamp_s` is when it was measured, by the robot's wall clock, as `state.odom.stamp_s`; now
        if it is not given.
        """
        check_numbers(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        check_optional(stamp_s=stamp_s)
        stamp_ns = self.link.wall_ns() if stamp_s is None else round(stamp_s * 1e9)
        pose = SE2.identity()
        pose.xy_heading[:] = x_m, y_m, heading_rad
        self.link.send_pose(encode_pose(PoseStamped.planar(pose, stamp_ns)))

    def control(
        self,
        operator: str | None = None,
        *,
        take_over: bool = False,
        max_age_s: float | None = None,
        reason: str = "",
        arm: bool = True,
    ) -> ControlT:
        """Return control of the robot, to be entered with `with`: lease, then arming.

        On any exit it commands zero, disarms and releases. `take_over` takes the lease from its
        holder, with a `reason` for all to see; `max_age_s` lets older commands count on a slow
        link, at a lower speed limit; without `arm`, call `arm` yourself. Of `AsyncRobotClient`, it
        is entered with `async with`.
        """
        check_optional(max_age_s=max_age_s)
        check_text(operator=operator, reason=reason)
        wish = {"take_over": bool(take_over), "max_age_s": max_age_s, "reason": reason}
        return self._new_control(operator or self._operator, arm, wish, None)

    def request_control(
        self,
        operator: str | None = None,
        *,
        timeout_s: float = 15.0,
        max_age_s: float | None = None,
        arm: bool = True,
    ) -> ControlT:
        """Return control as `control` does, but ask its holder for it when it is entered.

        The holder has `timeout_s` to answer, 15 s at most.
        """
        check_optional(max_age_s=max_age_s)
        check_duration(timeout_s=timeout_s)
        check_text(operator=operator)
        wish = {"max_age_s": max_age_s}
        return self._new_control(operator or self._operator, arm, wish, timeout_s)

    def add_control(self, control: ControlT, *, active: bool) -> None:
        """Register or unregister a control; the library calls this."""
        self._controls = [each for each in self._controls if each is not control]
        if active:
            self._controls.append(control)

    @abstractmethod
    def _new_control(
        self, operator: str, arm: bool, wish: dict[str, Any], ask_s: float | None
    ) -> ControlT: ...

    @abstractmethod
    def _perform(self, begin: Callable[[], Procedure[None]]) -> DoneT: ...


class BaseControl(ABC, Generic[LinkT, DoneT]):
    """Control of a robot by one operator: modes, motions, settings, hand-over."""

    def __init__(
        self,
        link: LinkT,
        operator: str,
        arm: bool,
        wish: dict[str, Any],
        ask_s: float | None,
    ) -> None:
        self._own_link, self._process = link, os.getpid()
        self._protocol = ControlProtocol(link.id, link.robot, operator)
        self._arm, self._wish, self._ask_s = arm, wish, ask_s

    def __repr__(self) -> str:
        held = "has control of" if self.is_held else "has no control of"
        return f"<{type(self).__name__}: {self.operator} {held} {self._link.id}>"

    @property
    def operator(self) -> str:
        """The name under which the lease is held."""
        return self._protocol.operator

    @property
    def is_held(self) -> bool:
        """Whether the lease is held, as far as is known."""
        return self._protocol.has_lease

    @property
    def lost_reason(self) -> str:
        """Why the lease ended; empty before it was held."""
        return self._protocol.lost_reason

    @property
    def asked_by(self) -> str | None:
        """The operator who asks for control, if any."""
        return self._link.state().lease.asked_by

    # Hand-over and modes.

    def hand_over(self, asker: str | None = None) -> DoneT:
        """Hand control to the operator who asks for it; the robot stops, and stays armed.

        Raises:
            RequestRefused: no operator asks for it, or another one.
        """
        check_text(asker=asker)
        return self._perform(
            lambda: procedures.answer_request(self._protocol, grant=True, asker=asker)
        )

    def deny(self, asker: str | None = None) -> DoneT:
        """Deny the pending request for control.

        Raises:
            RequestRefused: no operator asks for it, or another one.
        """
        check_text(asker=asker)
        return self._perform(
            lambda: procedures.answer_request(self._protocol, grant=False, asker=asker)
        )

    def arm(self) -> DoneT:
        """Arm, and wait until the robot is ready: some three seconds.

        Raises:
            RequestRefused: the robot refuses, or gives arming up.
            RobotStopped: it is latched, and wants a reset first.
        """
        return self._perform(lambda: procedures.arm(self._protocol, self._now_s))

    def disarm(self) -> DoneT:
        """Disarm: the wheels spin down, after a controlled stop when the robot drives."""
        return self._perform(lambda: procedures.disarm(self._protocol, self._now_s))

    def stop(self, reason: str = "") -> DoneT:
        """Stop the robot and latch it: a software stop."""
        check_text(reason=reason)
        return self._perform(lambda: procedures.stop(self._link.id, self.operator, reason))

    def reset(self) -> DoneT:
        """Unlatch a stopped or faulty robot; it is disarmed then."""
        return self._perform(lambda: procedures.reset(self._protocol, self._now_s))

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
        """Drive for a time, then come to rest; returns when the robot stands.

        `frame` is `base_link`, the robot's own axes, or `odom`, those of the floor.

        Raises:
            ControlLost: the lease ended.
            RobotStopped: the robot is not ready, was stopped, or stopped by itself.
            RobotSilent: the robot sends no status.
        """
        protocol = self._protocol
        return self._perform(
            lambda: motions.drive(
                protocol,
                self._now_s,
                protocol.planar(vx_mps, vy_mps, omega_rad_per_s),
                duration_s,
                frame,
            )
        )

    def turn(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> DoneT:
        """Turn a sphere in place for a time, then come to rest; as `drive`."""
        protocol = self._protocol
        return self._perform(
            lambda: motions.drive(
                protocol,
                self._now_s,
                protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s),
                duration_s,
                frame,
            )
        )

    def set_velocity(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        frame: str = BASE,
        given_s: float | None = None,
    ) -> None:
        """Set a velocity for up to 0.2 s, and return at once.

        The library sends it at 50 Hz. A velocity that is not refreshed is replaced by zero, before
        it is older than the robot accepts. `given_s` is when a person or another program gave it,
        on the clock of `robot.time_s`; now if it is not given.

        Raises:
            ControlLost: the lease ended.
            RobotStopped: the robot is not ready, was stopped, or has stopped by itself.
            RobotSilent: the robot sends no status.
        """
        twist = self._protocol.planar(vx_mps, vy_mps, omega_rad_per_s)
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
        """Set an angular velocity of a sphere for up to 0.2 s; as `set_velocity`."""
        twist = self._protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        self._set_velocity(twist, frame, given_s)

    def rest(self) -> DoneT:
        """Bring the robot to rest, and return when it stands; it stays armed.

        Any other motion of this control ends.
        """
        return self._perform(lambda: motions.rest(self._protocol, self._now_s))

    def go_to(
        self,
        *,
        x_m: float,
        y_m: float,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> DoneT:
        """Go straight to a place in `odom`, closed loop, and return when the robot stands there.

        Without a heading, it keeps its own. `speed_mps` lowers the speed limit.

        Raises:
            PathError: there is no such path.
            MotionFailed: the robot left its path, or did not get there; it stands.
            ClientError: as `drive`.
        """
        return self._perform(
            lambda: motions.follow(
                self._protocol, self._now_s, goal_at(x_m, y_m, heading_rad), speed_mps
            )
        )

    def follow_path(
        self,
        points: Sequence[Sequence[float]],
        *,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> DoneT:
        """Follow a smooth line through `points` of (x, y) in metres, to the last of them.

        Raises:
            PathError, MotionFailed, ClientError: as `go_to`.
        """
        return self._perform(
            lambda: motions.follow(
                self._protocol, self._now_s, goal_along(points, heading_rad), speed_mps
            )
        )

    # Settings.

    def set_pose(self, *, x_m: float, y_m: float, heading_rad: float = 0.0) -> DoneT:
        """Set the pose estimate; at rest only.

        Raises:
            RequestRefused: it moves, or a number is not finite.
        """
        check_numbers(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        return self._perform(lambda: procedures.set_pose(self._protocol, x_m, y_m, heading_rad))

    def set_orientation(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, w: float = 1.0
    ) -> DoneT:
        """Set the orientation estimate of a sphere, a quaternion; at rest only."""
        check_numbers(x=x, y=y, z=z, w=w)
        return self._perform(lambda: procedures.set_orientation(self._protocol, x, y, z, w))

    def set_wheel_speed(self, rpm: float) -> DoneT:
        """Set the speed of wheels that always spin, until they are shut off.

        Raises:
            RequestRefused: the robot has no such wheels, or they cannot turn so fast.
        """
        check_numbers(rpm=rpm)
        return self._perform(lambda: procedures.set_wheel_speed(self._protocol, rpm))

    # Inside.

    @property
    def _link(self) -> LinkT:
        return _usable(self._own_link, self._process)

    @property
    def _now_s(self) -> float:
        return self._link.now_s()

    def _acquire_lease(self) -> Procedure[None]:
        if self._ask_s is None:
            return procedures.acquire(self._protocol, **self._wish)
        return procedures.ask_for_control(self._protocol, self._now_s, self._ask_s, **self._wish)

    def _set_velocity(self, twist: Sequence[float], frame: str, given_s: float | None) -> None:
        check_optional(given_s=given_s)
        with self._link.lock:
            command = self._protocol.set_velocity(twist, frame, self._now_s, given_s)
            if command is not None:
                self._link.send(command)
            self._wake_sender()

    def _send_due(self) -> float:
        """Send the set-point that is due; return when the next one is. Under the lock."""
        now_s = self._now_s
        command = self._protocol.due(now_s)
        if command is not None:
            self._link.send(command)
        return max(self._protocol.next_due_s, now_s + _SHORTEST_SLEEP_S)

    @abstractmethod
    def _perform(self, begin: Callable[[], Procedure[None]]) -> DoneT: ...

    @abstractmethod
    def _wake_sender(self) -> None: ...
