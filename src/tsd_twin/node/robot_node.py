"""Robot node: 100 Hz loop connecting bus, controller and hardware interface.

The hardware interface is implemented by the simulator and by real robots. While a recorder
subscribes, all controller inputs are also published.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import math
import platform
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import msgspec
import numpy as np

from tsd_twin.bus import Bus, Publisher
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import InputBatch, encode_batch
from tsd_twin.errors import BusError
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason, because, hardware_reason
from tsd_twin.messages.requests import Description, Event
from tsd_twin.messages.ros import Odometry, encode_joints, encode_odometry
from tsd_twin.messages.status import LoopStatus, encode_stamp, encode_status
from tsd_twin.messages.topics import QoS, Service
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import Heartbeat


class RobotIO(Protocol):
    """Hardware interface to a robot's joints; called from a single thread."""

    def read(self, now_s: float) -> Array | None:
        """Return a new measurement, or None if nothing was measured; missing values are NaN.

        (n + s,): drive joints, then `robot.sensors`, which may be omitted.
        """
        ...

    def write(self, setpoint: Array, now_s: float) -> None:
        """Send the setpoint (n,); a wheel speed of zero means zero throttle."""
        ...

    def hardware(self) -> Mapping[str, Any]:
        """Return the hardware part of the status: `kind` and diagnostics."""
        ...

    def close(self) -> None:
        """Stop the robot and close the connection."""
        ...


@runtime_checkable
class HasWatchdog(Protocol):
    """Hardware with its own command watchdog."""

    def fault(self, now_s: float) -> Reason | str | None:
        """Fault that the board reports, also as a text; None or "" without a fault."""
        ...

    def set_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Set the heartbeat sent with the next setpoint."""
        ...


@runtime_checkable
class HasBattery(Protocol):
    """Hardware that measures the battery voltage."""

    def battery_v(self, now_s: float) -> float | None:
        """Return the latest battery voltage, or None if unknown."""
        ...


@runtime_checkable
class HasServoTemperature(Protocol):
    """Hardware that measures servo temperatures."""

    def servo_c(self, now_s: float) -> float | None:
        """Return the latest temperature of the hottest servo, or None if unknown."""
        ...


class Truth(Protocol):
    """Ground-truth state of a simulated robot."""

    @property
    def pose(self) -> SE2 | SO3:
        """Pose in the world."""
        ...

    @property
    def twist(self) -> Array:
        """(3,): twist in the base frame."""
        ...


@runtime_checkable
class HasTruth(Protocol):
    """Simulated hardware with known ground truth."""

    def truth(self, now_s: float) -> Truth:
        """Return the true pose and twist at `now_s`."""
        ...


_BATCH = 20
"""Periods per message (5 messages per second)."""
_SNAPSHOT_EVERY = 150
"""Batches between snapshots (30 s, the maximum missing at the start of a file)."""
_EARLY = 50
"""Batches buffered for a first subscriber, so that a recorder started with the node misses none."""
_PURE = ("control", "safety", "estimation", "motion", "messages", "robots", "kinematics")


class InputLogPublisher:
    """Publishes the input log of a controller; without subscribers, nothing is logged.

    The first 10 s are buffered until a subscriber appears, so that its log begins with the node.
    Later logs begin with a snapshot.
    """

    def __init__(self, bus: Bus, robot_id: str, controller: LoggedController) -> None:
        topic = topics.INPUTS
        self._publisher = bus.publisher(topic.key(robot_id), topic.qos, topic.type)
        self._controller = controller
        self._early: list[InputBatch] | None = []
        self._periods = 0
        self._batches = 0
        self._failed = False

    def step(self) -> None:
        """Flush the log periodically; call at the end of each period."""
        self._periods += 1
        if self._periods % _BATCH == 0 and not self._failed:
            self.flush()

    def flush(self) -> None:
        """Send the log since the last message; an error ends the log but not the robot."""
        try:
            self._flush()
        except Exception:  # A failure here must not stop a moving robot.
            _LOG.exception("the inputs of the controller are logged no longer")
            self._failed = True
            self._controller.end_log()

    def _flush(self) -> None:
        controller, wanted = self._controller, self._publisher.has_subscribers
        if controller.logs:
            self._batches += 1
            batch = controller.take_log(snapshot=wanted and self._batches % _SNAPSHOT_EVERY == 0)
            if wanted:
                for waiting in (*(self._early or ()), batch):
                    self._publisher.put(encode_batch(waiting))
                self._early = None
            elif self._early is not None and len(self._early) < _EARLY:
                self._early.append(batch)
            else:
                self._early = None
                controller.end_log()
        elif wanted:
            controller.begin_log()


@functools.cache
def build() -> str:
    """Return a digest of the controller code, the numpy version and the processor."""
    folder = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{np.__version__} {platform.machine()}".encode())
    files = [folder / "lie.py", *(file for name in _PURE for file in (folder / name).glob("*.py"))]
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


_REMEMBERED = 500
_SLEEP_S = 0.02


class RateKeeper:
    """Fixed-rate timer; missed periods count as overruns and are skipped."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = time.monotonic()
        self._last_s = self._next_s
        self._periods_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._overruns = 0

    def wait(self, stop: threading.Event) -> float:
        """Wait for the next period or for `stop`; return the monotonic time."""
        self._next_s += self._period_s
        ahead_s = self._next_s - time.monotonic()
        if ahead_s > _SLEEP_S:
            stop.wait(ahead_s)
        elif ahead_s > 0.0:
            # Costs half as much as waiting for an event, and delays `stop` only by this time.
            time.sleep(ahead_s)
        elif ahead_s < -self._period_s:
            self._overruns += 1
            self._next_s = time.monotonic()
        now_s = time.monotonic()
        self._periods_s.append(now_s - self._last_s)
        self._last_s = now_s
        return now_s

    def status(self) -> LoopStatus:
        """Return rate, overruns, jitter and longest period of the loop."""
        if not self._periods_s:
            return LoopStatus()
        periods_s = np.array(self._periods_s)
        place = min(len(periods_s) - 1, math.ceil(0.99 * len(periods_s)))
        p99_s = float(np.partition(np.abs(periods_s - self._period_s), place)[place])
        hz = 1.0 / float(periods_s.mean())
        longest_ms = round(1000.0 * float(periods_s.max()), 1)
        return LoopStatus(round(hz, 1), self._overruns, round(1000.0 * p99_s, 2), longest_ms)


