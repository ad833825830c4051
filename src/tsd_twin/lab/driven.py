"""A robot on the bus that is driven through squares and turns, and what was measured of it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tsd_twin import topics
from tsd_twin.errors import MessageError, TwinError
from tsd_twin.lab.driver import Driver
from tsd_twin.lab.guide import BLIND_S, Guide
from tsd_twin.lab.joining import joined
from tsd_twin.lab.keyboard import Keys, ask, say
from tsd_twin.lab.operator import Operator
from tsd_twin.lab.output import Output
from tsd_twin.lab.percents import PARTS, percents
from tsd_twin.lab.recorder import Recorder
from tsd_twin.lab.recording import Recording, read
from tsd_twin.lab.tour import Tour, patient_age_s, tour, unheard_s
from tsd_twin.lie import Array
from tsd_twin.messages.ros import decode_odometry
from tsd_twin.messages.status import Status, decode_stamp
from tsd_twin.robots import SingularityRobot, of_kind

_CAMERA_S = 3.0
"""So long somebody who sees the robot is waited for."""
_LAST_FRAME_S = 1.1
"""After the end, for what was seen of it: poses may be late by a second."""


class Driven(NamedTuple):
    """What became of a drive."""

    id: str
    text: str
    """The TOML of the robot's description."""
    robot: SingularityRobot
    recordings: list[Recording]
    """Those of `--log`, and this one."""


def driven(args: argparse.Namespace, out: Output) -> Driven:
    """Lead through a drive and return what was recorded of it; nothing moves before consent.

    Raises:
        TwinError: it cannot begin, or something ended it; the robot has been let go of.
    """
    with joined(args) as operator:
        robot = of_kind(operator.robot, SingularityRobot)
        earlier = read(args.log, robot.drive.modules) if args.log else []
        ways = tour(robot, args.room, args.speed)
        senses = _Senses(operator, robot, Guide(robot, ways))
        _wait_for_camera(senses, operator.id)
        _brief(args, operator.id, ways)
        operator.max_age_s = patient_age_s(robot, args.speed)
        with Keys() as keys, operator:
            spin_up = _unless_pressed(operator.get_ready(), keys)
            for _ in out.progress(percents(spin_up, 1.0), "spinning up, any key stops", PARTS):
                pass
            # What was seen before is not where it begins: it may have been carried since.
            senses.begin_with(Guide(robot, ways))
            drive = senses.drive(Driver(operator, keys))
            for _ in out.progress(percents(drive, 1.0), "driving, any key stops", PARTS):
                pass
        return Driven(operator.id, operator.text, robot, [*earlier, senses.recording()])


class _Senses:
    """All that is heard of the robot, passed to who records it and to who leads it."""

    def __init__(self, operator: Operator, robot: SingularityRobot, guide: Guide) -> None:
        self._operator, self._guide = operator, guide
        self.recorder = Recorder(robot)
        bus, robot_id = operator.bus, operator.id
        self._joints = bus.reader(topics.JOINTS.key(robot_id), 256)
        self._setpoints = bus.reader(topics.SETPOINT.key(robot_id), 512)
        self._odometry = bus.reader(topics.ODOM.key(robot_id), 256)
        self._poses = bus.reader(topics.OUTSIDE_POSE.key(robot_id), 256)
        self.poses = 0
        self._now_s = -np.inf
        self._first_s = np.inf
        self._finished_s: float | None = None
        self._heard_s = -np.inf
        self._battery_v: float | None = None

    def begin_with(self, guide: Guide) -> None:
        """Let another guide lead."""
        self.listen()
        self._guide = guide

    def listen(self) -> None:
        """Take in what has come since the last call."""
        for sample in self._joints.take():
            self.recorder.joints(sample)
        for sample in self._setpoints.take():
            self.recorder.setpoint(sample)
        for sample in self._poses.take():
            seen = self.recorder.pose(sample)
            if seen is not None:
                self.poses += 1
                self._guide.see(*seen)
        for sample in self._odometry.take():
            try:
                now_s = decode_stamp(sample.attachment)[1] * 1e-9
                twist = decode_odometry(sample.payload).twist
            except MessageError:
                continue
            if now_s > self._now_s and np.isfinite(twist).all():
                self._now_s, self._heard_s = now_s, time.monotonic()
                self._guide.move(now_s, twist)

    def drive(self, driver: Driver) -> Iterator[float]:
        """Drive the tour and stand until all of it was seen; yield the share that is done."""
        self._wait_for_a_pose()
        self._first_s = self._now_s
        for _ in driver.drive(self._step):
            yield self._guide.progress
        self._battery_v = _battery_v(self._operator.status())

    def _wait_for_a_pose(self) -> None:
        """Stand until somebody has seen the robot stand there."""
        before = self.poses
        for _ in self._operator.hold(BLIND_S):
            self.listen()
            if self.poses > before:
                return

    def _step(self, now_s: float) -> Array | None:
        self.listen()
        patience_s = unheard_s(self._operator.robot.limits)
        if now_s - self._heard_s > patience_s:
            raise TwinError(f"how it moves has not been heard for {patience_s:g} s")
        twist = self._guide.advance(self._now_s)
        if self._guide.finished:
            self._finished_s = self._finished_s or now_s
            if now_s > self._finished_s + _LAST_FRAME_S:
                return None
        return twist

    def recording(self) -> Recording:
        """Return the drive."""
        return self.recorder.recording(self._first_s, self._now_s, self._battery_v)


def _unless_pressed(shares: Iterator[float], keys: Keys) -> Iterator[float]:
    """Go through `shares`, and raise when a key is pressed meanwhile."""
    for share in shares:
        if keys.pressed(0.0):
            raise TwinError("stopped by a key")
        yield share


def _wait_for_camera(senses: _Senses, robot_id: str) -> None:
    """Raise unless somebody tells where the robot is."""
    end_s = time.monotonic() + _CAMERA_S
    while senses.poses < 2:
        senses.listen()
        if time.monotonic() > end_s:
            refused = senses.recorder.refused
            raise TwinError(
                f"what comes on twin/{robot_id}/in/pose is of no use: {refused}"
                if refused
                else f"nobody tells on twin/{robot_id}/in/pose where {robot_id} is: a camera has "
                "to (docs/estimation.md), or tsd-mock --camera"
            )
        time.sleep(0.02)


def _brief(args: argparse.Namespace, robot_id: str, ways: Tour) -> None:
    """Tell what will happen, and wait for a word."""
    if args.yes:
        return
    say(
        f"{robot_id} will drive squares of {2 * ways.half_m:.2f} m and turn on the spot, both "
        f"ways, at up to {args.speed:g} m/s, for some {ways.duration_s:.0f} s.\nIts centre stays "
        f"within {ways.half_m:.2f} m of here in each direction, and it is stopped at "
        f"{ways.fence_m:.2f} m.\nIt needs {args.room:g} m of free, level floor on all sides, and "
        "its own size besides. Have the hardware stop at hand.\n"
        "Any key here stops it, and so does Ctrl-C."
    )
    ask("Enter begins: ")


def _battery_v(status: Status) -> float | None:
    """Return the voltage that the robot reports, if it does."""
    volts = status.hardware.get("battery_v")
    return float(volts) if isinstance(volts, int | float) and 0.0 < volts < np.inf else None
