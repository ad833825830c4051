"""Simulation of robots on geared motors: omni and Mecanum platforms with slip, and spheres."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Unpack

import numpy as np

from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import OmniDescription, SphereDescription
from tsd_twin.robots.description import BuildErrors
from tsd_twin.robots.omni import ROLLER_CREEP_MPS, GearedMotorDescription
from tsd_twin.sensors.base import BodyMotion
from tsd_twin.sensors.dead_wheels import DeadWheelSensors
from tsd_twin.simulation.actuators import SimulationOptions


class GearedSimulation(ABC):
    """Base class of simulations with speed-controlled wheels; subclasses model the body.

    `noise` scales the described standard deviations: each wheel's measured speed has a relative
    error that is constant per run. Time advances in steps of at most `longest_step_s`.
    """

    longest_step_s: float

    def __init__(
        self,
        robot: GearedMotorDescription,
        shape: tuple[int, ...],
        inertia_kg_m2: float,
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
    ) -> None:
        """Create wheels of `shape` (..., k), each driving an inertia."""
        self.battery_v = robot.battery.nominal_v if battery_v is None else battery_v
        self.joints: Array = np.zeros(shape)
        """(..., k): true wheel speeds."""
        self._setpoint = np.zeros(shape)
        self._goals = np.zeros(shape)
        self._shares = np.ones(shape)
        self._robot = robot
        self._gain_nm_s = inertia_kg_m2 / robot.motor.time_constant_s
        """Gain of the speed control: torque per rad/s of speed error."""
        self.set_battery(self.battery_v)
        self._random = np.random.default_rng(seed)
        self._scale = 1.0 + noise * robot.noise.speed_scale_sigma * self._random.standard_normal(
            shape
        )

    def command(self, setpoint: Array) -> None:
        """Set the speed setpoints (..., k) of all motors, rad/s.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        self._setpoint[...] = setpoint
        self._goals = self._setpoint * self._shares

    def degrade(self, shares: Array) -> None:
        """Slow down wheels: `shares` (..., k) are factors on the setpoints."""
        self._shares[...] = shares
        self._goals = self._setpoint * self._shares

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.battery_v = battery_v
        share = battery_v / self._robot.battery.nominal_v
        self._stall_nm = self._robot.motor.stall_torque_nm * share
        self._top_speed_rad_per_s = self._robot.motor.top_speed_rad_per_s * share

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        if self._rests():
            return
        steps = int(np.ceil(dt_s / self.longest_step_s - 1e-9))
        for _ in range(steps):
            self._step(dt_s / steps)

    def measure(self) -> Array:
        """Return wheel speeds (..., k)."""
        return self.joints * self._scale

    def _torque_bounds(self) -> tuple[Array, Array]:
        """Return the minimum and maximum torque at the current wheel speeds.

        The available torque decreases linearly from stall to no-load speed; the driver can reverse
        the voltage and has a current limit.
        """
        motor = self._robot.motor
        share = self.joints / self._top_speed_rad_per_s
        limit = motor.stall_torque_nm * motor.current_limit
        low = np.maximum(-self._stall_nm * (1.0 + share), -limit)
        high = np.minimum(self._stall_nm * (1.0 - share), limit)
        return low, high

    def _rests(self) -> bool:
        return not (self.joints.any() or self._goals.any())

    @abstractmethod
    def _step(self, dt_s: float) -> None:
        """Advance wheels and body by `dt_s` seconds."""


_MAX_ITERATIONS = 30
_TOLERANCE_MPS = 0.2 * ROLLER_CREEP_MPS
"""Tolerance of the creep iteration."""
_SETTLED = 1e-9
"""Speed (m/s or rad/s) below which the robot is at rest."""


