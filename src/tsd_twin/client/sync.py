"""Synchronous client for a robot.

All methods are thread-safe, but motions of a `RobotControl` run one at a time in the calling
thread. The library starts two threads per control (setpoints, renewals) and one per callback; none
of them keeps the process alive.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Self, TypeVar

from tsd_twin.client import motions, procedures
from tsd_twin.client.arguments import check_duration, check_frame, check_numbers, check_optional
from tsd_twin.client.base_control import BaseControl
from tsd_twin.client.core import QUEUE, Acquire, BaseClient
from tsd_twin.client.discovery import open_link
from tsd_twin.client.held_lease import RENEW_PERIOD_S
from tsd_twin.client.link import Link
from tsd_twin.client.motions import TwistSource
from tsd_twin.client.port import Procedure, Sleep
from tsd_twin.client.protocol import ZERO_TWIST
from tsd_twin.client.state import CallbackSubscription, RobotState, Subscription
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.events import Event

_LOG = logging.getLogger(__name__)
_POLL_S = 0.1
_JOIN_S = 1.0
_STATE_PERIOD_S = 0.02

T = TypeVar("T")


class RobotClient(BaseClient["RobotControl", None]):
    """Robot client: latest state, streams of states and events, and control.

    Use it as a context manager or call `close`. `tsd_twin.connect` returns one for a robot on the
    bus; `SimulatedRobot` runs in virtual time.
    """

    def __init__(self, link: Link, operator: str) -> None:
        """`operator` is the default name of `control`."""
        super().__init__(link, operator)
        self._readers: list[threading.Thread] = []
        self._closed = threading.Event()
        if not link.virtual:
            threading.Thread(target=self._close_at_exit, name="client-exit").start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release any held control and disconnect from the robot."""
        link = self.link
        try:
            for control in list(self._controls):
                control.release()
        finally:
            link.close()
            self._closed.set()
            for thread in self._readers:
                if thread is not threading.current_thread():
                    thread.join(_JOIN_S)

    def _close_at_exit(self) -> None:
        # An open session with callbacks blocks process exit. Use a non-daemon thread, which the
        # interpreter joins, so that it is not killed in the middle of a call.
        while not self._closed.wait(_POLL_S):
            if not threading.main_thread().is_alive():
                self.close()

    def sleep(self, seconds: float) -> None:
        """Sleep; for simulated robots, advance virtual time."""
        check_numbers(seconds=seconds)
        self.link.sleep_until(self.link.now_s() + seconds)

    def states(
        self, duration_s: float | None = None, *, maxlen: int = QUEUE
    ) -> Iterator[RobotState]:
        """Yield new states at 50 Hz for `duration_s`, or until the robot is closed.

        If the consumer is slow, all but the latest `maxlen` states are dropped.
        """
        check_optional(duration_s=duration_s)
        end_s = None if duration_s is None else self.time_s + duration_s
        with self.link.subscribe_states(Subscription[RobotState](maxlen)) as subscription:
            while not self.link.closed and (end_s is None or self.time_s < end_s - 1e-9):
                yield from self._next(subscription)

    def on_state(
        self, callback: Callable[[RobotState], None], *, maxlen: int = 1
    ) -> Subscription[RobotState]:
        """Call `callback` with new states on a separate thread until the result is closed.

        If the callback is slow, all but the latest `maxlen` states are dropped. For simulated
        robots, the callback runs on the thread that advances time.
        """
        return self.link.subscribe_states(self._callback(callback, maxlen))

    def events(self, *, maxlen: int = QUEUE) -> Subscription[Event]:
        """Return an iterable queue of events (modes, lease, refusals); close it after use."""
        return self.link.subscribe_events(Subscription[Event](maxlen))

    def on_event(
        self, callback: Callable[[Event], None], *, maxlen: int = QUEUE
    ) -> Subscription[Event]:
        """Call `callback` with events on a separate thread until the result is closed."""
        return self.link.subscribe_events(self._callback(callback, maxlen))

    def _callback(self, callback: Callable[[T], None], maxlen: int) -> Subscription[T]:
        if self.link.virtual:
            return CallbackSubscription(callback)
        subscription = Subscription[T](maxlen)
        read = partial(_read, subscription, callback)
        thread = threading.Thread(target=read, name="client-callback", daemon=True)
        self._readers.append(thread)
        thread.start()
        return subscription

    def _next(self, subscription: Subscription[RobotState]) -> Iterator[RobotState]:
        if self.link.virtual:
            self.link.sleep_until(self.link.now_s() + _STATE_PERIOD_S)
            yield from subscription.take()
        elif (state := subscription.get(_POLL_S)) is not None:
            yield state

    def perform(self, begin: Callable[[], Procedure[None]]) -> None:
        """Begin a procedure and run it (internal)."""
        self.link.run(begin())

    def _new_control(self, operator: str, arm: bool, acquire: Acquire) -> RobotControl:
        return RobotControl(self, operator, arm, acquire)


