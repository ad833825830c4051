"""Newest state of a robot, for a display that polls it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from tsd_twin.bus import Bus, Subscriber
from tsd_twin.client.connection import RobotConnection, Source, numbered_status
from tsd_twin.client.instances import Instances, live_count
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import JointState, Odometry, decode_joints
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.status import (
    Refusals,
    RobotStatus,
    decode_stamp,
    decode_status,
    decode_summary,
)
from tsd_twin.messages.topics import Sample, Topic

MAX_ROUND_TRIPS = 40
"""Window of round trips (the last 10 s)."""


class RoundTrips:
    """Recent round-trip times; written by one thread, read by any."""

    def __init__(self) -> None:
        self._trips_s: deque[float] = deque(maxlen=MAX_ROUND_TRIPS)

    def add(self, trip_s: float) -> None:
        """Add a round-trip time."""
        self._trips_s.append(trip_s)

    def clear(self) -> None:
        """Discard all times, after a missing response."""
        self._trips_s.clear()

    def median_s(self) -> float | None:
        """Return the median, or None without data."""
        return self._quantile(0.5)

    def p95_s(self) -> float | None:
        """Return the 95th percentile, or None without data."""
        return self._quantile(0.95)

    def jitter_s(self) -> float | None:
        """Return the 95th percentile minus the median, or None without data."""
        typical_s, late_s = self.median_s(), self.p95_s()
        return None if typical_s is None or late_s is None else late_s - typical_s

    def _quantile(self, share: float) -> float | None:
        ordered = sorted(self._trips_s)
        if not ordered:
            return None
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Latest state messages of a robot."""

    joints: JointState | None = None
    setpoint: JointState | None = None
    odom: Odometry | None = None
    odom_received_s: float = -np.inf
    """Arrival time of `odom`, on the clock passed to `poll`."""
    alternative: Odometry | None = None
    """Second estimate, if the robot has one."""
    truth: Odometry | None = None
    status: RobotStatus | None = None
    source: Source = "robot"
    """Sender of the status."""
    status_seq: int = 0
    status_robot_s: float = 0.0
    """Send time of the status on the robot's monotonic clock."""
    received_s: float = -np.inf
    """Arrival time of the latest state, on the clock passed to `poll`."""
    in_summary: bool = False
    """Whether states arrive in summaries, twice a second."""

    def motion_key(self) -> tuple[Any, ...]:
        """Return all poses, twists and joints as one value, to detect changes."""
        joints = [each for each in (self.joints, self.setpoint) if each is not None]
        odoms = self.odom, self.truth, self.alternative
        return (
            self.joints is None,
            *(each.names for each in joints),
            *(each.position_rad.tobytes() + each.velocity_rad_per_s.tobytes() for each in joints),
            *(each and each.xy_heading.tobytes() + each.twist.tobytes() for each in odoms),
            *(each and each.pose_covariance.tobytes() for each in odoms),
            *(each and each.wxyz is not None and each.wxyz.tobytes() for each in odoms),
        )

    def overdue_s(self, now_s: float) -> float:
        """Return the time since a state was due, which is its age unless it is in summaries."""
        return now_s - self.received_s - self.in_summary / topics.SUMMARY.rate_hz


_NO_MESHES = (
    "The description names a folder of meshes. A dashboard reads no files that a robot names: "
    "the generated look is shown."
)


