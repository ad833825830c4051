"""Pose observer of a virtual robot with wheels and optional gyro and camera, and a slip model."""

from __future__ import annotations

import math
from enum import StrEnum

import msgspec
import numpy as np

from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot, voltage_share
from tsd_twin.estimation import DriftFilter, with_gyro
from tsd_twin.estimation.joint_errors import JointNoise
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.sensors.gyro import Gyro, YawGyro
from tsd_twin.sensors.pose import Camera, CameraNoise, Frame

_GRAVITY_MPS2 = 9.81
_SPIN_IN_SLIP = 8.0 / (3.0 * math.pi)
"""Weight of the rim speed of a contact patch relative to the slip (Zhuravlev 1998)."""

_SLIP_IN_SPIN = 15.0 * math.pi / 16.0
"""Weight of the slip relative to the rim speed, for the torque of the patch."""
_MEAN_LEVER = 3.0 * math.pi / 16.0
"""Friction lever of a purely spinning patch, in radii, under Hertzian pressure."""
_MAX_ITERATIONS = 20
"""Fixed-point iterations; each halves the error, up to 0.7 of the friction limit."""


class Slip:
    """Slip model: body twist on a floor with friction, from the rolling of the wheels.

    The friction of a spinning wheel is viscous: it transmits force only while the wheel slides, by
    a few cm/s, which gimbals cannot measure. The body therefore lags its wheels, and hardly follows
    demands beyond the friction limit. Accelerating the body slows the wheels down, and braking
    speeds them up, faster than the motors compensate. Assumptions: equal wheel loads; the chassis
    is a disc with the diameter of the pivot circle, with the modules on its rim; a wheel is half a
    hollow sphere.
    """

    def __init__(self, robot: SingularityDescription, batch: tuple[int, ...] = ()) -> None:
        kinematics: SingularityKinematics = robot.kinematics()
        mass = robot.mass.total_kg
        self._robot, self._batch = robot, batch
        self._mass = np.diag([mass, mass, robot.turning_inertia_kg_m2])
        self._rows = kinematics.contact_from_twist
        self._squares = np.einsum("kij,kil->kjl", self._rows, self._rows)
        self._most_n = robot.floor.friction * mass * _GRAVITY_MPS2 / kinematics.modules
        patch_m, self._spin_rad_per_s = robot.floor.patch_radius_m, kinematics.spin_rad_per_s
        self._rim_mps = patch_m * self._spin_rad_per_s
        self._lever_m = _MEAN_LEVER * patch_m
        # The motor torque follows from its time constant, see `MujocoSimulation`.
        inertia = robot.mass.wheel_kg * kinematics.wheel_radius_m**2 * 2.0 / 3.0
        self._share_per_nms = 1.0 / (inertia * self._spin_rad_per_s)
        self._up_s = robot.motor.time_constant_up_s
        self._down_s = robot.motor.time_constant_down_s
        slower = self._most_n * self._lever_m * self._up_s * self._share_per_nms
        self.rest_share: float = 1.0 - slower
        """Speed of wheels that spin on the floor at rest, relative to their setpoint."""
        self.speed_fraction: Array = np.full((*batch, kinematics.modules), self.rest_share)
        """(..., k): speed of each wheel, relative to its setpoint."""
        self.twist: Array = np.zeros((*batch, 3))
        """(..., 3): twist of the body, in its frame."""

    @property
    def lag_s(self) -> float:
        """Time constant with which the body follows its wheels, for small forces."""
        wheels = len(self._rows)
        return float(self._mass[0, 0]) * _SPIN_IN_SLIP * self._rim_mps / (wheels * self._most_n)

    @property
    def turning_lag_s(self) -> float:
        """Time constant of a turning body, for small forces."""
        across = float(np.trace(self._squares.sum(axis=0)[2:, 2:]))
        return float(self._mass[2, 2]) * _SPIN_IN_SLIP * self._rim_mps / (across * self._most_n)

    def later(self, turning_s: float) -> Slip:
        """Return this model at rest on a floor with a turning lag longer by `turning_s`.

        The friction changes by at most a factor of two.
        """
        share = np.clip(1.0 + turning_s / self.turning_lag_s, 0.5, 2.0)
        floor = self._robot.floor
        floor = msgspec.structs.replace(floor, friction=floor.friction / float(share))
        return Slip(msgspec.structs.replace(self._robot, floor=floor), self._batch)

    def advance(self, rolling: Array, dt_s: float, pieces: int = 4) -> Array:
        """Return the twist (..., 3) after `dt_s` seconds.

        `rolling` (..., 3) is the twist without slip and with wheels at their setpoints. Uses the
        trapezoidal rule with the friction of the previous slip, which is stable for any step.
        """
        step_s = dt_s / pieces
        demanded = np.einsum("kij,...j->...ki", self._rows, rolling)
        for _ in range(pieces):
            share = self.speed_fraction
            over = np.einsum("kij,...j->...ki", self._rows, self.twist)
            slip = share[..., None] * demanded - over
            slip2 = np.square(slip).sum(axis=-1)
            rim2 = np.square(share * self._rim_mps)
            pull = self._most_n / np.sqrt(slip2 + _SPIN_IN_SLIP**2 * rim2)
            force = pull[..., None] * slip
            drag = step_s * np.einsum("...k,kjl->...jl", pull, self._squares)
            pulled = step_s * np.einsum("...ki,kij->...j", force, self._rows)
            gained = np.asarray(
                np.linalg.solve(self._mass + 0.5 * drag, pulled[..., None]), dtype=float
            )
            self.speed_fraction = share + step_s * self._spin_up(
                share, demanded, force, slip2, rim2
            )
            self.twist = self.twist + gained[..., 0]
            # Coriolis term, because the axes of the body rotate.
            turned = step_s * self.twist[..., 2:]
            self.twist[..., :2] += turned * self.twist[..., 1::-1] * [1.0, -1.0]
        return self.twist

    def push(self, twist: Array, acceleration: Array, dt_s: float) -> tuple[Array, Array]:
        """Invert `advance`: return rolling and forces for `twist` (3,) over `dt_s`.

        Returns the rolling velocities (k, 2) of wheels at their setpoints, and the contact forces
        (k, 2). `acceleration` (3,) is over the ground, in the body frame. Demands beyond the
        friction limit give finite results, but are not reached.
        """
        forces = self._mass @ acceleration
        rim2 = np.square(self.speed_fraction * self._rim_mps)
        slip = np.zeros((len(self._rows), 2))
        pull = np.zeros(len(self._rows))
        for _ in range(_MAX_ITERATIONS):
            slip2 = np.square(slip).sum(axis=-1)
            pull = self._most_n / np.sqrt(slip2 + _SPIN_IN_SLIP**2 * rim2)
            grip = np.einsum("k,kjl->jl", pull, self._squares)
            slip = self._rows @ np.asarray(np.linalg.solve(grip, forces), dtype=float)
        force = pull[:, None] * slip
        rolled = (self._rows @ twist + slip) / self.speed_fraction[:, None]
        slip2 = np.square(slip).sum(axis=-1)
        rise_per_s = self._spin_up(self.speed_fraction, rolled, force, slip2, rim2)
        self.speed_fraction = self.speed_fraction + dt_s * rise_per_s
        return rolled, force

    def _spin_up(
        self, share: Array, demanded: Array, force: Array, slip2: Array, rim2: Array
    ) -> Array:
        """Return the wheel acceleration: motor torque minus the loads of push and spin friction."""
        time_constant_s = np.where(share < 1.0, self._up_s, self._down_s)
        pushing = (force * demanded).sum(axis=-1) / self._spin_rad_per_s
        drilling = self._most_n * self._lever_m * np.sqrt(rim2 / (rim2 + _SLIP_IN_SPIN**2 * slip2))
        return (1.0 - share) / time_constant_s - self._share_per_nms * (pushing + drilling)


