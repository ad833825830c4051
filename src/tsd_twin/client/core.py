"""Client interface shared by the synchronous and asyncio clients; see `base_control` for motions.

Methods that wait for the robot are declared here once: in `RobotControl` they block and return
None, in `AsyncRobotControl` they must be awaited.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from tsd_twin.client import procedures
from tsd_twin.client.arguments import check_duration, check_numbers, check_optional, check_text
from tsd_twin.client.errors import ClientError
from tsd_twin.client.link import Link
from tsd_twin.client.port import Procedure
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.state import RobotState
from tsd_twin.lie import SE2
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.robots import RobotDescription

QUEUE = 64
"""Maximum number of states or events queued for a slow consumer."""

DoneT = TypeVar("DoneT")
"""Return type of methods that wait for the robot: None or an awaitable."""
ControlT = TypeVar("ControlT", bound="ClientControl")
Acquire: TypeAlias = Callable[[ControlProtocol, float], Procedure[None]]
"""Returns the procedure that acquires the lease, for a protocol and the time."""


class ClientControl(Protocol):
    """Control as its client uses it; see `BaseControl`."""

    @property
    def is_held(self) -> bool:
        """Whether the lease is held, as far as the client knows."""
        ...

    def reset(self) -> Any:
        """Unlatch a stopped or faulty robot; it is then disarmed."""


class BaseClient(ABC, Generic[ControlT, DoneT]):
    """Robot client: latest state and operations that need no lease."""

    def __init__(self, link: Link, operator: str) -> None:
        """`operator` is the default name of `control`."""
        self._own_link, self._process = link, os.getpid()
        self._operator = operator
        self._controls: list[ControlT] = []

    def __repr__(self) -> str:
        state = "closed" if self.link.closed else repr(self.state)
        return f"<{type(self).__name__} {self.id}: {state}>"

    @property
    def link(self) -> Link:
        """Connection, for internal use.

        Raises:
            ClientError: If called in a forked child of the process that connected.
        """
        link = self._own_link
        if os.getpid() != self._process and not link.virtual:
            # The threads of the connection do not survive a fork.
            raise ClientError(
                f"this connection to {link.id} belongs to the parent of this process: connect "
                "again in the child, or start it with the method 'spawn'",
                "connection_of_parent",
            )
        return link

    @property
    def id(self) -> str:
        """Robot id on the bus."""
        return self.link.id

    @property
    def description(self) -> RobotDescription:
        """Robot description with limits and kinematics."""
        return self.link.robot

    @property
    def state(self) -> RobotState:
        """Latest state."""
        return self.link.state()

    @property
    def time_s(self) -> float:
        """Monotonic time, or virtual time for simulated robots."""
        return self.link.now_s()

    def stop(self, reason: str = "") -> DoneT:
        """Stop and latch the robot (software stop); any client may call this.

        Raises:
            RobotSilent: If no acknowledgement arrives.
        """
        check_text(reason=reason)
        return self.perform(lambda: procedures.stop(self.id, self._operator, reason))

    def reset(self) -> DoneT:
        """Unlatch a stopped or faulty robot without arming it, holding the lease only briefly.

        Raises:
            RequestRefused: If it is not latched or still receives commands.
            ControlDenied: If another operator has control.
        """
        held = [control for control in self._controls if control.is_held]
        return held[0].reset() if held else self.perform(self._reset)

    def _reset(self) -> Procedure[None]:
        protocol = self.link.protocol(self._operator)
        self.link.attach(protocol)
        try:
            yield from procedures.reset_without_control(protocol, self.time_s)
        finally:
            self.link.detach(protocol)

    def publish_pose(
        self, x_m: float, y_m: float, heading_rad: float, *, stamp_s: float | None = None
    ) -> None:
        """Publish a measured pose in `odom`, for the robot to fuse.

        `stamp_s` is the measurement time on the robot's wall clock, as in `state.odom.stamp_s`; by
        default now.
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
        """Return a control to use in `with`, which acquires the lease and arms.

        On exit it commands zero, disarms and releases. `take_over` takes the lease from its holder,
        with a public `reason`. `max_age_s` accepts older commands on a slow link, at a lower speed
        limit. Without `arm`, call `arm` yourself. For `AsyncRobotClient`, use `async with`.
        """
        check_optional(max_age_s=max_age_s)
        check_text(operator=operator, reason=reason)
        wish = {"take_over": bool(take_over), "max_age_s": max_age_s, "reason": reason}
        return self._new_control(
            operator or self._operator,
            arm,
            lambda protocol, _: procedures.acquire(protocol, **wish),
        )

    def request_control(
        self,
        operator: str | None = None,
        *,
        timeout_s: float = 15.0,
        max_age_s: float | None = None,
        arm: bool = True,
    ) -> ControlT:
        """Return a control like `control`, which requests the lease from its holder on entry.

        The holder has `timeout_s` to respond, at most 15 s.
        """
        check_optional(max_age_s=max_age_s)
        check_duration(timeout_s=timeout_s)
        check_text(operator=operator)
        return self._new_control(
            operator or self._operator,
            arm,
            lambda protocol, now_s: procedures.ask_for_control(
                protocol, now_s, timeout_s, max_age_s=max_age_s
            ),
        )

    def add_control(self, control: ControlT, *, active: bool) -> None:
        """Register or unregister a control (internal)."""
        self._controls = [each for each in self._controls if each is not control]
        if active:
            self._controls.append(control)

    @abstractmethod
    def _new_control(self, operator: str, arm: bool, acquire: Acquire) -> ControlT: ...

    @abstractmethod
    def perform(self, begin: Callable[[], Procedure[None]]) -> DoneT:
        """Begin a procedure and run it (internal)."""