class DuplicateIdMonitor:
    """Detects other nodes with the same robot id by numbered liveliness tokens.

    The check at startup only finds nodes already on the bus. If two networks were joined later, two
    robots would follow the same commands.
    """

    def __init__(self, bus: Bus, robot_id: str) -> None:
        self._id = robot_id
        instance = secrets.token_hex(8)
        self._own = topics.instance_key(robot_id, instance)
        self._others: set[str] = set()
        self.fault: Reason | None = None
        """Reason for the fault; None while no other robot has this id."""
        self._event: Event | None = None
        self._token = bus.declare_token(self._own)
        bus.subscribe_liveliness(topics.instance_key(robot_id, "*"), self._on_token)

    def step(self, now_s: float) -> Reason | None:
        """Check the tokens of other nodes; return `fault`."""
        fault = because(Code.DUPLICATE_ID, robot=self._id) if self._others else None
        if fault != self.fault:
            self.fault = fault
            why = fault or because(Code.DUPLICATE_ID_GONE, robot=self._id)
            self._event = Event.of("id", why, "one robot for each id", now_s)
        return fault

    def take_event(self) -> Event | None:
        """Return the event of a duplicate id appearing or disappearing, once."""
        event, self._event = self._event, None
        return event

    def close(self) -> None:
        """Undeclare the token."""
        self._token.close()

    def _on_token(self, key: str, is_alive: bool) -> None:
        # On a bus thread; the loop only checks whether the set is empty.
        if key == self._own:
            return
        if is_alive:
            self._others.add(key)
        else:
            self._others.discard(key)


_LOG = logging.getLogger(__name__)