def twist_from_wheels(robot: VirtualRobot, slip: Slip | None) -> Array:
    """Return the twist (3,) from the wheels after one period, including slip if modelled."""
    twist = robot.speed_scale_sigma * robot.controller.mean_twist
    return twist if slip is None else slip.advance(twist / slip.rest_share, PERIOD_S)


REMAINING_SPIN_SIGMA = 0.002
"""Standard deviation of the remaining speed error, mainly due to wheel layers."""
_RATE_RAD_PER_S = 2.5
_SWING_S = 2.5
_REST_S = 0.5


def measure_spin(robot: VirtualRobot, gyro: YawGyro, slip: Slip | None) -> tuple[float, float]:
    """Turn a robot back and forth; return relative wheel speed and additional lag, s, by its gyro.

    The rate is a sine, so gimbals pass through all tilts: servo steps and wheel layers average out,
    and constant offsets cancel between both directions.
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
    # Wheel measurements are delayed, but not the gyro.
    at_s: Array = PERIOD_S * np.arange(len(by_gyro), dtype=np.float64)
    seen = np.interp(at_s - robot.simulated.delay_s, at_s, by_gyro)
    expected = np.array(by_wheels)
    columns = np.column_stack([expected, -np.gradient(expected, PERIOD_S)])
    share, late = np.linalg.lstsq(columns, seen)[0].tolist()
    return share, late / share


_FRICTION_SHARE = 0.25
"""Standard deviation of the friction of an unmeasured floor."""


class PoseObserver:
    """Pose observer of a virtual robot that starts at its mark.

    The bus delay is known, and so is the slip model if given. Five biases are unknown: the common
    factor of the wheel speeds, the two components of the drift velocity due to gimbal zeros, the
    gyro bias, and the additional lag on the floor. A camera makes them observable.
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

        It defaults to the described value of the mean of all wheels at a known supply voltage.
        """
        self._gyro, self._camera, self.slip = gyro, camera, slip
        self._delay_s = robot.simulated.delay_s
        self._start_s = robot.now_s
        errors = robot.controller.robot.joint_errors()
        if spin_sigma is None:
            own = errors.speed_scale_sigma / math.sqrt(len(robot.controller.kinematics.actuators))
            spin_sigma = math.hypot(own, errors.motor_share)
        self._noise = JointNoise(robot.controller.kinematics, errors)
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
        """Return the pose after the latest measurement."""
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
            # The gyro measures rotation independently of wheel speed and slip.
            by_errors[2, [0, -1]] = 0.0
        # Errors other than biases are independent in each sample.
        self._filter.advance(now_s - self._delay_s, mean, by_errors, covariance * PERIOD_S)
        self._fuse_camera(robot, now_s)
        return self._filter.pose @ SE2.exp(mean * self._delay_s)

    def _twist_noise(self, robot: VirtualRobot) -> Array:
        """Return the covariance (3, 3) of the twist, without errors common to all wheels.

        The filter estimates the common errors.
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
    """Return the observer of a robot at its start pose, or None for an open loop.

    `slip` is for a plant with slipping wheels. With `turns`, a robot with a gyro first turns in
    place to measure its wheel speed and slip, and its mark is set afterwards.
    """
    if loop is Loop.OPEN:
        return None
    random = np.random.default_rng(seed)
    robot.speed_scale_sigma = voltage_share(robot) * (1.0 if slip is None else slip.rest_share)
    if loop is Loop.WHEELS:
        return PoseObserver(robot, slip=slip)
    # Its scale is assumed to be calibrated, because it would be taken for the wheels' speed.
    gyro, spin_sigma = YawGyro(Gyro(scale_share=0.0), random), None
    if turns:
        speed_fraction, later_s = measure_spin(robot, gyro, slip)
        robot.speed_scale_sigma *= speed_fraction
        slip = None if slip is None else slip.later(later_s)
        robot.mark()
        spin_sigma = REMAINING_SPIN_SIGMA
    camera = Camera(CameraNoise(), random) if loop is Loop.CAMERA else None
    return PoseObserver(robot, gyro, camera, slip, spin_sigma=spin_sigma)
