"""Robot state as values, and bounded queues of states and events."""

from __future__ import annotations

import collections
import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import LeaseStatus, RobotStatus

T = TypeVar("T")


class PlanarPose(NamedTuple):
    """Planar pose in `odom`, with the heading in (-pi, pi], counter-clockwise from X."""

    x_m: float
    y_m: float
    heading_rad: float


class PlanarTwist(NamedTuple):
    """Planar velocity in `base_link`: X forward, Y left, counter-clockwise positive."""

    vx_mps: float
    vy_mps: float
    omega_rad_per_s: float


class Quaternion(NamedTuple):
    """Unit quaternion in `odom`."""

    w: float
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True, eq=False)
class OdometryState:
    """Pose in `odom` and velocity in `base_link`."""

    message: Odometry
    """Received message, including covariances."""

    @property
    def pose(self) -> PlanarPose:
        """Pose on the floor.

        Raises:
            TwinError: If the robot turns a sphere; use `orientation`.
        """
        if self.message.wxyz is not None:
            raise TwinError("this robot turns a sphere in place: read its orientation")
        return PlanarPose(*(float(number) for number in self.message.xy_heading))

    @property
    def se2(self) -> SE2:
        """Pose on the floor as an element of SE(2)."""
        return SE2(np.array(self.pose))

    @property
    def orientation(self) -> Quaternion:
        """Orientation in space; a rotation about Z for robots on a floor."""
        if self.message.wxyz is not None:
            return Quaternion(*(float(number) for number in self.message.wxyz))
        half = 0.5 * float(self.message.xy_heading[2])
        return Quaternion(math.cos(half), 0.0, 0.0, math.sin(half))

    @property
    def twist(self) -> PlanarTwist:
        """Planar velocity.

        Raises:
            TwinError: If the robot turns a sphere; use `angular_velocity_rad_per_s`.
        """
        if self.message.wxyz is not None:
            raise TwinError("this robot turns a sphere in place: read its angular velocity")
        return PlanarTwist(*(float(number) for number in self.message.twist))

    @property
    def angular_velocity_rad_per_s(self) -> tuple[float, float, float]:
        """Angular velocity about X, Y and Z."""
        x, y, z = (float(number) for number in self.message.twist)
        return (x, y, z) if self.message.wxyz is not None else (0.0, 0.0, z)

    @property
    def covariance(self) -> Array:
        """(3, 3): x, y, heading; for spheres, small rotations about the axes of `odom`."""
        return self.message.pose_covariance

    @property
    def stamp_s(self) -> float:
        """Measurement time on the robot's wall clock."""
        return self.message.stamp_ns * 1e-9

    def __repr__(self) -> str:
        if self.message.wxyz is None:
            return f"OdometryState({self.pose}, {self.twist})"
        return f"OdometryState({self.orientation}, {self.angular_velocity_rad_per_s} rad/s)"


@dataclass(frozen=True, eq=False)
class RobotState:
    """Snapshot of a robot; messages are decoded on first access."""

    status: RobotStatus
    """Full `state/status`; see docs/bus.md for the fields."""
    received_s: float
    """Arrival time of the latest message in it, on this process's monotonic clock."""
    _odom: Callable[[], Odometry]
    _truth: Callable[[], Odometry | None]
    _alternative: Callable[[], Odometry | None]
    _joints: Callable[[], JointState]
    _setpoint: Callable[[], JointState]

    @property
    def mode(self) -> Mode:
        """Operating mode."""
        return Mode(self.status.mode)

    @property
    def stop_reason(self) -> str:
        """Reason why the robot stopped, is stopping or was disarmed."""
        return self.status.stop_reason

    @property
    def lease(self) -> LeaseStatus:
        """Lease holder and pending request."""
        return self.status.lease

    @cached_property
    def odom(self) -> OdometryState:
        """Estimated pose and velocity."""
        return OdometryState(self._odom())

    @cached_property
    def truth(self) -> OdometryState | None:
        """Ground-truth pose and velocity (simulated robots only)."""
        message = self._truth()
        return None if message is None else OdometryState(message)

    @cached_property
    def odom_alternative(self) -> OdometryState | None:
        """Second estimate, if the robot has one."""
        message = self._alternative()
        return None if message is None else OdometryState(message)

    @cached_property
    def joints(self) -> JointState:
        """Measured joints; NaN where not measured."""
        return self._joints()

    @cached_property
    def setpoint(self) -> JointState:
        """Joint setpoints."""
        return self._setpoint()

    def __repr__(self) -> str:
        reason = f", {self.stop_reason!r}" if self.stop_reason else ""
        return f"RobotState({self.mode.value}{reason}, {self.odom})"


class Subscription(Generic[T]):
    """Bounded, iterable queue of states or events; close it after use.

    If the consumer is slow, the oldest items are dropped and counted. Readable from any thread.
    """

    def __init__(self, maxlen: int) -> None:
        self._items: collections.deque[T] = collections.deque(maxlen=maxlen)
        self._ready = threading.Condition()
        self._closed = False
        self.dropped = 0
        """Number of dropped items."""

    def put(self, item: T) -> None:
        """Add an item (internal)."""
        with self._ready:
            if not self._closed:
                self.dropped += len(self._items) == self._items.maxlen
                self._items.append(item)
                self._ready.notify()

    def get(self, timeout_s: float | None = None) -> T | None:
        """Return the oldest item, or None on timeout or if closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._items or self._closed, timeout_s)
            return self._items.popleft() if self._items else None

    def take(self) -> list[T]:
        """Return all queued items, oldest first, without waiting."""
        with self._ready:
            items = list(self._items)
            self._items.clear()
            return items

    def close(self) -> None:
        """Close the subscription and end its iterators."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def closed(self) -> bool:
        """Whether the subscription is closed."""
        return self._closed

    def __iter__(self) -> Iterator[T]:
        while (item := self.get()) is not None:
            yield item

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CallbackSubscription(Subscription[T]):
    """Subscription that passes items to a callback immediately, on the thread of `put`."""

    def __init__(self, callback: Callable[[T], None]) -> None:
        super().__init__(1)
        self._callback = callback

    def put(self, item: T) -> None:
        """Pass an item to the callback (internal)."""
        if not self.closed:
            self._callback(item)