PERIOD_S = 0.01
_EXACT = np.zeros((3, 3))
_STATE_EVERY = 2  # 50 Hz
_STATUS_EVERY = 5  # 20 Hz
_LOOP_STATUS_EVERY = 20  # 5 Hz
_COMMANDS_KEPT = 64
"""Command queue size, above the number of operators; in a flood the oldest are dropped."""

_POSES_KEPT = 32
"""Pose queue size, above the number sent per period even after a stalled link."""


class RobotNode:
    """Runs the controller of a robot at 100 Hz and leaves the robot at rest.

    The whole loop runs in one thread, so no rule depends on thread scheduling.
    """

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        robot: RobotDescription,
        io: RobotIO,
        description: Description,
        *,
        pose: SE2 | SO3 | None = None,
    ):
        """Claim the robot id on the bus; `pose` is the initial pose.

        Raises:
            BusError: If the id is taken or invalid.
        """
        alive = topics.alive_key(topics.checked(robot_id))
        if bus.living_tokens(alive):
            raise BusError(
                f"a robot with the id '{robot_id}' is on the bus already: choose another"
            )
        self._bus = bus
        self._id = robot_id
        self._io = io
        # Resolve once; runtime Protocol checks are slow.
        self._watchdog = io if isinstance(io, HasWatchdog) else None
        self._battery = io if isinstance(io, HasBattery) else None
        self._servos = io if isinstance(io, HasServoTemperature) else None
        self._truth_io = io if isinstance(io, HasTruth) else None
        self._controller = LoggedController(
            robot, lambda: secrets.token_bytes(16), pose=pose, build=build()
        )
        self._description = msgspec.json.encode(description)
        self._commands = bus.subscriber(topics.TWIST.key(robot_id), _COMMANDS_KEPT)
        self._poses = bus.subscriber(topics.SENSOR_POSE.key(robot_id), _POSES_KEPT)
        self._stops = bus.subscriber(topics.STOP.key(robot_id), 8)
        # Wildcard queries may read the description but must not stop the robot.
        self._servers = {
            service: bus.queryable(service.key(robot_id), patterns=service is Service.DESC)
            for service in Service
        }
        states = tuple(topic for topic in topics.TOPICS if topic.path.startswith("state/"))
        self._publishers = {
            topic: bus.publisher(topic.key(robot_id), topic.qos, topic.type) for topic in states
        }
        self._input_log = InputLogPublisher(bus, robot_id, self._controller)
        self._event_publishers: dict[str, Publisher] = {}
        self._numbers = dict.fromkeys(states, 0)
        self._mode = self._controller.supervisor.mode
        self._loop_status = LoopStatus()
        self._duplicate_ids = DuplicateIdMonitor(bus, robot_id)
        # Declare last, because clients may send requests once they discover the robot.
        self._token = bus.declare_token(alive)

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set; the last setpoint is standstill."""
        rate = RateKeeper(PERIOD_S)
        tick = 0
        try:
            while not stop.is_set():
                self._tick(rate.wait(stop), tick, rate)
                tick += 1
        finally:
            self._shut_down()

    def _shut_down(self) -> None:
        now_s = time.monotonic()
        self._controller.stop(b'{"reason": "the node ended"}', now_s)
        try:
            self._write(self._controller.step(now_s, None, ()), now_s, ends=True)
            self._input_log.flush()
        finally:
            self._io.close()
            self._token.close()
            self._duplicate_ids.close()

    def _tick(self, now_s: float, tick: int, rate: RateKeeper) -> None:
        measured = self._io.read(now_s)
        for sample in self._stops.take_samples():
            self._controller.stop(sample.payload, now_s)
        self._serve(now_s)
        commands = self._commands.take_samples()
        if poses := self._poses.take_samples():
            self._controller.add_pose_measurements(poses, now_s, time.time_ns())
        battery_v = self._battery.battery_v(now_s) if self._battery else None
        servo_c = self._servos.servo_c(now_s) if self._servos else None
        setpoint = self._controller.step(
            now_s, measured, commands, self._fault(now_s), battery_v, servo_c
        )
        self._write(setpoint, now_s)
        self._publish(now_s, tick, bool(commands), rate)
        self._input_log.step()

    def _fault(self, now_s: float) -> Reason | None:
        # Two robots following the same commands are worse than a board fault.
        return self._duplicate_ids.step(now_s) or (
            hardware_reason(self._watchdog.fault(now_s)) if self._watchdog else None
        )

    def _write(self, setpoint: Array, now_s: float, *, ends: bool = False) -> None:
        if self._watchdog:
            heartbeat = self._controller.supervisor.heartbeat
            # Program exit must not disable radio control.
            stopped = heartbeat.stopped and not ends
            self._watchdog.set_heartbeat(replace(heartbeat, stopped=stopped))
        self._io.write(setpoint, now_s)

    def _serve(self, now_s: float) -> None:
        for service, server in self._servers.items():
            for request in server.take_requests():
                if service is Service.DESC:
                    request.reply(self._description)
                else:
                    reply = self._controller.serve(service, request.payload, now_s)
                    request.reply(msgspec.json.encode(reply))

    def _publish(self, now_s: float, tick: int, commanded: bool, rate: RateKeeper) -> None:
        controller, stamp_ns = self._controller, time.time_ns()
        state_due = tick % _STATE_EVERY == 0
        # Publish the effect of a new command immediately, which saves half a period on average.
        if state_due or commanded:
            self._put_if_matched(
                topics.SETPOINT, lambda: encode_joints(controller.setpoint_state(stamp_ns)), now_s
            )
        if state_due:
            self._put_if_matched(
                topics.JOINTS, lambda: encode_joints(controller.joint_state(stamp_ns)), now_s
            )
            self._publish_poses(now_s, stamp_ns)
        for event in controller.take_events():
            self._put_event(event)
        if (met := self._duplicate_ids.take_event()) is not None:
            self._put_event(met)
        if tick % _STATUS_EVERY == 0 or controller.supervisor.mode is not self._mode:
            self._mode = controller.supervisor.mode
            if tick % _LOOP_STATUS_EVERY == 0:
                self._loop_status = rate.status()
            status = controller.status(now_s, self._loop_status, self._io.hardware())
            self._numbers[topics.STATUS] += 1
            self._put(topics.STATUS, encode_status(status), now_s)
            controller.record_status_sent(self._numbers[topics.STATUS], now_s)

    def _publish_poses(self, now_s: float, stamp_ns: int) -> None:
        controller, io = self._controller, self._truth_io
        self._put_if_matched(
            topics.ODOM, lambda: encode_odometry(controller.odometry(stamp_ns)), now_s
        )
        if self._publishers[topics.ODOM_ALTERNATIVE].has_subscribers:
            other = controller.alternative_odometry(stamp_ns)
            if other is not None:
                self._numbers[topics.ODOM_ALTERNATIVE] += 1
                self._put(topics.ODOM_ALTERNATIVE, encode_odometry(other), now_s)
        if io is not None:
            self._put_if_matched(topics.TRUTH, lambda: _encode_truth(io, now_s, stamp_ns), now_s)

    def _put_if_matched(
        self, topic: topics.Topic, encode: Callable[[], bytes], now_s: float
    ) -> None:
        """Publish the result of `encode`, which is only called if there are subscribers.

        Always increments the sequence number, so that gaps show missed messages.
        """
        self._numbers[topic] += 1
        if self._publishers[topic].has_subscribers:
            self._put(topic, encode(), now_s)

    def _put(self, topic: topics.Topic, payload: bytes, now_s: float) -> None:
        stamp = encode_stamp(self._numbers[topic], int(now_s * 1e9))
        self._publishers[topic].put(payload, stamp)

    def _put_event(self, event: Event) -> None:
        if event.kind not in self._event_publishers:
            key = topics.event_key(self._id, event.kind)
            self._event_publishers[event.kind] = self._bus.publisher(key, QoS.EVENT)
        self._event_publishers[event.kind].put(msgspec.json.encode(event))
        _LOG.info("%s: %s", self._id, event.text)


def _encode_truth(io: HasTruth, now_s: float, stamp_ns: int) -> bytes:
    truth = io.truth(now_s)
    return encode_odometry(Odometry.of(truth.pose, truth.twist, _EXACT, _EXACT, stamp_ns))