class RobotMonitor(RobotConnection):
    """Connection that keeps the latest state of a robot, updated by `poll`.

    Call `poll` and `set_streaming` from one thread; all other methods are thread-safe.
    """

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        answer: bytes | None = None,
        instances: Instances | None = None,
    ) -> None:
        """Read the description and subscribe; see `RobotConnection`."""
        super().__init__(bus, robot_id, answer, instances)
        self.ignored = ""
        """Message about ignored parts of the description, or ""."""
        if self.robot.body.meshes is not None:
            # The path is only valid on the robot's computer.
            self.ignored = _NO_MESHES
            body = msgspec.structs.replace(self.robot.body, meshes=None)
            self.robot = msgspec.structs.replace(self.robot, body=body)
        self.snapshot = Snapshot()
        self.round_trips = RoundTrips()
        """Measured round-trip times."""
        self._frozen: RobotStatus | None = None
        self._streams: dict[str, tuple[Topic, Callable[[bytes], Any]]] = {
            "joints": (topics.JOINTS, decode_joints),
            "setpoint": (topics.SETPOINT, decode_joints),
            "odom": (topics.ODOM, self.decode_odometry),
            "alternative": (topics.ODOM_ALTERNATIVE, self.decode_odometry),
            "truth": (topics.TRUTH, self.decode_odometry),
        }
        self._subscribers: dict[str, Subscriber] = {}
        self._status: Subscriber | None = None
        self._summary = self.subscriber(topics.SUMMARY, 1)
        self._sends_summaries = False
        self.set_streaming(True)

    @property
    def is_recording(self) -> bool:
        """Whether only replays have this id; without liveliness tokens, taken from the status."""
        if instances := self._instances.of(self.id):
            return live_count(instances) == 0
        status = self.snapshot.status
        return status is not None and status.is_recording

    def close(self) -> None:
        """Close all subscriptions and publishers; the bus stays open."""
        self._end_streams()
        self._summary.close()
        super().close()

    @property
    def is_streaming(self) -> bool:
        """Whether all streams arrive at their rates; thread-safe."""
        return self._status is not None

    def set_streaming(self, on: bool) -> None:
        """Subscribe to all displayed topics, or only to summaries; call from the thread of `poll`.

        Robots do not encode messages without subscribers. A robot that has never sent a summary,
        such as an older one or a replay of its recording, is not reduced to it.
        """
        if on == self.is_streaming:
            return
        if on:
            self._subscribers = {
                name: self.subscriber(topic, 1) for name, (topic, _) in self._streams.items()
            }
            self._status = self.subscriber(topics.STATUS, 1)
        elif self._sends_summaries:
            self._end_streams()
            self.snapshot = replace(self.snapshot, in_summary=True)

    def _end_streams(self) -> None:
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._subscribers = {}
        if self._status is not None:
            self._status.close()
            self._status = None

    def poll(self, now_s: float) -> bool:
        """Process received messages; return whether a new status arrived.

        While another robot has the same id, the snapshot is frozen because messages of both would
        mix; its status gives the reason.
        """
        fresh: dict[str, Any] = {}
        new_status = self._poll_summary(fresh) or self._poll_streams(fresh)
        if fresh.get("odom") is not None:
            fresh["odom_received_s"] = now_s
        if self.has_duplicate:
            fresh = self._of_two(fresh) if new_status else {}
        else:
            self._frozen = None
            if new_status:
                recorded = self.is_recording or fresh["status"].is_recording
                fresh["source"] = "recording" if recorded else "robot"
        if fresh:
            self.snapshot = replace(self.snapshot, **fresh, received_s=now_s)
        return new_status

    def _of_two(self, fresh: dict[str, Any]) -> dict[str, Any]:
        if self._frozen is None:
            why = because(Code.DUPLICATE_ID, robot=self.id)
            self._frozen = msgspec.structs.replace(
                self.snapshot.status or fresh["status"],
                mode="fault",
                stop_reason=sentence(why),
                stop=why,
                arming=None,
                refusals=Refusals.of(dict.fromkeys(("arm", "drive", "set_pose", "speed"), why)),
            )
        number = self.snapshot.status_seq + 1
        return {"status": self._frozen, "status_seq": number, "source": "several"}

    def _poll_summary(self, fresh: dict[str, Any]) -> bool:
        if (sample := self._summary.newest()) is None:
            return False
        try:
            found = self._of_summary(sample)
        except (MessageError, KeyError):
            return False
        self._sends_summaries = True
        if self.is_streaming:  # The streams are newer.
            return False
        fresh |= found
        return True

    def _of_summary(self, sample: Sample) -> dict[str, Any]:
        summary = decode_summary(sample.payload)
        payloads = summary.payloads
        found: dict[str, Any] = {
            name: decode(payloads[topic.path]) if topic.path in payloads else None
            for name, (topic, decode) in self._streams.items()
        }
        found["status"] = decode_status(payloads[topics.STATUS.path])
        found["status_seq"] = summary.status_seq
        found["status_robot_s"] = 1e-9 * decode_stamp(sample.attachment)[1]
        found["in_summary"] = True
        return found

    def _poll_streams(self, fresh: dict[str, Any]) -> bool:
        for name, subscriber in self._subscribers.items():
            if (sample := subscriber.newest()) is not None:
                try:
                    fresh[name] = self._streams[name][1](sample.payload)
                except MessageError:
                    continue  # The age of the state reveals invalid samples.
        return self._poll_status(fresh)

    def _poll_status(self, fresh: dict[str, Any]) -> bool:
        sample = None if self._status is None else self._status.newest()
        if sample is None:
            return False
        try:
            fresh["status"], fresh["status_seq"] = numbered_status(sample)
            fresh["status_robot_s"] = 1e-9 * decode_stamp(sample.attachment)[1]
        except MessageError:
            return False
        fresh["in_summary"] = False
        return True
