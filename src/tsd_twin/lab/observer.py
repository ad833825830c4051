"""Pose observer of a virtual robot: wheels, and a gyro and a camera if it has them."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from tsd_twin.client.simulated import PERIOD_S, VirtualRobot, voltage_share
from tsd_twin.estimation import DriftFilter, Slip, with_gyro
from tsd_twin.estimation.wheel_odometry import JointNoise
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import Gyro
from tsd_twin.simulation import Camera, CameraNoise, Frame, YawGyro


def twist_from_wheels(robot: VirtualRobot, slip: Slip | None) -> Array:
    """Return the twist (3,) from the wheels after one period, with the slip model if given."""
    twist = robot.spin_share * robot.controller.mean_twist
    return twist if slip is None else slip.advance(twist / slip.rest_share, PERIOD_S)


REMAINING_SPIN_SIGMA = 0.002
"""Standard deviation of the remaining error of the share, mainly due to wheel layers."""
_RATE_RAD_PER_S = 2.5
_SWING_S = 2.5
_REST_S = 0.5


class SpinMeasurement(NamedTuple):
    """Result of the spin measurement by a turn in place."""

    spin_share: float
    """Wheel speed relative to the assumed one."""
    later_s: float
    """Additional lag of the body behind its wheels."""


def measure_spin(robot: VirtualRobot, gyro: YawGyro, slip: Slip | None) -> SpinMeasurement:
    """Measure the spin: turn a robot to and fro, and compare its gyro with its wheels.

    The rate is a sine: gimbals pass through all tilts, so that servo steps and wheel layers average
    out, and constant offsets cancel between both directions.
    """
    by_wheels: list[float] = []
    by_gyro: list[float] = []
    for i in range(round((_SWING_S + _REST_S) / PERIOD_S)):
        t_s = i * PERIOD_S
        wave = float(np.sin(2.0 * np.pi * t_s / _SWING_S))
        rate = _RATE_RAD_PER_S * wave if t_s < _SWING_S else 0.0
        robot.drive(np.array([0.0, 0.0, rate]))
        by_wheels.append(float(twist_from_wheels(robot, slip)[2]))
        by_gyro.append(float(gyro.measure(robot.true_twist[2])))
    # Wheel measurements are delayed, those of the gyro are not.
    at_s: Array = PERIOD_S * np.arange(len(by_gyro), dtype=np.float64)
    seen = np.interp(at_s - robot.simulated.delay_s, at_s, by_gyro)
    expected = np.array(by_wheels)
    columns = np.column_stack([expected, -np.gradient(expected, PERIOD_S)])
    share, late = np.linalg.lstsq(columns, seen)[0].tolist()
    return SpinMeasurement(share, late / share)


_FRICTION_SHARE = 0.25
"""Standard deviation of the friction of an unmeasured floor."""


class PoseObserver:
    """Pose observer of a virtual robot that starts at its mark.

    The delay of the bus is known, and the slip model if given. Five constant errors are not known:
    the common factor of the wheel speeds, the two components of the drift velocity due to gimbal
    zeros, the gyro bias, and the additional lag on the floor. A camera makes them observable.
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
        """`spin_sigma` is the standard deviation of the common factor of the wheel speeds.

        The default is the described one of each wheel.
        """
        self._gyro, self._camera, self.slip = gyro, camera, slip
        self._delay_s = robot.simulated.delay_s
        self._start_s = robot.now_s
        if spin_sigma is None:
            wheels = len(robot.controller.kinematics.actuators)
            spin_sigma = robot.controller.robot.joint_errors().spin_share / float(np.sqrt(wheels))
        self._noise = JointNoise(robot.controller.kinematics, robot.controller.robot.joint_errors())
        creep = np.sqrt(np.diag(self._twist_noise(robot)))
        if gyro is not None:
            creep[2] = gyro.noise.bias_rad_per_s
        late_s = 0.0 if slip is None else _FRICTION_SHARE * slip.lag_s
        sigma = np.array([spin_sigma, *creep, late_s])
        self._filter = DriftFilter(SE2.identity(), sigma)
        self._twist: Array = np.zeros(3)
        self.frames: list[Frame] = []
        """Camera frames; times since the start."""

    def __call__(self, robot: VirtualRobot) -> SE2:
        """Pose after the newest measurement."""
        now_s = robot.now_s - self._start_s
        before, self._twist = self._twist, twist_from_wheels(robot, self.slip)
        # Pure rolling gives the mean twist of the step; the slip model gives the twist at its end.
        mean = self._twist if self.slip is None else 0.5 * (before + self._twist)
        covariance = self._twist_noise(robot)
        if self._gyro is not None:
            noise = self._gyro.noise
            rate = self._gyro.measure(robot.true_twist[2])
            sigma = float(np.hypot(noise.noise_rad_per_s, noise.bias_rad_per_s))
            mean, covariance = with_gyro(mean, covariance, rate, sigma)
        later = (before - self._twist) / PERIOD_S
        by_errors = np.column_stack([mean, np.eye(3), later])
        if self._gyro is not None:
            # The gyro measures turns independently of spin and slip.
            by_errors[2, [0, -1]] = 0.0
        # Errors that are not constant are independent in each sample.
        self._filter.advance(now_s - self._delay_s, mean, by_errors, covariance * PERIOD_S)
        self._fuse_camera(robot, now_s)
        return self._filter.pose @ SE2.exp(mean * self._delay_s)

    def _twist_noise(self, robot: VirtualRobot) -> Array:
        """Return the covariance (3, 3) of the twist, but for errors that all wheels share.

        The filter estimates these.
        """
        joints = robot.controller.joints
        nudged = np.tile(joints, (len(joints) + 1, 1))
        nudged[1:] += np.diag(np.maximum(self._noise.sigma(joints), 1e-9))
        twists = robot.controller.kinematics.forward(nudged).twist
        shift = twists[1:] - twists[0]
        return shift.T @ shift

    def _fuse_camera(self, robot: VirtualRobot, now_s: float) -> None:
        if self._camera is None:
            return
        noise = self._camera.noise
        spread = np.diag([noise.sigma_m, noise.sigma_m, noise.sigma_rad]) ** 2
        for frame in self._camera.capture(now_s, robot.truth):
            self.frames.append(frame)
            self._filter.fuse_pose(SE2(frame.pose), spread, frame.taken_s)