class RobotControl(BaseControl[RobotClient, None]):
    """Control of a robot by one operator: lease, arming, motions, handover.

    Use it in `with`. If the process dies, commands cease and the robot stops within its
    `limits.command_timeout_s`; the lease expires after 2 s, and 10 s later the robot is disarmed.
    """

    def __init__(self, robot: RobotClient, operator: str, arm: bool, acquire: Acquire) -> None:
        super().__init__(robot, operator, arm, acquire)
        self._ended = threading.Event()
        self._has_setpoint = threading.Event()
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def acquire(self) -> None:
        """Acquire the lease and arm; called on entering `with`.

        Raises:
            ControlDenied: If another operator has control or denies the request.
            RequestRefused: If the robot does not arm.
            RobotStopped: If the robot is latched and needs a reset first.
        """
        self._ended.clear()
        self._link.attach(self._protocol)
        self.robot.add_control(self, active=True)
        try:
            self._perform_now(self._acquire)
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
        """Command zero, disarm and release; do nothing without the lease.

        An interrupt such as Ctrl-C is raised afterwards.
        """
        link = self._link  # A forked child must not join its parent's threads.
        try:
            _uninterrupted(lambda: self._perform_now(procedures.give_back), link)
        finally:
            self._ended.set()
            self._has_setpoint.set()
            # A thread using the bus at interpreter exit would abort the process.
            for thread in self._threads:
                thread.join()
            self._threads = []
            link.detach(self._protocol)
            self.robot.add_control(self, active=False)

    def arming(self) -> Iterator[float]:
        """Arm like `arm`, yielding the progress (0 to 1) of each stage."""
        for _ in self._link.run_stepwise(procedures.arm(self._protocol, self._now_s)):
            arming = None if self._protocol.status is None else self._protocol.status.arming
            if arming is not None:
                yield arming.progress

    def staying_ready(self, duration_s: float) -> Iterator[float]:
        """Check for `duration_s` that the robot stays ready; yield the elapsed time.

        Raises:
            ControlLost, RobotStopped, RobotSilent: If it does not.
        """
        check_duration(duration_s=duration_s)
        began_s = self._now_s
        staying = procedures.stay_ready(self._protocol, began_s, duration_s)
        for _ in self._link.run_stepwise(staying):
            yield self._now_s - began_s

    def driving(self, twist_at: TwistSource, *, frame: str = BASE) -> Iterator[float]:
        """Command the twists from `twist_at`; yield the time after each one.

        `twist_at` is called at 50 Hz with the time on the clock of `robot.time_s` and returns (3,),
        m/s and rad/s in `frame`. A zero is commanded when it returns None, after any error, and
        when the loop ends.

        Raises:
            ControlLost, RobotStopped, RobotSilent: As for `drive`; `twist_at` may raise other
                errors.
        """
        check_frame(frame)
        driving = motions.drive_by(self._protocol, self._now_s, twist_at, frame)
        steps = self._link.run_stepwise(driving)
        try:
            for step in steps:
                if isinstance(step, Sleep):
                    yield self._now_s
        finally:
            with self._link.lock:
                if self._protocol.in_motion and self._protocol.has_lease:  # Loop left early.
                    self._link.send(self._protocol.command(ZERO_TWIST, BASE, self._now_s))
            steps.close()

    def _wake_sender(self) -> None:
        self._has_setpoint.set()

    def _renew(self) -> None:
        while not self._ended.wait(0.5 * RENEW_PERIOD_S):
            self._perform_now(procedures.renew)

    def _send_setpoints(self) -> None:
        while self._has_setpoint.wait() and not self._ended.is_set():
            with self._link.lock:
                until_s = self._send_due()
                if not self._protocol.has_setpoint:
                    self._has_setpoint.clear()
            self._link.sleep_until(until_s)


def _read(subscription: Subscription[T], callback: Callable[[T], None]) -> None:
    for item in subscription:
        try:
            callback(item)
        except Exception:  # An exception in a callback must not end the stream.
            _LOG.exception("a callback failed")


def _uninterrupted(work: Callable[[], None], link: Link) -> None:
    """Run `work` to completion, even on Ctrl-C; raise the interrupt afterwards."""
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


def connect(
    endpoint: str | Sequence[str] | None = None,
    *,
    robot: str | None = None,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> RobotClient:
    """Connect to a robot on the bus.

    The default endpoint is the demo and mock on this machine, like for `tsd-dashboard`. `robot` is
    an id, required if there are several. `certificate` is an operator's `.pem` from `tsd-certs`,
    with its `.key` and `ca.pem` in the same folder; alternatively, `zenoh_config` is a JSON5 file.

    Raises:
        NoRobotFound: If no robot responds.
        SeveralRobotsFound: If there are several robots and `robot` is not given.
        TwinError: If a file or the robot's description is invalid.
    """
    return RobotClient(*open_link(endpoint, robot, certificate, zenoh_config))
