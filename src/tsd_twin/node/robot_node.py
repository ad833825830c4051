"""Robot node: 100 Hz loop connecting bus, controller and hardware interface.

The hardware interface is implemented by the simulator and by real robots. While a recorder
subscribes, all controller inputs are also published.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np

from tsd_twin.bus import Bus, Publisher
from tsd_twin.control import LoggedController
from tsd_twin.errors import BusError
from tsd_twin.hardware.robot_io import (
    HasBattery,
    HasServoTemperature,
    HasTruth,
    HasWatchdog,
    RobotIO,
)
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, encode_joints, encode_odometry
from tsd_twin.messages.codes import Reason, hardware_reason
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import Description
from tsd_twin.messages.status import (
    LoopStatus,
    Summary,
    encode_stamp,
    encode_status,
    encode_summary,
)
from tsd_twin.messages.topics import QoS, Service, Topic
from tsd_twin.node.authority import Authority
from tsd_twin.node.input_log import InputLogPublisher, build
from tsd_twin.node.timing import DuplicateIdMonitor, RateKeeper
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import SafetySupervisor

_LOG = logging.getLogger(__name__)

PERIOD_S = 0.01
_EXACT = np.zeros((3, 3))
_STATE_EVERY = 2  # 50 Hz
_STATUS_EVERY = 5  # 20 Hz
_LOOP_STATUS_EVERY = 20  # 5 Hz
_SUMMARY_EVERY = 50  # 2 Hz
_STREAMS = (
    topics.SETPOINT,
    topics.JOINTS,
    topics.ODOM,
    topics.ODOM_ALTERNATIVE,
    topics.TRUTH,
)
"""Streams at 50 Hz; the setpoint also follows each command at once."""
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
        authority: Authority | None = None,
    ):
        """Claim the robot id on the bus; `pose` is the initial pose.

        With an `authority`, only signed commands and requests count.

        Raises:
            BusError: If the id is taken or invalid.
        """
        alive = topics.alive_key(topics.checked(robot_id))
        if bus.living_tokens(alive):
            sentence = f"a robot with the id '{robot_id}' is on the bus already: choose another"
            raise BusError(sentence)
        self._bus, self._id, self._io = bus, robot_id, io
        # Resolve once; runtime Protocol checks are slow.
        self._watchdog = io if isinstance(io, HasWatchdog) else None
        self._battery = io if isinstance(io, HasBattery) else None
        self._servos = io if isinstance(io, HasServoTemperature) else None
        self._truth_io = io if isinstance(io, HasTruth) else None
        self._controller = LoggedController(
            robot, partial(secrets.token_bytes, 16), pose=pose, build=build()
        )
        self._authority = authority
        self._description = msgspec.json.encode(description)
        self._mode = self._controller.supervisor.mode
        self._loop_status = LoopStatus()
        self._periods = 0
        self._open_streams(bus, robot_id)
        # Declare last, because clients may send requests once they discover the robot.
        self._token = bus.declare_token(alive)

    def _open_streams(self, bus: Bus, robot_id: str) -> None:
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
        self._numbers = dict.fromkeys(states, 0)
        self._input_log = InputLogPublisher(bus, robot_id, self._controller)
        self._event_publishers: dict[str, Publisher] = {}
        self._duplicate_ids = DuplicateIdMonitor(bus, robot_id)

    @property
    def supervisor(self) -> SafetySupervisor:
        """Safety state machine, for the thread that runs the node."""
        return self._controller.supervisor

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set; the last setpoint is standstill."""
        rate = RateKeeper(PERIOD_S)
        try:
            while not stop.is_set():
                self.step(rate.wait(stop), rate)
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

    def step(self, now_s: float, rate: RateKeeper) -> None:
        """Run the period that starts at `now_s`; `rate` measures the loop, for the status."""
        tick, self._periods = self._periods, self._periods + 1
        measured = self._io.read(now_s)
        for sample in self._stops.take_samples():
            self._controller.stop(sample.payload, now_s)
        self._serve(now_s)
        commands = self._commands.take_samples()
        if self._authority is not None:
            commands = self._authority.signed_commands(commands, now_s)
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
                elif self._authority is not None:
                    serve = self._controller.serve
                    request.reply(self._authority.serve(service, request.payload, now_s, serve))
                else:
                    reply = self._controller.serve(service, request.payload, now_s)
                    request.reply(msgspec.json.encode(reply))

    def _publish(self, now_s: float, tick: int, commanded: bool, rate: RateKeeper) -> None:
        controller, stamp_ns = self._controller, time.time_ns()
        state_due = tick % _STATE_EVERY == 0
        # Publish the effect of a new command immediately, which saves half a period on average.
        if state_due or commanded:
            self._put_if_matched(topics.SETPOINT, now_s, stamp_ns)
        if state_due:
            for topic in _STREAMS[1:]:
                self._put_if_matched(topic, now_s, stamp_ns)
        self._publish_events()
        is_new_mode = controller.supervisor.mode is not self._mode
        if tick % _STATUS_EVERY == 0 or is_new_mode:
            payload = self._publish_status(now_s, tick, rate)
            if tick % _SUMMARY_EVERY == 0 or is_new_mode:
                self._publish_summary(payload, now_s, stamp_ns)

    def _publish_events(self) -> None:
        for event in self._controller.take_events():
            self._put_event(event)
        for event in self._authority.take_events() if self._authority else ():
            self._put_event(event)
        if (met := self._duplicate_ids.take_event()) is not None:
            self._put_event(met)

    def _publish_status(self, now_s: float, tick: int, rate: RateKeeper) -> bytes:
        controller = self._controller
        self._mode = controller.supervisor.mode
        if tick % _LOOP_STATUS_EVERY == 0:
            self._loop_status = rate.status()
        status = controller.status(now_s, self._loop_status, self._io.hardware())
        self._numbers[topics.STATUS] += 1
        payload = encode_status(status)
        self._put(topics.STATUS, payload, now_s)
        controller.record_status_sent(self._numbers[topics.STATUS], now_s)
        if self._authority is not None:
            self._authority.record_status(self._numbers[topics.STATUS], now_s)
        return payload

    def _publish_summary(self, status: bytes, now_s: float, stamp_ns: int) -> None:
        self._numbers[topics.SUMMARY] += 1
        if not self._publishers[topics.SUMMARY].has_subscribers:
            return
        payloads = {topics.STATUS.path: status}
        for topic in _STREAMS:
            if (payload := self._encoded(topic, now_s, stamp_ns)) is not None:
                payloads[topic.path] = payload
        summary = Summary(self._numbers[topics.STATUS], payloads)
        self._put(topics.SUMMARY, encode_summary(summary), now_s)

    def _encoded(self, topic: Topic, now_s: float, stamp_ns: int) -> bytes | None:
        """Return the current message of a stream, or None if the robot has none."""
        controller = self._controller
        if topic is topics.SETPOINT:
            return encode_joints(controller.setpoint_state(stamp_ns))
        if topic is topics.JOINTS:
            return encode_joints(controller.joint_state(stamp_ns))
        if topic is topics.ODOM:
            return encode_odometry(controller.odometry(stamp_ns))
        if topic is topics.ODOM_ALTERNATIVE:
            other = controller.alternative_odometry(stamp_ns)
            return None if other is None else encode_odometry(other)
        return None if self._truth_io is None else _encode_truth(self._truth_io, now_s, stamp_ns)

    def _put_if_matched(self, topic: Topic, now_s: float, stamp_ns: int) -> None:
        """Publish a stream; it is only encoded if there are subscribers.

        Always increments the sequence number, so that gaps show missed messages.
        """
        self._numbers[topic] += 1
        if self._publishers[topic].has_subscribers:
            payload = self._encoded(topic, now_s, stamp_ns)
            if payload is not None:
                self._put(topic, payload, now_s)

    def _put(self, topic: Topic, payload: bytes, now_s: float) -> None:
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