class Loop(StrEnum):
    """Feedback of the control loop."""

    OPEN = "open"
    WHEELS = "wheels"
    GYRO = "gyro"
    CAMERA = "camera"


def make_observer(
    loop: Loop, robot: VirtualRobot, seed: int, slip: Slip | None = None, *, turns: bool = False
) -> PoseObserver | None:
    """Observer of a robot at its start pose; None when the loop is open.

    `slip` is for a plant whose wheels slide. With `turns`, a robot with a gyro first turns in place
    to measure its spin and slip, and its mark is set afterwards.
    """
    if loop is Loop.OPEN:
        return None
    random = np.random.default_rng(seed)
    robot.spin_share = voltage_share(robot) * (1.0 if slip is None else slip.rest_share)
    if loop is Loop.WHEELS:
        return PoseObserver(robot, slip=slip)
    gyro, spin_sigma = YawGyro(Gyro(), random), None
    if turns:
        turned = measure_spin(robot, gyro, slip)
        robot.spin_share *= turned.spin_share
        slip = None if slip is None else slip.later(turned.later_s)
        robot.mark()
        spin_sigma = REMAINING_SPIN_SIGMA
    camera = Camera(CameraNoise(), random) if loop is Loop.CAMERA else None
    return PoseObserver(robot, gyro, camera, slip, spin_sigma=spin_sigma)
