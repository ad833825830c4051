"""Asyncio client: the interface of `robot`, with coroutines in place of blocking calls.

Everything belongs to one event loop, which also sends the set-points: an event loop that is blocked
sends nothing, so the robot stops. Calls to the robot wait on threads.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

from tsd_twin.client import procedures
from tsd_twin.client.discovery import open_link
from tsd_twin.client.link import BusLink
from tsd_twin.client.navigation import goal_along, goal_at
from tsd_twin.client.procedures import (
    Call,
    Compute,
    NextStatus,
    Outcome,
    Procedure,
    Send,
    SendStop,
    Sleep,
    Step,
)
from tsd_twin.client.protocol import RENEW_PERIOD_S, ControlProtocol
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.lie import SE2
from tsd_twin.messages.commands import PoseStamped, encode_pose
from tsd_twin.messages.ros import BASE
from tsd_twin.messages.services import Event
from tsd_twin.messages.topics import Service
from tsd_twin.motion.routes import NavigationGoal
from tsd_twin.robots import RobotDescription

_QUEUE = 64
_SHORTEST_SLEEP_S = 0.001

T = TypeVar("T")


class AsyncRobotClient:
    """One robot on the bus, for one event loop; made by `connect_async`."""

    def __init__(self, link: BusLink, operator: str) -> None:
        self.link = link
        self._operator = operator
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._woken = False
        self._controls: list[AsyncRobotControl] = []
        link.on_change(self._wake_from_thread)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self.link.closed else repr(self.state)
        return f"<AsyncRobotClient {self.id}: {state}>"

    async def close(self) -> None:
        """Give back control, if it is held, and leave the bus."""
        try:
            for control in list(self._controls):
                await control.release()
        finally:
            await asyncio.to_thread(self.link.close)

    # The state.

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
        """The monotonic clock."""
        return self.link.now_s()

    async def sleep(self, seconds: float) -> None:
        """Wait."""
        await asyncio.sleep(seconds)

    async def states(
        self, duration_s: float | None = None, *, maxlen: int = _QUEUE
    ) -> AsyncIterator[RobotState]:
        """Yield each new state, 50 a second, for a duration or until the robot is closed.

        When the reader is slower, the oldest ones beyond `maxlen` are dropped.
        """
        end_s = None if duration_s is None else self.time_s + duration_s
        with self.link.subscribe_states(Subscription[RobotState](maxlen)) as subscription:
            while not self.link.closed and (end_s is None or self.time_s < end_s):
                for state in subscription.take():
                    yield state
                await self.changed(0.1)

    async def events(self, *, maxlen: int = _QUEUE) -> AsyncIterator[Event]:
        """Yield the newest events of the past and each new one, until the robot is closed."""
        with self.link.subscribe_events(Subscription[Event](maxlen)) as subscription:
            while not self.link.closed:
                for event in subscription.take():
                    yield event
                await self.changed(0.1)

    async def changed(self, timeout_s: float) -> None:
        """Wait until something new has come in, or for a time."""
        self._changed.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), timeout_s)

    def _wake_from_thread(self) -> None:
        # Under the lock of the link. One wake-up at most waits in the loop, however slow it is.
        if not self._woken:
            self._woken = True
            with contextlib.suppress(RuntimeError):  # The loop is closed.
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._woken = False
        self._changed.set()

    # Without control.

    async def stop(self, reason: str = "") -> None:
        """Stop the robot and latch it; any client may. This is a software stop.

        Raises:
            RobotSilent: the robot did not acknowledge it.
        """
        await self.run(procedures.stop(self.id, self._operator, reason))

    def publish_pose(
        self, x_m: float, y_m: float, heading_rad: float, *, stamp_s: float | None = None
    ) -> None:
        """Publish a pose that a sensor has measured; as `RobotClient.publish_pose`."""
        stamp_ns = self.link.wall_ns() if stamp_s is None else round(stamp_s * 1e9)
        pose = SE2.identity()
        pose.xy_heading[:] = x_m, y_m, heading_rad
        self.link.send_pose(encode_pose(PoseStamped.planar(pose, stamp_ns)))

    # Control.

    def control(
        self,
        operator: str | None = None,
        *,
        take_over: bool = False,
        max_age_s: float | None = None,
        reason: str = "",
        arm: bool = True,
    ) -> AsyncRobotControl:
        """Return control, to be entered with `async with`; as `RobotClient.control`."""
        wish = {"take_over": take_over, "max_age_s": max_age_s, "reason": reason}
        return AsyncRobotControl(self, operator or self._operator, arm=arm, wish=wish)

    def request_control(
        self,
        operator: str | None = None,
        *,
        timeout_s: float = 15.0,
        max_age_s: float | None = None,
        arm: bool = True,
    ) -> AsyncRobotControl:
        """Return control that asks its holder; as `RobotClient.request_control`."""
        return AsyncRobotControl(
            self,
            operator or self._operator,
            arm=arm,
            wish={"max_age_s": max_age_s},
            ask_s=timeout_s,
        )

    def add_control(self, control: AsyncRobotControl, *, active: bool) -> None:
        """Register or unregister a control; the library calls this."""
        self._controls = [each for each in self._controls if each is not control]
        if active:
            self._controls.append(control)

    async def run(self, procedure: Procedure[T]) -> T:
        """Run a procedure; an error or cancellation of a step is raised inside it."""
        outcome: Outcome | None = None
        error: BaseException | None = None
        while True:
            try:
                with self.link.lock:
                    if error is not None:
                        step = procedure.throw(error)
                    else:
                        step = next(procedure) if outcome is None else procedure.send(outcome)
                    if isinstance(step, Send):
                        self.link.send(step.command)
            except StopIteration as done:
                return done.value
            try:
                outcome, error = await self._perform(step), None
            except BaseException as raised:
                error = raised

    async def _perform(self, step: Step) -> Outcome:
        answer, value, link = None, None, self.link
        match step:
            case Call(service, payload, timeout_s):
                answer = await asyncio.to_thread(link.call, service, payload, timeout_s)
            case SendStop(payload):
                link.send_stop(payload)
            case Sleep(until_s):
                await asyncio.sleep(max(0.0, until_s - link.now_s()))
            case NextStatus(until_s):
                await self._next_status(until_s)
            case Compute(function):
                value = await asyncio.to_thread(function)
            case Send():
                pass
        return Outcome(link.now_s(), answer, value)

    async def _next_status(self, until_s: float) -> None:
        seen = self.state.status
        while self.state.status is seen and (left_s := until_s - self.time_s) > 0.0:
            await self.changed(left_s)


class AsyncRobotControl:
    """Control of a robot by one operator; as `RobotControl`, with coroutines."""

    def __init__(
        self,
        robot: AsyncRobotClient,
        operator: str,
        *,
        arm: bool,
        wish: dict[str, Any],
        ask_s: float | None = None,
    ) -> None:
        self.robot = robot
        self._protocol = ControlProtocol(robot.id, robot.description, operator)
        self._arm, self._wish, self._ask_s = arm, wish, ask_s
        self._tasks: list[asyncio.Task[None]] = []
        self._has_setpoint = asyncio.Event()

    async def __aenter__(self) -> Self:
        await self.acquire()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.release()

    def __repr__(self) -> str:
        held = "has control of" if self.is_held else "has no control of"
        return f"<AsyncRobotControl: {self.operator} {held} {self.robot.id}>"

    @property
    def operator(self) -> str:
        """The name under which the lease is held."""
        return self._protocol.operator

    @property
    def is_held(self) -> bool:
        """Whether the lease is held, as far as is known."""
        return self._protocol.has_lease

    # The lease.

    async def acquire(self) -> None:
        """Acquire the lease and arm; as `RobotControl.acquire`."""
        self.robot.link.attach(self._protocol)
        self.robot.add_control(self, active=True)
        try:
            if self._ask_s is None:
                acquiring = procedures.acquire(self._protocol, **self._wish)
            else:
                acquiring = procedures.ask_for_control(
                    self._protocol, self._now_s, self._ask_s, **self._wish
                )
            await self.robot.run(acquiring)
            for work in (self._renew(), self._send_setpoints()):
                self._tasks.append(asyncio.create_task(work))
            if self._arm:
                await self.arm()
        except BaseException:
            await self.release()
            raise

    async def release(self) -> None:
        """Command zero, disarm and release, also when the task is cancelled meanwhile."""
        await _uncancelled(self._release())

    async def _release(self) -> None:
        try:
            await self.robot.run(procedures.give_back(self._protocol, self._now_s))
        finally:
            for task in self._tasks:
                task.cancel()
            self._tasks = []
            self.robot.link.detach(self._protocol)
            self.robot.add_control(self, active=False)

    @property
    def asked_by(self) -> str | None:
        """The operator who asks for control, if any."""
        return self.robot.state.lease.asked_by

    async def hand_over(self, asker: str | None = None) -> None:
        """Hand control over; as `RobotControl.hand_over`."""
        await self.robot.run(procedures.answer_request(self._protocol, grant=True, asker=asker))

    async def deny(self, asker: str | None = None) -> None:
        """Keep control; as `RobotControl.deny`."""
        await self.robot.run(procedures.answer_request(self._protocol, grant=False, asker=asker))

    # Modes.

    async def arm(self) -> None:
        """Arm; as `RobotControl.arm`."""
        await self.robot.run(procedures.arm(self._protocol, self._now_s))

    async def disarm(self) -> None:
        """Disarm; as `RobotControl.disarm`."""
        await self.robot.run(procedures.disarm(self._protocol, self._now_s))

    async def stop(self, reason: str = "") -> None:
        """Stop the robot and latch it: a software stop."""
        await self.robot.run(procedures.stop(self.robot.id, self.operator, reason))

    async def reset(self) -> None:
        """Unlatch a stopped or faulty robot; it is disarmed then."""
        await self.robot.run(procedures.reset(self._protocol, self._now_s))

    # Motions.

    async def drive(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> None:
        """Drive for a time, then come to rest; as `RobotControl.drive`.

        When the task is cancelled, a zero is sent first.
        """
        twist = self._protocol.planar(vx_mps, vy_mps, omega_rad_per_s)
        await self._drive(twist, duration_s, frame)

    async def turn(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> None:
        """Turn a sphere in place for a time; as `RobotControl.turn`."""
        twist = self._protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        await self._drive(twist, duration_s, frame)

    async def _drive(self, twist: Sequence[float], duration_s: float, frame: str) -> None:
        await self.robot.run(
            procedures.drive(self._protocol, self._now_s, twist, duration_s, frame)
        )

    def set_velocity(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        frame: str = BASE,
    ) -> None:
        """Put a velocity set-point in force for 0.2 s; as `RobotControl.set_velocity`."""
        self._set_velocity(self._protocol.planar(vx_mps, vy_mps, omega_rad_per_s), frame)

    def set_turn_rate(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        frame: str = BASE,
    ) -> None:
        """Put an angular velocity of a sphere in force for 0.2 s."""
        twist = self._protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        self._set_velocity(twist, frame)

    def _set_velocity(self, twist: Sequence[float], frame: str) -> None:
        link = self.robot.link
        with link.lock:
            command = self._protocol.set_velocity(twist, frame, self._now_s)
            if command is not None:
                link.send(command)
        self._has_setpoint.set()

    async def rest(self) -> None:
        """Bring the robot to rest; as `RobotControl.rest`."""
        await self.robot.run(procedures.rest(self._protocol, self._now_s))

    async def go_to(
        self,
        *,
        x_m: float,
        y_m: float,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        """Go straight to a place; as `RobotControl.go_to`."""
        await self._follow(goal_at(x_m, y_m, heading_rad), speed_mps)

    async def follow_path(
        self,
        points: Sequence[Sequence[float]],
        *,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        """Follow a smooth line; as `RobotControl.follow_path`."""
        await self._follow(goal_along(points, heading_rad), speed_mps)

    async def _follow(self, goal: NavigationGoal, speed_mps: float | None) -> None:
        await self.robot.run(procedures.follow(self._protocol, self._now_s, goal, speed_mps))

    # Settings.

    async def set_pose(self, *, x_m: float, y_m: float, heading_rad: float = 0.0) -> None:
        """Set the pose estimate; at rest only."""
        await self.robot.run(procedures.set_pose(self._protocol, x_m, y_m, heading_rad))

    async def set_orientation(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, w: float = 1.0
    ) -> None:
        """Set the orientation estimate of a sphere, a quaternion; at rest only."""
        await self.robot.run(procedures.set_orientation(self._protocol, x, y, z, w))

    async def set_wheel_speed(self, rpm: float) -> None:
        """Set the speed of wheels that always spin."""
        await self.robot.run(procedures.set_wheel_speed(self._protocol, rpm))

    # Inside.

    @property
    def _now_s(self) -> float:
        return self.robot.link.now_s()

    async def _renew(self) -> None:
        link = self.robot.link
        while True:
            await asyncio.sleep(0.5 * RENEW_PERIOD_S)
            began_s = self._now_s
            with link.lock:
                request = self._protocol.renewal(began_s)
            if request is not None:
                answer = await asyncio.to_thread(link.call, Service.LEASE, request, 1.0)
                with link.lock:
                    self._protocol.receive_renewal(request, answer, self._now_s - began_s)

    async def _send_setpoints(self) -> None:
        link = self.robot.link
        while await self._has_setpoint.wait():
            with link.lock:
                now_s = self._now_s
                command = self._protocol.due(now_s)
                if command is not None:
                    link.send(command)
                if not self._protocol.has_setpoint:
                    self._has_setpoint.clear()
                wait_s = max(self._protocol.next_due_s - now_s, _SHORTEST_SLEEP_S)
            await asyncio.sleep(wait_s)


class _Connecting:
    """Pending connection from `connect_async`: await it, or enter it with `async with`."""

    def __init__(self, opening: Coroutine[Any, Any, AsyncRobotClient]) -> None:
        self._opening = opening
        self._robot: AsyncRobotClient | None = None

    def __await__(self) -> Any:
        return self._opening.__await__()

    async def __aenter__(self) -> AsyncRobotClient:
        self._robot = await self._opening
        return self._robot

    async def __aexit__(self, *_: object) -> None:
        if self._robot is not None:
            await self._robot.close()


def connect_async(
    endpoint: str | Sequence[str] | None = None,
    *,
    robot: str | None = None,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> _Connecting:
    """Connect to a robot from an event loop; await it, or enter it with `async with`.

    Arguments and errors are those of `connect`.
    """
    return _Connecting(_open(endpoint, robot, certificate, zenoh_config))


async def _open(
    endpoint: str | Sequence[str] | None,
    robot: str | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> AsyncRobotClient:
    link, operator = await asyncio.to_thread(open_link, endpoint, robot, certificate, zenoh_config)
    return AsyncRobotClient(link, operator)


async def _uncancelled(work: Coroutine[Any, Any, None]) -> None:
    """Complete `work`; raise a cancellation that comes meanwhile afterwards."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    task.result()
    if cancelled is not None:
        raise cancelled
