"""Where a robot believes to be: from its wheels, and from a gyro and a camera if it has them."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from tsd_twin.estimation import PoseFilter, Slip, with_gyro
from tsd_twin.estimation.odometry import CORRELATION_S
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import SE2
from tsd_twin.robots import Gyro
from tsd_twin.sim import Camera, CameraNoise, Frame, YawGyro

VOLT_STEP = 0.1
"""In which an MX-64 reports the voltage of its supply (Robotis e-Manual, present voltage)."""


class Observer:
    """The pose filter over the odometry of a virtual robot, on its mark at the start.

    It knows how late the bus is, and if it is given a floor, how wheels slide on it when they push.
    """

    def __init__(
        self,
        robot: VirtualRobot,
        gyro: YawGyro | None = None,
        camera: Camera | None = None,
        slip: Slip | None = None,
    ) -> None:
        self._gyro, self._camera, self._slip = gyro, camera, slip
        self._delay_s = robot.simulated.delay_s
        self._start_s = robot.now_s
        self._filter = PoseFilter(robot.core.drive, SE2.identity())
        self.frames: list[Frame] = []
        """What the camera has seen; times since the start."""

    def __call__(self, robot: VirtualRobot) -> SE2:
        """Return the pose after the newest measurement."""
        now_s = robot.now_s - self._start_s
        joints_s = now_s - self._delay_s
        odometry = robot.odometry()
        twist, covariance = odometry.twist, odometry.twist_covariance
        twist = robot.spin_share * twist
        if self._slip is not None:
            twist = self._slip.advance(twist, PERIOD_S)
        if self._gyro is not None:
            noise = self._gyro.noise
            rate = self._gyro.measure(robot.true_twist[2])
            sigma = float(np.hypot(noise.noise_rad_per_s, noise.bias_rad_per_s))
            twist, covariance = with_gyro(twist, covariance, rate, sigma)
        self._filter.advance(joints_s, twist, covariance * CORRELATION_S)
        if self._camera is not None:
            noise = self._camera.noise
            spread = np.diag([noise.sigma_m, noise.sigma_m, noise.sigma_rad]) ** 2
            for frame in self._camera.watch(now_s, robot.truth):
                self.frames.append(frame)
                self._filter.fuse_pose(SE2(frame.pose), spread, frame.taken_s)
        return self._filter.pose @ SE2.exp(twist * self._delay_s)


def voltage_share(robot: VirtualRobot) -> float:
    """Return the speed of wheels over that at the nominal voltage, by what servos report of it."""
    nominal_v = robot.core.robot.battery.nominal_v
    battery_v = robot.simulated.hardware().get("battery_v")
    if not isinstance(battery_v, float):
        return 1.0
    return VOLT_STEP * round(battery_v / VOLT_STEP) / nominal_v


class Loop(StrEnum):
    """What closes the loop of control."""

    OPEN = "open"
    WHEELS = "wheels"
    GYRO = "gyro"
    CAMERA = "camera"


def observer(
    loop: Loop, robot: VirtualRobot, seed: int, slip: Slip | None = None
) -> Observer | None:
    """Return who watches a robot on its mark; nobody when the loop is open.

    `slip` is for a plant whose wheels slide.
    """
    random = np.random.default_rng(seed)
    if loop is not Loop.OPEN:
        robot.spin_share = voltage_share(robot) * (1.0 if slip is None else slip.spin_share)
    match loop:
        case Loop.OPEN:
            return None
        case Loop.WHEELS:
            return Observer(robot, slip=slip)
        case Loop.GYRO:
            return Observer(robot, YawGyro(Gyro(), random), slip=slip)
        case Loop.CAMERA:
            gyro = YawGyro(Gyro(), random)
            return Observer(robot, gyro, Camera(CameraNoise(), random), slip)
