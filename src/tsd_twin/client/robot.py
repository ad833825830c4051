"""Synchronous client: a robot, and control of it.

Threads: every method may be called from any thread, but the motions of one `RobotControl` run one
at a time, in the thread that calls them. The library has two threads of its own for each control,
for set-points and renewals, and one for each callback. None of them keeps a process alive.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Self, TypeVar

from tsd_twin.client import procedures
from tsd_twin.client.link import Link
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

_LOG = logging.getLogger(__name__)
_QUEUE = 64
_POLL_S = 0.1
_JOIN_S = 1.0
_STATE_PERIOD_S = 0.02
_SHORTEST_SLEEP_S = 0.001

T = TypeVar("T")


class RobotClient:
    """One robot: its newest state, streams of states and events, and control of it.

    Use it as a context manager, or call `close`. `tsd_twin.connect` returns one for a robot on the
    bus, `SimulatedRobot` is one in virtual time.
    """

    def __init__(self, link: Link, operator: str) -> None:
        """`operator` is the default name of `control`."""
        self._link = link
        self._operator = operator
        self._controls: list[RobotControl] = []
        self._readers: list[threading.Thread] = []
        self._closed = threading.Event()
        if not link.virtual:
            threading.Thread(target=self._close_at_exit, name="client-exit").start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        state = "closed" if self._link.closed else repr(self.state)
        return f"<{type(self).__name__} {self.id}: {state}>"

    def close(self) -> None:
        """Give back control, if it is held, and leave the robot."""
        try:
            for control in list(self._controls):
                control.release()
        finally:
            self._link.close()
            self._closed.set()
            for thread in self._readers:
                if thread is not threading.current_thread():
                    thread.join(_JOIN_S)

    def _close_at_exit(self) -> None:
        # A session with callbacks keeps a process from ending until it is closed. Not a daemon:
        # the interpreter waits for this thread, so it does not end in the middle of a call.
        while not self._closed.wait(_POLL_S):
            if not threading.main_thread().is_alive():
                self.close()

    # The state.

    @property
    def id(self) -> str:
        """The id of the robot on the bus."""
        return self._link.id

    @property
    def description(self) -> RobotDescription:
        """The description of the robot, with its limits and its kinematics."""
        return self._link.robot

    @property
    def state(self) -> RobotState:
        """The newest state."""
        return self._link.state()

    @property
    def time_s(self) -> float:
        """The monotonic clock; of a simulated robot, the virtual time."""
        return self._link.now_s()

    def sleep(self, seconds: float) -> None:
        """Wait; of a simulated robot, let virtual time pass."""
        self._link.sleep_until(self._link.now_s() + seconds)

    def states(
        self, duration_s: float | None = None, *, maxlen: int = _QUEUE
    ) -> Iterator[RobotState]:
        """Yield each new state, 50 a second, for a duration or until the robot is closed.

        When the reader is slower, the oldest ones beyond `maxlen` are dropped.
        """
        end_s = None if duration_s is None else self.time_s + duration_s
        with self._link.subscribe_states(Subscription[RobotState](maxlen)) as subscription:
            while not self._link.closed and (end_s is None or self.time_s < end_s - 1e-9):
                yield from self._next(subscription)

    def on_state(
        self, callback: Callable[[RobotState], None], *, maxlen: int = 1
    ) -> Subscription[RobotState]:
        """Call `callback` with new states on a thread of its own, until the result is closed.

        While a callback runs, at most `maxlen` states wait; older ones are dropped. Of a simulated
        robot, it is called on the thread that lets time pass.
        """
        return self._link.subscribe_states(self._callback(callback, maxlen))

    def events(self, *, maxlen: int = _QUEUE) -> Subscription[Event]:
        """Return a queue of events: modes, lease, refusals; iterate over it, and close it."""
        return self._link.subscribe_events(Subscription[Event](maxlen))

    def on_event(
        self, callback: Callable[[Event], None], *, maxlen: int = _QUEUE
    ) -> Subscription[Event]:
        """Call `callback` with events on a thread of its own, until the result is closed."""
        return self._link.subscribe_events(self._callback(callback, maxlen))

    def _callback(self, callback: Callable[[T], None], maxlen: int) -> Subscription[T]:
        if self._link.virtual:
            return _CallbackSubscription(callback)
        subscription = Subscription[T](maxlen)
        read = partial(_read, subscription, callback)
        thread = threading.Thread(target=read, name="client-callback", daemon=True)
        self._readers.append(thread)
        thread.start()
        return subscription

    def _next(self, subscription: Subscription[RobotState]) -> Iterator[RobotState]:
        if self._link.virtual:
            self._link.sleep_until(self._link.now_s() + _STATE_PERIOD_S)
            yield from subscription.take()
        elif (state := subscription.get(_POLL_S)) is not None:
            yield state

    # Without control.

    def stop(self, reason: str = "") -> None:
        """Stop the robot and latch it; any client may. This is a software stop.

        Raises:
            RobotSilent: the robot did not acknowledge it.
        """
        run(self._link, procedures.stop(self.id, self._operator, reason))

    def publish_pose(
        self, x_m: float, y_m: float, heading_rad: float, *, stamp_s: float | None = None
    ) -> None:
        """Publish a pose that a sensor has measured, in `odom`; the robot fuses it.

        `stamp_s` is when it was measured, by the robot's wall clock, as `state.odom.stamp_s`; now
        if it is not given.
        """
        stamp_ns = self._link.wall_ns() if stamp_s is None else round(stamp_s * 1e9)
        pose = SE2.identity()
        pose.xy_heading[:] = x_m, y_m, heading_rad
        self._link.send_pose(encode_pose(PoseStamped.planar(pose, stamp_ns)))

    # Control.

    def control(
        self,
        operator: str | None = None,
        *,
        take_over: bool = False,
        max_age_s: float | None = None,
        reason: str = "",
        arm: bool = True,
    ) -> RobotControl:
        """Return control of the robot, to be entered with `with`: lease, then arming.

        On any exit it commands zero, disarms and releases. `take_over` takes the lease from its
        holder, with a `reason` for all to see; `max_age_s` lets older commands count on a slow
        link, at a lower speed limit; without `arm`, call `arm` yourself.
        """
        return RobotControl(
            self,
            operator or self._operator,
            arm=arm,
            wish={"take_over": take_over, "max_age_s": max_age_s, "reason": reason},
        )

    def request_control(
        self,
        operator: str | None = None,
        *,
        timeout_s: float = 15.0,
        max_age_s: float | None = None,
        arm: bool = True,
    ) -> RobotControl:
        """Return control as `control` does, but ask its holder for it when it is entered.

        The holder has `timeout_s` to answer, 15 s at most.
        """
        return RobotControl(
            self,
            operator or self._operator,
            arm=arm,
            wish={"max_age_s": max_age_s},
            ask_s=timeout_s,
        )

    def add_control(self, control: RobotControl, *, active: bool) -> None:
        """Register or unregister a control; the library calls this."""
        self._controls = [each for each in self._controls if each is not control]
        if active:
            self._controls.append(control)

    @property
    def link(self) -> Link:
        """The connection; for other parts of this library."""
        return self._link


class RobotControl:
    """Control of a robot by one operator: the lease, arming, motions, hand-over.

    Enter it with `with`. If the process dies instead, commands fail to come and the robot stops
    within its `limits.command_timeout_s`; the lease expires after 2 s, and 10 s later the robot is
    disarmed.
    """

    def __init__(
        self,
        robot: RobotClient,
        operator: str,
        *,
        arm: bool,
        wish: dict[str, Any],
        ask_s: float | None = None,
    ) -> None:
        self.robot = robot
        self._link = robot.link
        self._protocol = ControlProtocol(robot.id, robot.description, operator)
        self._arm, self._wish, self._ask_s = arm, wish, ask_s
        self._ended = threading.Event()
        self._has_setpoint = threading.Event()
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __repr__(self) -> str:
        held = "has control of" if self.is_held else "has no control of"
        return f"<RobotControl: {self.operator} {held} {self.robot.id}>"

    @property
    def operator(self) -> str:
        """The name under which the lease is held."""
        return self._protocol.operator

    @property
    def is_held(self) -> bool:
        """Whether the lease is held, as far as is known."""
        return self._protocol.has_lease

    # The lease.

    def acquire(self) -> None:
        """Acquire the lease and arm, as entering with `with` does.

        Raises:
            ControlDenied: another operator has control, or keeps it.
            RequestRefused: the robot does not arm.
            RobotStopped: the robot is latched, and wants a reset first.
        """
        self._ended.clear()
        self._link.attach(self._protocol)
        self.robot.add_control(self, active=True)
        try:
            if self._ask_s is None:
                self._run(procedures.acquire(self._protocol, **self._wish))
            else:
                self._run(
                    procedures.ask_for_control(
                        self._protocol, self._now_s, self._ask_s, **self._wish
                    )
                )
            if not self._link.virtual:
                for work in (self._renew, self._send_setpoints):
                    thread = threading.Thread(target=work, name="client-control", daemon=True)
                    self._threads.append(thread)
                    thread.start()
            if self._arm:
                self.arm()
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Command zero, disarm and release; without the lease, do nothing.

        An interrupt, such as Ctrl-C, is raised when that is done.
        """
        try:
            _uninterrupted(
                lambda: self._run(procedures.give_back(self._protocol, self._now_s)), self._link
            )
        finally:
            self._ended.set()
            self._has_setpoint.set()
            # A thread that is in the bus when the interpreter ends would abort the process.
            for thread in self._threads:
                thread.join()
            self._threads = []
            self._link.detach(self._protocol)
            self.robot.add_control(self, active=False)

    @property
    def asked_by(self) -> str | None:
        """The operator who asks for control, if any."""
        return self.robot.state.lease.asked_by

    def hand_over(self, asker: str | None = None) -> None:
        """Hand control to the operator who asks for it; the robot stops, and stays armed.

        Raises:
            RequestRefused: no operator asks for it, or another one.
        """
        self._run(procedures.answer_request(self._protocol, grant=True, asker=asker))

    def deny(self, asker: str | None = None) -> None:
        """Deny the pending request for control.

        Raises:
            RequestRefused: no operator asks for it, or another one.
        """
        self._run(procedures.answer_request(self._protocol, grant=False, asker=asker))

    # Modes.

    def arm(self) -> None:
        """Arm, and wait until the robot is ready: some three seconds.

        Raises:
            RequestRefused: the robot refuses, or gives arming up.
            RobotStopped: it is latched, and wants a reset first.
        """
        self._run(procedures.arm(self._protocol, self._now_s))

    def disarm(self) -> None:
        """Disarm: the wheels spin down, after a controlled stop when the robot drives."""
        self._run(procedures.disarm(self._protocol, self._now_s))

    def stop(self, reason: str = "") -> None:
        """Stop the robot and latch it: a software stop."""
        self._run(procedures.stop(self.robot.id, self.operator, reason))

    def reset(self) -> None:
        """Unlatch a stopped or faulty robot; it is disarmed then."""
        self._run(procedures.reset(self._protocol, self._now_s))

    # Motions.

    def drive(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> None:
        """Drive for a time, then come to rest; returns when the robot stands.

        `frame` is `base_link`, the robot's own axes, or `odom`, those of the floor.

        Raises:
            ControlLost: the lease ended.
            RobotStopped: the robot is not ready, was stopped, or stopped by itself.
            RobotSilent: the robot sends no status.
        """
        twist = self._protocol.planar(vx_mps, vy_mps, omega_rad_per_s)
        self._run(procedures.drive(self._protocol, self._now_s, twist, duration_s, frame))

    def turn(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        duration_s: float,
        frame: str = BASE,
    ) -> None:
        """Turn a sphere in place for a time, then come to rest; as `drive`."""
        twist = self._protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        self._run(procedures.drive(self._protocol, self._now_s, twist, duration_s, frame))

    def set_velocity(
        self,
        *,
        vx_mps: float = 0.0,
        vy_mps: float = 0.0,
        omega_rad_per_s: float = 0.0,
        frame: str = BASE,
    ) -> None:
        """Put a velocity set-point in force for 0.2 s, and return at once.

        The library sends it at 50 Hz. A set-point that is not refreshed is replaced by zero.

        Raises:
            ControlLost: the lease ended.
            RobotStopped: the robot is not ready, was stopped, or has stopped by itself.
            RobotSilent: the robot sends no status.
        """
        self._set_velocity(self._protocol.planar(vx_mps, vy_mps, omega_rad_per_s), frame)

    def set_turn_rate(
        self,
        *,
        wx_rad_per_s: float = 0.0,
        wy_rad_per_s: float = 0.0,
        wz_rad_per_s: float = 0.0,
        frame: str = BASE,
    ) -> None:
        """Put an angular velocity of a sphere in force for 0.2 s; as `set_velocity`."""
        twist = self._protocol.spherical(wx_rad_per_s, wy_rad_per_s, wz_rad_per_s)
        self._set_velocity(twist, frame)

    def rest(self) -> None:
        """Bring the robot to rest, and return when it stands; it stays armed."""
        self._run(procedures.rest(self._protocol, self._now_s))

    def go_to(
        self,
        *,
        x_m: float,
        y_m: float,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        """Go straight to a place in `odom`, closed loop, and return when the robot stands there.

        Without a heading, it keeps its own. `speed_mps` lowers the speed limit.

        Raises:
            PathError: there is no such path.
            MotionFailed: the robot left its path, or did not get there; it stands.
            ClientError: as `drive`.
        """
        self._follow(goal_at(x_m, y_m, heading_rad), speed_mps)

    def follow_path(
        self,
        points: Sequence[Sequence[float]],
        *,
        heading_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        """Follow a smooth line through `points` of (x, y) in metres, to the last of them.

        Raises:
            PathError, MotionFailed, ClientError: as `go_to`.
        """
        self._follow(goal_along(points, heading_rad), speed_mps)

    def _follow(self, goal: NavigationGoal, speed_mps: float | None) -> None:
        self._run(procedures.follow(self._protocol, self._now_s, goal, speed_mps))

    def _set_velocity(self, twist: Sequence[float], frame: str) -> None:
        with self._link.lock:
            command = self._protocol.set_velocity(twist, frame, self._now_s)
            if command is not None:
                self._link.send(command)
            self._has_setpoint.set()

    # Settings.

    def set_pose(self, *, x_m: float, y_m: float, heading_rad: float = 0.0) -> None:
        """Set the pose estimate; at rest only.

        Raises:
            RequestRefused: it moves, or a number is not finite.
        """
        self._run(procedures.set_pose(self._protocol, x_m, y_m, heading_rad))

    def set_orientation(
        self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, w: float = 1.0
    ) -> None:
        """Set the orientation estimate of a sphere, a quaternion; at rest only."""
        self._run(procedures.set_orientation(self._protocol, x, y, z, w))

    def set_wheel_speed(self, rpm: float) -> None:
        """Set the speed of wheels that always spin, until they are shut off.

        Raises:
            RequestRefused: the robot has no such wheels, or they cannot turn so fast.
        """
        self._run(procedures.set_wheel_speed(self._protocol, rpm))

    # Inside.

    @property
    def _now_s(self) -> float:
        return self._link.now_s()

    def _run(self, procedure: Procedure[T]) -> T:
        return run(self._link, procedure)

    def _renew(self) -> None:
        while not self._ended.wait(0.5 * RENEW_PERIOD_S):
            began_s = self._now_s
            with self._link.lock:
                request = self._protocol.renewal(began_s)
            if request is not None:
                answer = self._link.call(Service.LEASE, request, 1.0)
                with self._link.lock:
                    self._protocol.receive_renewal(request, answer, self._now_s - began_s)

    def _send_setpoints(self) -> None:
        while self._has_setpoint.wait() and not self._ended.is_set():
            with self._link.lock:
                now_s = self._now_s
                command = self._protocol.due(now_s)
                if command is not None:
                    self._link.send(command)
                if not self._protocol.has_setpoint:
                    self._has_setpoint.clear()
                until_s = max(self._protocol.next_due_s, now_s + _SHORTEST_SLEEP_S)
            self._link.sleep_until(until_s)


def run(link: Link, procedure: Procedure[T]) -> T:
    """Run a procedure in this thread; an error or interrupt of a step is raised inside it."""
    outcome: Outcome | None = None
    error: BaseException | None = None
    while True:
        try:
            with link.lock:
                if error is not None:
                    step = procedure.throw(error)
                else:
                    step = next(procedure) if outcome is None else procedure.send(outcome)
                if isinstance(step, Send):
                    link.send(step.command)  # Under the lock, so that numbers go out in order.
        except StopIteration as done:
            return done.value
        try:
            outcome, error = _perform(link, step), None
        except BaseException as raised:
            error = raised


def _perform(link: Link, step: Step) -> Outcome:
    answer, value = None, None
    match step:
        case Call(service, payload, timeout_s):
            answer = link.call(service, payload, timeout_s)
        case SendStop(payload):
            link.send_stop(payload)
        case Sleep(until_s):
            link.sleep_until(until_s)
        case NextStatus(until_s):
            link.wait_for_status(until_s)
        case Compute(function):
            value = function()
        case Send():
            pass
    return Outcome(link.now_s(), answer, value)


class _CallbackSubscription(Subscription[T]):
    """A subscription whose items go to a callback at once, on the thread that puts them."""

    def __init__(self, callback: Callable[[T], None]) -> None:
        super().__init__(1)
        self._callback = callback

    def put(self, item: T) -> None:
        if not self.closed:
            self._callback(item)


def _read(subscription: Subscription[T], callback: Callable[[T], None]) -> None:
    for item in subscription:
        try:
            callback(item)
        except Exception:  # A mistake in a callback must not end the stream.
            _LOG.exception("a callback failed")


def _uninterrupted(work: Callable[[], None], link: Link) -> None:
    """Complete `work`, also when Ctrl-C is pressed; raise the interrupt afterwards."""
    if link.virtual or threading.current_thread() is not threading.main_thread():
        work()
        return
    failures: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=guarded, name="client-release")
    thread.start()
    while thread.is_alive():
        try:
            thread.join()
        except KeyboardInterrupt as interrupt:
            failures.append(interrupt)
    if failures:
        raise failures[-1]
