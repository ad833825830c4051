"""Where a robot believes to be: from its wheels, and from a gyro and a camera if it has them."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from tsd_twin.estimation import DriftFilter, Slip, with_gyro
from tsd_twin.lab.rolling import rolled
from tsd_twin.lab.turning import SPIN_LEFT, turn
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import Gyro
from tsd_twin.sim import Camera, CameraNoise, Frame, YawGyro

VOLT_STEP = 0.1
"""In which an MX-64 reports the voltage of its supply (Robotis e-Manual, present voltage)."""
_FRICTION_SHARE = 0.25
"""Standard deviation of the friction of a floor that was not measured."""


class Observer:
    """The pose of a virtual robot, on its mark at the start.

    It knows how late the bus is, and if it is given a floor, how wheels slide on it when they push.
    What it does not know are five numbers that stay: by how much all wheels spin faster, with what
    velocity the robot creeps since gimbals are not upright when they say so, the bias of its gyro,
    and how much later than reckoned the floor lets it follow its wheels. A camera tells them.
    """

    def __init__(
        self,
        robot: VirtualRobot,
        gyro: YawGyro | None = None,
        camera: Camera | None = None,
        slip: Slip | None = None,
        *,
        spin_sigma: float | None = None,
    ) -> None:
        """`spin_sigma` is how well the share is known by which all wheels spin faster.

        As described of each of the wheels, unless it is given.
        """
        self._gyro, self._camera, self.slip = gyro, camera, slip
        self._delay_s = robot.simulated.delay_s
        self._start_s = robot.now_s
        if spin_sigma is None:
            wheels = len(robot.core.drive.actuators)
            spin_sigma = robot.core.robot.joint_errors().spin_share / float(np.sqrt(wheels))
        creep = np.sqrt(np.diag(robot.odometry().twist_covariance))
        if gyro is not None:
            creep[2] = gyro.noise.bias_rad_per_s
        late_s = 0.0 if slip is None else _FRICTION_SHARE * slip.lag_s
        sigma = np.array([spin_sigma, *creep, late_s])
        self._filter = DriftFilter(SE2.identity(), sigma)
        self._twist: Array = np.zeros(3)
        self.frames: list[Frame] = []
        """What the camera has seen; times since the start."""

    def __call__(self, robot: VirtualRobot) -> SE2:
        """Return the pose after the newest measurement."""
        now_s = robot.now_s - self._start_s
        before, self._twist = self._twist, rolled(robot, self.slip)
        # What only rolls has moved by the mean of its step; what slides is known at its end.
        mean = self._twist if self.slip is None else 0.5 * (before + self._twist)
        covariance = robot.odometry().twist_covariance
        if self._gyro is not None:
            noise = self._gyro.noise
            rate = self._gyro.measure(robot.true_twist[2])
            sigma = float(np.hypot(noise.noise_rad_per_s, noise.bias_rad_per_s))
            mean, covariance = with_gyro(mean, covariance, rate, sigma)
        later = (before - self._twist) / PERIOD_S
        by_errors = np.column_stack([mean, np.eye(3), later])
        if self._gyro is not None:
            # It knows of turns by itself, however wheels spin and slide.
            by_errors[2, [0, -1]] = 0.0
        # What does not stay is new in each sample.
        self._filter.advance(now_s - self._delay_s, mean, by_errors, covariance * PERIOD_S)
        self._look(robot, now_s)
        return self._filter.pose @ SE2.exp(mean * self._delay_s)

    def _look(self, robot: VirtualRobot, now_s: float) -> None:
        if self._camera is None:
            return
        noise = self._camera.noise
        spread = np.diag([noise.sigma_m, noise.sigma_m, noise.sigma_rad]) ** 2
        for frame in self._camera.watch(now_s, robot.truth):
            self.frames.append(frame)
            self._filter.fuse_pose(SE2(frame.pose), spread, frame.taken_s)


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
    loop: Loop, robot: VirtualRobot, seed: int, slip: Slip | None = None, *, turns: bool = False
) -> Observer | None:
    """Return who watches a robot on its mark; nobody when the loop is open.

    `slip` is for a plant whose wheels slide. A robot with a gyro that `turns` does so on the spot
    beforehand, to learn how fast its wheels spin and slide, and is put on its mark then.
    """
    if loop is Loop.OPEN:
        return None
    random = np.random.default_rng(seed)
    robot.spin_share = voltage_share(robot) * (1.0 if slip is None else slip.rest_share)
    if loop is Loop.WHEELS:
        return Observer(robot, slip=slip)
    gyro, spin_sigma = YawGyro(Gyro(), random), None
    if turns:
        turned = turn(robot, gyro, slip)
        robot.spin_share *= turned.spin_share
        slip = None if slip is None else slip.later(turned.later_s)
        robot.mark()
        spin_sigma = SPIN_LEFT
    camera = Camera(CameraNoise(), random) if loop is Loop.CAMERA else None
    return Observer(robot, gyro, camera, slip, spin_sigma=spin_sigma)