class OmniSimulation(GearedSimulation):
    """`batch` robots in lockstep virtual time; `()` is a single robot.

    A rigid body on equally loaded wheels. The friction of a roller acts along its axle, grows with
    the creep, and saturates. A saturated wheel slips, which its encoder cannot measure.
    """

    longest_step_s = 0.0025
    """Slipping wheels accelerate within a few milliseconds."""

    def __init__(
        self,
        robot: OmniDescription,
        batch: tuple[int, ...] = (),
        *,
        pose: SE2 | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        self.kinematics = kinematics = robot.kinematics()
        shape, inertia = (*batch, kinematics.wheels), robot.driven_inertia_kg_m2(kinematics)
        super().__init__(robot, shape, inertia, **options)
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self._twist = np.zeros((*batch, 3))
        self._slope_mps2 = robot.errors.slope_mps2
        self._build(robot.errors, batch, options.get("seed", 0))
        self._pull_m = (1.0 - robot.drive.slip) * self._arm_m
        self._body = robot.inertia
        self._body_matrix = np.diag(self._body)
        self._wheel = robot.wheel_inertia_kg_m2
        self._friction_n = robot.contact_friction_n
        self._sensors = None
        if robot.dead_wheels is not None:
            noise = options.get("noise", 0.0)
            self._sensors = DeadWheelSensors(robot.dead_wheels, batch, self._random, noise)

    def _build(self, errors: BuildErrors, batch: tuple[int, ...], seed: int | None) -> None:
        """Mount the wheels with their errors, on floors that slope in random directions."""
        kinematics = self.kinematics
        self._grip: Array = kinematics.grip_from_twist
        """(..., k, 3): ground velocity along the axles of the rollers per twist."""
        rollers = kinematics.rollers_rad
        # A separate generator keeps other errors of a robot the same with any layout.
        random = np.random.default_rng(None if seed is None else [seed, 5])
        shape = (*batch, kinematics.wheels)
        mount_rad = math.radians(errors.mount_deg)
        turned = mount_rad * random.standard_normal(shape)
        rolled = mount_rad * random.standard_normal(shape) * (rollers != 0.0)
        displaced = errors.place_m * random.standard_normal((*shape, 2))
        self._downhill_rad: Array = random.uniform(0.0, 2.0 * np.pi, batch)
        if turned.any() or displaced.any():
            rollers = rollers + rolled
            angles = kinematics.directions_rad + turned + rollers
            x, y = np.moveaxis(kinematics.positions_m + displaced, -1, 0)
            c, s = np.cos(angles), np.sin(angles)
            self._grip = np.stack([c, s, s * x - c * y], axis=-1)
        # Component of a wheel's speed along the roller's axle.
        self._arm_m: Array = kinematics.wheel_radius_m * np.cos(rollers)

    def _along(self, twist: Array) -> Array:
        """Return the ground velocities (..., k) along the axles of the rollers."""
        if self._grip.ndim == 2:
            return twist @ self._grip.T
        return np.asarray((self._grip @ twist[..., None])[..., 0], dtype=float)

    def measure(self) -> Array:
        """Return wheel speeds, then tracking wheels and gyro, (..., k + s)."""
        speeds = super().measure()
        if self._sensors is None:
            return speeds
        self._sensors.advance(BodyMotion(self.pose, self._twist), 0.0)
        return np.concatenate([speeds, self._sensors.read()], axis=-1)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        return self._twist.copy()

    def slipping(self) -> Array:
        """Return the speed (..., k) of each rim relative to the floor, m/s."""
        return self._arm_m * self.joints - self._along(self._twist)

    def hardware_status(self) -> dict[str, object]:
        """Return battery voltage and wheel slip."""
        return {
            "battery_v": self.battery_v,
            "slip_mps": np.round(self.slipping(), 4).tolist(),
        }

    def _rests(self) -> bool:
        return super()._rests() and not (self._twist.any() or self._slope_mps2)

    def _step(self, dt_s: float) -> None:
        joints, twist = self._after(dt_s)
        middle = 0.5 * (self._twist + twist)
        self.pose = self.pose @ SE2.exp(dt_s * middle)
        if self._sensors is not None:
            self._sensors.advance(BodyMotion(self.pose, middle), dt_s)
        # The axes have turned with the body, but the velocity in the world has not.
        angle = -dt_s * middle[..., 2]
        cos, sin = np.cos(angle), np.sin(angle)
        vx, vy = twist[..., 0].copy(), twist[..., 1].copy()
        twist[..., 0], twist[..., 1] = cos * vx - sin * vy, sin * vx + cos * vy
        if not (self._goals.any() or self._slope_mps2) and np.abs(twist).max() < _SETTLED:
            twist[...], joints[...] = 0.0, 0.0
        self.joints, self._twist = joints, twist

    def _after(self, dt_s: float) -> tuple[Array, Array]:
        """Return wheel speeds and twist by the implicit Euler equations of wheels and body.

        Friction is c s with the creep s, where c decreases with the creep: iterated to a fixed
        point.
        """
        low, high = self._torque_bounds()
        wanted = self._gain_nm_s * (self._goals - self.joints)
        free = (wanted > low) & (wanted < high)
        gain: Array = np.where(free, self._gain_nm_s, 0.0)
        torque = np.where(free, gain * self._goals, np.minimum(np.maximum(wanted, low), high))
        joints, twist = self.joints, self._twist
        creep = self._creep(joints, twist)
        active = np.ones((*twist.shape[:-1], 1), dtype=bool)
        for _ in range(_MAX_ITERATIONS):
            c = self._friction_n / np.sqrt(creep * creep + ROLLER_CREEP_MPS**2)
            solved = self._linear(c, gain, torque, dt_s)
            if active.all():
                joints, twist = solved
            else:  # Keep converged robots unchanged, so that a batch equals its members.
                joints = np.where(active, solved[0], joints)
                twist = np.where(active, solved[1], twist)
            before, creep = creep, self._creep(joints, twist)
            change = np.maximum.reduce(np.abs(creep - before), axis=-1, keepdims=True)
            active = active & (change >= _TOLERANCE_MPS)
            if not active.any():
                break
        return joints, twist

    def _linear(self, c: Array, gain: Array, torque: Array, dt_s: float) -> tuple[Array, Array]:
        """Return wheel speeds and twist for friction c s and torque minus gain times speed.

        Each wheel's equation yields its speed from the twist, which leaves three for the body.
        """
        grip, heavy = self._grip, self._wheel / dt_s
        pulled = c * self._arm_m
        total = heavy + gain + pulled * self._pull_m
        alone = (heavy * self.joints + torque) / total
        along = pulled / total
        weight = c * (1.0 - self._pull_m * along)
        matrix = (
            self._body_matrix / dt_s + (np.swapaxes(grip, -1, -2) * weight[..., None, :]) @ grip
        )
        pulls = c * self._pull_m * alone
        pulled = pulls @ grip if grip.ndim == 2 else (pulls[..., None, :] @ grip)[..., 0, :]
        push = self._twist * (self._body / dt_s) + pulled
        if self._slope_mps2:
            angle = self._downhill_rad - self.pose.xy_heading[..., 2]
            weight_n = self._body[0] * self._slope_mps2
            push[..., 0] += weight_n * np.cos(angle)
            push[..., 1] += weight_n * np.sin(angle)
        twist = np.asarray(np.linalg.solve(matrix, push[..., None])[..., 0], dtype=float)
        return alone + along * self._along(twist), twist

    def _creep(self, joints: Array, twist: Array) -> Array:
        return self._pull_m * joints - self._along(twist)


class SphereSimulation(GearedSimulation):
    """`batch` platforms in lockstep virtual time; `()` is a single platform.

    There is no slip. The sphere always follows the rows of rollers in contact, independently of the
    estimator's model. Initially each wheel is at the beginning of its first row.
    """

    longest_step_s = 0.005
    """Wheels accelerate within tens of milliseconds."""

    def __init__(
        self,
        robot: SphereDescription,
        batch: tuple[int, ...] = (),
        *,
        pose: SO3 | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        self.kinematics = kinematics = robot.kinematics()
        self._inertia = robot.driven_inertia_kg_m2(kinematics)
        shape = (*batch, kinematics.wheels)
        super().__init__(robot, shape, self._inertia, **options)
        self.pose = SO3.identity(batch) if pose is None else SO3.identity(batch) @ pose
        """True orientation of the sphere in the world."""
        self.angles_rad: Array = np.zeros_like(self.joints)
        """(..., k): angle of each wheel."""
        self._time_constant_s = robot.motor.time_constant_s

    def twist(self) -> Array:
        """Return the true angular velocity (..., 3) in the base frame, on the current rows."""
        return self.kinematics.true_twist(self.joints, self.kinematics.side(self.angles_rad))

    def hardware_status(self) -> dict[str, object]:
        """Return battery voltage and the supporting row of each wheel: 1 or 2."""
        rows = 1.5 + 0.5 * self.kinematics.side(self.angles_rad)
        return {"battery_v": self.battery_v, "rows": rows.astype(int).tolist()}

    def _step(self, dt_s: float) -> None:
        low, high = self._torque_bounds()
        gained = (self._goals - self.joints) * -np.expm1(-dt_s / self._time_constant_s)
        least, most = low * (dt_s / self._inertia), high * (dt_s / self._inertia)
        gained = np.minimum(np.maximum(gained, least), most)
        joints = self.joints + gained
        joints[np.abs(joints) + np.abs(self._goals) < 1e-9] = 0.0
        middle = 0.5 * (self.joints + joints)
        angles = self.angles_rad + dt_s * middle
        side = self.kinematics.mean_side(self.angles_rad, angles)
        twist = self.kinematics.true_twist(middle, side)
        self.pose = self.kinematics.integrate(self.pose, twist, dt_s)
        self.joints, self.angles_rad = joints, angles
