"""Recordings of drives in virtual time, in the format of `tsd-record`, and their replays."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import numpy as np

from tests.support.controller_harness import PERIOD_S, ControllerHarness
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots
from tsd_twin.bus import Bus
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, encode_joints, encode_odometry
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import encode_stamp, encode_status
from tsd_twin.messages.topics import Sample, Service, Topic
from tsd_twin.recording import Replay, open_recording, play
from tsd_twin.recording.channels import EntryMaker
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.simulation import SimRobot

START_NS = 1_700_000_000_000_000_000
ROBOT_START_S = 100.0
"""Robot time at the start."""
_FLUSH_EVERY = 40
_EXACT = np.zeros((3, 3))


class RecordedDrive(ControllerHarness):
    """Recorded drive of a noisy simulated robot in virtual time."""

    def __init__(
        self,
        file: RecordingFile,
        name: str = "tsd",
        robot_id: str = "tsd",
        start_s: float = ROBOT_START_S,
    ) -> None:
        text = robots.read_description(name)
        robot = robots.parse_description(text, "test")
        self.id, self.file = robot_id, file
        self._make = EntryMaker()
        self._numbers = {topic: itertools.count(1) for topic in topics.TOPICS}
        self._periods = 0
        super().__init__(SimRobot(robot, 1, 1.0), start_s, robot)
        self.put_json(topics.alive_key(robot_id), {"alive": True})
        self.put_json(Service.DESC.key(robot_id), {"robot": text, "urdf": ""})

    @property
    def log_ns(self) -> int:
        return START_NS + round((self.now_s - ROBOT_START_S) * 1e9)

    def tick(self, dt_s: float = PERIOD_S) -> None:
        """Run one period and record the node's messages."""
        super().tick(dt_s)
        controller = self.controller
        for event in controller.take_events():
            self.put_event(event)
        if self._periods % 2 == 0:
            self._put_poses()
            self.put_state(topics.JOINTS, encode_joints(controller.joint_state(self.log_ns)))
            self.put_state(topics.SETPOINT, encode_joints(controller.setpoint_state(self.log_ns)))
        if self._periods % 5 == 0:
            self.put_state(topics.STATUS, encode_status(self.status()))
        self._periods += 1
        if self._periods % _FLUSH_EVERY == 0:
            self.file.flush()

    def circle(self, seconds: int) -> None:
        """Take control, arm, and drive in varying curves for some time."""
        pilot = self.get_ready()
        for second in range(seconds):
            speed = 0.35 if second % 10 < 8 else -0.2
            twist = (speed, 0.1 * np.sin(second), 0.5 * np.cos(0.3 * second))
            self.drive(pilot, twist, 1.0)

    def put_event(self, event: Event) -> None:
        self._put(topics.event_key(self.id, event.kind), msgspec.json.encode(event), b"")

    def put_state(self, topic: Topic, payload: bytes) -> None:
        """Record a state message with any payload."""
        stamp = encode_stamp(next(self._numbers[topic]), round(self.now_s * 1e9))
        self._put(topic.key(self.id), payload, stamp)

    def put_json(self, key: str, value: object) -> None:
        self.file.add(self._make.of_json(key, value, self.log_ns))

    def _put_poses(self) -> None:
        assert self.simulated is not None
        self.put_state(topics.ODOM, encode_odometry(self.controller.odometry(self.log_ns)))
        truth = self.simulated.truth(self.now_s)
        message = Odometry.of(truth.pose, truth.twist, _EXACT, _EXACT, self.log_ns)
        self.put_state(topics.TRUTH, encode_odometry(message))

    def _put(self, key: str, payload: bytes, attachment: bytes) -> None:
        for entry in self._make.of_sample(Sample(key, payload, attachment), self.log_ns):
            self.file.add(entry)


def recorded_circle(path: Path, seconds: int, name: str = "tsd") -> Path:
    """Write a recording of a robot that drives in curves."""
    file = RecordingFile(path)
    RecordedDrive(file, name).circle(seconds)
    file.close()
    return path


def stopped_drive(path: Path) -> Path:
    """Write a recording of `tsd`: one second of driving, then a stop."""
    file = RecordingFile(path)
    drive = RecordedDrive(file)
    drive.circle(1)
    drive.controller.stop(b'{"reason": "recorded"}', drive.now_s)
    drive.wait(1.0)
    file.close()
    return path


@contextmanager
def replaying(bus: Bus, path: Path, replay_id: str) -> Generator[None]:
    """Replay a recording of `tsd` in a loop on a bus."""
    stop = threading.Event()
    with closing(Replay(bus, open_recording(path), "tsd", replay_id)) as replay:
        thread = threading.Thread(target=play, args=(replay, stop, 1.0), kwargs={"loop": True})
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(PATIENCE_S)
