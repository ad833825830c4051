"""Guided drive of a robot on the bus: camera, consent, control, and recording."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tsd_twin.calibration.drive_log import Recording, RobotRecorder, battery_v
from tsd_twin.calibration.guided_drive import (
    POSE_TIMEOUT_S,
    GuidedDriver,
    GuidedRoute,
    max_unheard_s,
    requested_command_age_s,
)
from tsd_twin.calibration.operator import (
    add_bus_flags,
    confirm,
    connect,
    hold_control,
    interruptible,
    longest_pause_s,
    watch_keys,
)
from tsd_twin.cli import flags
from tsd_twin.cli.experiment import Output
from tsd_twin.client import RobotControl
from tsd_twin.client.bus_port import BusLink
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.status import BiasStatus, decode_stamp
from tsd_twin.robots import SingularityDescription, description_of_kind

_CAMERA_TIMEOUT_S = 3.0
"""Timeout for the first pose measurement."""
_LAST_FRAME_S = 1.1
"""Recording time after the end of the drive, because poses may be delayed by a second."""


@dataclass(frozen=True, slots=True, eq=False)
class BusDrive:
    """Completed guided drive of a robot on the bus."""

    robot_id: str
    text: str
    """The active description in TOML."""
    robot: SingularityDescription
    recording: Recording
    driver: GuidedDriver
    learned: Mapping[str, BiasStatus]
    """Biases estimated by the robot."""


def drive_on_bus(
    args: argparse.Namespace,
    out: Output,
    plan: Callable[[SingularityDescription], GuidedRoute],
    what: str,
) -> BusDrive:
    """Drive a route by a camera after the operator's consent, and return the recording.

    `args` has the flags of `add_drive_flags`; `what` describes the route, with a placeholder for
    the side of its squares.

    Raises:
        TwinError: If the drive cannot start or was aborted; the robot is disarmed and released.
    """
    with connect(args) as (client, link):
        robot = description_of_kind(link.robot, SingularityDescription)
        route = plan(robot)
        subscriber = _RobotSubscriber(link, robot, route)
        _wait_for_camera(subscriber, link.id)
        confirm(args, _warning(args, link.id, route, what))
        max_age_s = requested_command_age_s(robot, args.speed)
        with watch_keys() as pressed, hold_control(client, args.operator, max_age_s) as control:
            spin_up = _stop_on_key(control.arming(), pressed)
            out.show_progress(spin_up, 1.0, "spinning up, any key stops")
            pause_s = longest_pause_s(robot.limits, max_age_s)
            drive = subscriber.drive(control, pressed, pause_s)
            out.show_progress(drive, 1.0, "driving, any key stops")
            status = client.state.status
        recording = subscriber.recording(battery_v(status))
        return BusDrive(
            link.id,
            link.description.robot,
            robot,
            recording,
            subscriber.driver,
            status.learned or {},
        )


def add_drive_flags(parser: argparse.ArgumentParser, drives: str) -> None:
    """Add `--drive`, with its help `drives`, and the flags of a guided drive."""
    parser.add_argument("--drive", action="store_true", help=drives)
    text = "with --drive: free floor on all sides of its centre, beyond its own size; default 1"
    flags.add(parser, "--room", text, flags.POSITIVE, 1.0, "METRES")
    text = "with --drive: at most, m/s; default 0.5"
    flags.add(parser, "--speed", text, flags.POSITIVE, 0.5, "MPS")
    add_bus_flags(parser)


class _RobotSubscriber:
    """Subscribes to the robot; feeds the recorder and the driver."""

    def __init__(self, link: BusLink, robot: SingularityDescription, route: GuidedRoute) -> None:
        self._robot, self._route = robot, route
        self.driver = GuidedDriver(robot, route)
        self.recorder = RobotRecorder(robot)
        self._joints = link.subscriber(topics.JOINTS, 256)
        self._setpoints = link.subscriber(topics.SETPOINT, 512)
        self._odometry = link.subscriber(topics.ODOM, 256)
        self._poses = link.subscriber(topics.SENSOR_POSE, 256)
        self.poses = 0
        self._now_s = -np.inf
        self._first_s = np.inf
        self._finished_s: float | None = None
        self._odometry_received_s = -np.inf

    def poll(self) -> None:
        """Process the samples since the last call."""
        for sample in self._joints.take_samples():
            self.recorder.add_joints(sample)
        for sample in self._setpoints.take_samples():
            self.recorder.add_setpoint(sample)
        for sample in self._poses.take_samples():
            seen = self.recorder.add_pose(sample)
            if seen is not None:
                self.poses += 1
                self.driver.add_pose(*seen)
        for sample in self._odometry.take_samples():
            try:
                now_s = decode_stamp(sample.attachment)[1] * 1e-9
                twist = decode_odometry(sample.payload).twist
            except MessageError:
                continue
            if now_s > self._now_s and np.isfinite(twist).all():
                self._now_s, self._odometry_received_s = now_s, time.monotonic()
                self.driver.add_twist(now_s, twist)

    def drive(
        self, control: RobotControl, key_pressed: Callable[[], bool], pause_s: float
    ) -> Iterator[float]:
        """Drive the route, wait for the last delayed poses, and yield the progress."""
        self.poll()
        # Discard earlier poses, because the robot may have been carried since.
        self.driver = GuidedDriver(self._robot, self._route)
        self._wait_for_pose(control)
        self._first_s = self._now_s
        for _ in control.driving(interruptible(self._step, key_pressed, pause_s)):
            yield self.driver.progress

    def _wait_for_pose(self, control: RobotControl) -> None:
        """Remain at rest until a pose measurement arrives."""
        before = self.poses
        for _ in control.staying_ready(POSE_TIMEOUT_S):
            self.poll()
            if self.poses > before:
                return

    def _step(self, now_s: float) -> Array | None:
        self.poll()
        patience_s = max_unheard_s(self._robot.limits)
        if now_s - self._odometry_received_s > patience_s:
            raise TwinError(f"no odometry has arrived for {patience_s:g} s")
        twist = self.driver.advance(self._now_s)
        if self.driver.finished:
            self._finished_s = self._finished_s or now_s
            if now_s > self._finished_s + _LAST_FRAME_S:
                return None
        return twist

    def recording(self, volts: float | None) -> Recording:
        """Return the recording of the drive, at a battery voltage if known."""
        return self.recorder.recording(self._first_s, self._now_s, volts)


def _stop_on_key(shares: Iterator[float], pressed: Callable[[], bool]) -> Iterator[float]:
    """Iterate over `shares`, and raise if a key is pressed."""
    for share in shares:
        if pressed():
            raise TwinError("stopped by a key")
        yield share


def _wait_for_camera(subscriber: _RobotSubscriber, robot_id: str) -> None:
    """Raise unless pose measurements arrive."""
    end_s = time.monotonic() + _CAMERA_TIMEOUT_S
    while subscriber.poses < 2:
        subscriber.poll()
        if time.monotonic() > end_s:
            refused = subscriber.recorder.refused
            raise TwinError(
                f"the poses on twin/{robot_id}/sensor/pose are rejected: {refused}"
                if refused
                else f"no pose measurements on twin/{robot_id}/sensor/pose: start tsd-camera there "
                "(docs/camera.md), or tsd-mock --camera"
            )
        time.sleep(0.02)


def _warning(args: argparse.Namespace, robot_id: str, route: GuidedRoute, what: str) -> str:
    return (
        f"{robot_id} will drive {what.format(2 * route.half_m)}, "
        f"at up to {args.speed:g} m/s, for some {route.duration_s:.0f} s.\nIts centre stays "
        f"within {route.half_m:.2f} m of here in each direction, and it is stopped at "
        f"{route.fence_m:.2f} m.\nIt needs {args.room:g} m of free, level floor on all sides, and "
        "its own size besides. Have the hardware stop at hand.\n"
        "Any key here stops it, and so does Ctrl-C."
    )
