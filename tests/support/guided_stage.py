"""A robot with a wrong calibration on a guided drive under a camera, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tsd_twin import robots
from tsd_twin.calibration.collect import with_calibration
from tsd_twin.calibration.drive_log import Recording
from tsd_twin.calibration.guided_drive import GuidedDriver, GuidedRoute, plan_calibration
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.sensors.pose import Camera, CameraNoise
from tsd_twin.simulation import SimRobot

ROBOT = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription)
ZEROS_DEG = np.array([[0.4, -0.3], [0.2, 0.5], [-0.4, 0.1]])
SPEED_MPS, ROOM_M = 1.0, 1.0
WHERE = SE2(np.array([3.0, -2.0, 2.5]))
"""Robot frame in the camera frame."""
View = Callable[[Array, float], Array | None]


def as_seen(pose: Array, _now_s: float) -> Array | None:
    """Return the pose unchanged, like a faultless camera."""
    return pose


@dataclass
class Stage:
    """Robot with a wrong calibration, driven by a guide under a camera."""

    late_s: float = 0.08
    speed_mps: float = SPEED_MPS
    zeros_deg: Array = field(default_factory=lambda: ZEROS_DEG)
    view: View = as_seen
    truths: list[tuple[float, Array]] = field(default_factory=list)
    """True poses in the camera frame, with times."""
    rows: list[tuple[float, Array, Array]] = field(default_factory=list)
    plan: Callable[[SingularityDescription, float, float], GuidedRoute] = plan_calibration
    frames: list[tuple[float, Array]] = field(default_factory=list)
    farthest_m: float = 0.0

    def __post_init__(self) -> None:
        true = with_calibration(ROBOT, self.zeros_deg, np.array([1.01, 0.99, 1.0]), 0.0404, 0.149)
        self.machine = SimRobot(true, 0, 1.0, errors=1.0, believed=ROBOT)
        self.volts = float(str(self.machine.hardware()["battery_v"]))
        self.robot = VirtualRobot(ROBOT, self.machine)
        self.tour = self.plan(ROBOT, ROOM_M, self.speed_mps)
        self.guide = GuidedDriver(ROBOT, self.tour)
        noise = CameraNoise(latency_s=self.late_s)
        self.camera = Camera(noise, np.random.default_rng(1))

    def run(self, longest_s: float = 60.0) -> None:
        """Drive until the tour is finished; exceptions of the view end the drive."""
        start = self.robot.now_s
        while not self.guide.finished:
            now_s = self.robot.now_s - start
            self.truths.append((now_s, (WHERE @ self.robot.truth).xy_heading))
            assert now_s < longest_s
            for frame in self.camera.capture(now_s, WHERE @ self.robot.truth):
                seen = self.view(frame.pose, now_s)
                if seen is not None:
                    self.frames.append((frame.taken_s, seen))
                    self.guide.add_pose(SE2(seen), frame.taken_s)
            self.guide.add_twist(now_s, self.robot.odometry().twist)
            # The robot rests until the first frame.
            twist = self.guide.advance(now_s) if self.frames else np.zeros(3)
            joints, told = self.robot.controller.joints, self.robot.controller.setpoint
            angles = joints.reshape(-1, 3)[:, :2].ravel()
            self.rows.append((now_s, angles, told[2::3] * self.volts / 12.0))
            self.robot.drive(twist)
            x_m, y_m, _ = np.abs(self.robot.truth.xy_heading)
            self.farthest_m = max(self.farthest_m, float(x_m), float(y_m))

    def stop(self) -> None:
        """Send no more commands until standstill, and record the farthest position."""
        while np.abs(self.robot.controller.twist).max() > 0.0:
            self.robot.coast()
            x_m, y_m, _ = np.abs(self.robot.truth.xy_heading)
            self.farthest_m = max(self.farthest_m, float(x_m), float(y_m))

    def recording(self) -> Recording:
        t_s, angles, told = (np.array(column) for column in zip(*self.rows, strict=True))
        seen_s, seen = (np.array(column) for column in zip(*self.frames, strict=True))
        seen[:, 2] = np.unwrap(seen[:, 2])
        return Recording(t_s, angles, told, np.full(told.shape, np.nan), seen_s, seen)
