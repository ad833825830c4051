"""Robots on spinning wheels in gimbals: rigid bodies with their own equations of motion.

Written from the mechanics alone, without the project's simulation or kinematics: a body that slides
on k spinning spheres, gimbals that yield to the floor and play, dead bands, encoder steps, motors
with their time constants, and a bus with a delay. Implicit Euler steps; arrays have one row per
robot.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from tests.independent.built import Undeclared, built, gyro_of, loads, slope_of
from tests.independent.patch import weights

STEP_S = 0.0025
GRAVITY = 9.81
_RPM = 2.0 * np.pi / 60.0
_HEIGHT_M = 0.01
"""Height of the centre of mass above the gimbals."""
_ITERATIONS = 2


class SingularityPlant:
    """`robots` machines built from a description, driven by the same setpoints."""

    def __init__(
        self,
        robot: Any,
        robots: int,
        seed: int,
        *,
        errors: float = 1.0,
        noise: float = 1.0,
        undeclared: Undeclared | None = None,
    ) -> None:
        undeclared = undeclared or Undeclared()
        drive, made = robot.drive, robot.errors
        random = np.random.default_rng([seed, 10])
        self.robots, self.modules = robots, drive.modules
        shape = (robots, self.modules)
        azimuth = np.radians(drive.directions_deg)
        place_m, mount_rad, slope_deg = built(made, errors, undeclared)
        self.places_m = np.asarray(drive.pivots_m) + place_m * random.standard_normal((*shape, 2))
        mount = mount_rad * random.standard_normal(shape)
        turned = azimuth - 0.5 * np.pi + mount
        self.tangent = np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        self.outward = np.stack([-np.sin(turned), np.cos(turned)], axis=-1)
        self.radius_m = drive.wheel_radius_m * (
            1.0 + undeclared.radius_share * random.standard_normal(shape)
        )
        self.layer_m = errors * made.layer_m
        self.phase = random.uniform(0.0, 2.0 * np.pi, shape)
        self.edges = undeclared.edges
        # Floor.
        self.friction = robot.floor.friction if undeclared.friction is None else undeclared.friction
        self.patch_m = undeclared.patch_m or robot.floor.patch_radius_m
        self.slope = slope_of(robots, seed, slope_deg)
        # Bodies.
        mass = robot.mass
        self.mass_kg = mass.total_kg
        reach = float(np.sqrt((np.asarray(drive.pivots_m) ** 2).sum(axis=-1).mean()))
        module_kg = mass.wheel_kg + 2.0 * mass.gimbal_kg
        body_kg = mass.total_kg - self.modules * module_kg
        self.inertia = 0.5 * body_kg * reach**2 + self.modules * module_kg * reach**2
        self.spin_inertia = mass.wheel_kg * drive.wheel_radius_m**2 * 2.0 / 3.0
        # Actuators.
        servo, motor = robot.servo, robot.motor
        self.step_rad = 2.0 * np.pi / servo.steps_per_turn
        volts = 1.0 + errors * made.battery_share * random.standard_normal((robots, 1))
        self.top_rate = servo.no_load_speed_rpm * _RPM * volts[..., None]
        self.gain = servo.approach_rate_per_s / (servo.no_load_speed_rpm * _RPM)
        self.stall = servo.stall_torque_nm * volts[..., None]
        self.sticks = self.gain * np.radians(errors * made.dead_band_deg)
        self.play = np.radians(errors * made.backlash_deg)
        self.tilt_limit = np.floor(np.radians(drive.max_tilt_deg) / self.step_rad) * self.step_rad
        self.zero = np.radians(errors * made.zero_deg) * random.standard_normal((*shape, 2))
        self.angle_noise = np.radians(noise * robot.noise.gimbal_angle_deg)
        own = noise * robot.noise.speed_scale_sigma * random.standard_normal(shape)
        curve = errors * made.motor_share * random.standard_normal((robots, 1))
        self.spin_share = volts * (1.0 + own) * (1.0 + curve) * (1.0 + undeclared.spin_share)
        self.curves = np.array(motor.speed_rpm) * _RPM
        self.signals = np.array(motor.signal, dtype=float)
        self.starts = motor.start_speed_rpm * _RPM * (1.0 - 1e-9)
        self.up_s, self.down_s = motor.time_constant_up_s, motor.time_constant_down_s
        self.delay = round(errors * made.delay_s / STEP_S)
        self.gyro = gyro_of(robot.gyro, robots, seed, undeclared)
        self._random = random
        # State.
        self.pose = np.zeros((robots, 3))
        self.velocity = np.zeros((robots, 2))
        """Velocity over the floor, in the world frame."""
        self.rate = np.zeros(robots)
        self.angles = self.zero.copy()
        """(n, k, 2): alpha, beta."""
        self.rates = np.zeros((*shape, 2))
        self.lead = np.zeros((*shape, 2))
        self.spin = np.zeros(shape)
        self.goal = self.zero.copy()
        self.spin_goal = np.zeros(shape)
        self.force = np.zeros((*shape, 2))
        """Force of the floor on each wheel, in module axes."""
        self.twisting = np.zeros(shape)
        self.acceleration = np.zeros((robots, 2))
        self.friction_power = np.zeros(robots)
        self._queue: deque[tuple[int, np.ndarray]] = deque()
        self._past: deque[np.ndarray] = deque([self.angles.copy()] * (self.delay + 1))
        self._steps = 0

    def command(self, setpoint: np.ndarray) -> None:
        """Give the same setpoints (3 k,) to all robots; they take effect after the delay."""
        self._queue.append((self._steps + self.delay, np.array(setpoint)))

    def _obey(self, setpoint: np.ndarray) -> None:
        wanted = setpoint.reshape(self.modules, 3)
        steps = np.rint(wanted[:, :2] / self.step_rad) * self.step_rad
        self.goal = self.zero + np.clip(steps, -self.tilt_limit, self.tilt_limit)
        speeds = np.zeros(self.modules)
        for i, curve in enumerate(self.curves):
            if wanted[i, 2] > 0.0:
                signal = np.interp(wanted[i, 2], curve, self.signals)
                speed = np.interp(signal, self.signals, curve)
                speeds[i] = speed if speed >= self.starts else 0.0
        self.spin_goal = speeds * self.spin_share

    def advance(self, dt_s: float) -> None:
        for _ in range(round(dt_s / STEP_S)):
            while self._queue and self._queue[0][0] <= self._steps:
                self._obey(self._queue.popleft()[1])
            self.turn_gimbals()
            self._move()
            self._steps += 1
            self._past.append(self.angles.copy())
            self._past.popleft()

    def measure(self) -> np.ndarray:
        """Joints (n, 3 k) as read over the bus, with NaN for the wheels, then the gyro."""
        seen = self._past[0] - self.zero
        seen = seen + self.angle_noise * self._random.standard_normal(seen.shape)
        joints = np.full((self.robots, self.modules, 3), np.nan)
        joints[..., :2] = np.rint(seen / self.step_rad) * self.step_rad
        joints = joints.reshape(self.robots, -1)
        if self.gyro is None:
            return joints
        return np.column_stack([joints, self.gyro.read(self.rate)])

    def slip_horn(self, robot: int, module: int, axis: int, angle_rad: float) -> None:
        """Turn a gimbal against its servo, whose encoder does not notice."""
        for angles in (self.zero, self.angles, self.goal, *self._past):
            angles[robot, module, axis] += angle_rad

    # Mechanics.

    def axles(self) -> np.ndarray:
        """Unit vectors (n, k, 3) along the axles, in the axes of the modules: tangent, outward, up.

        The outer gimbal turns about the outward axis by beta, the inner one about minus the turned
        tangent by alpha.
        """
        a, b = self.angles[..., 0], self.angles[..., 1]
        return np.stack([np.cos(a) * np.sin(b), np.sin(a), np.cos(a) * np.cos(b)], axis=-1)

    def turn_gimbals(self) -> None:
        """Turn the gimbals for one step under the forces of the floor."""
        b = self.angles[..., 1]
        axle, radius = self.axles(), self.radius_m
        # Torques of the floor, and of turning the spinning wheel, about the axes of the gimbals.
        load = np.empty_like(self.angles)
        load[..., 1] = -radius * self.force[..., 0]
        load[..., 0] = -radius * self.force[..., 1] * np.cos(b) + np.sin(b) * self.twisting
        inner = np.stack([-np.cos(b), np.zeros_like(b), np.sin(b)], axis=-1)
        turning = self.rates[..., :1] * inner
        turning[..., 1] += self.rates[..., 1]
        turning[..., 2] += self.rate[:, None]
        gyration = self.spin_inertia * self.spin[..., None] * np.cross(turning, axle)
        load[..., 1] -= gyration[..., 1]
        load[..., 0] -= (gyration * inner).sum(axis=-1)
        voltage = np.clip(self.gain * (self.goal - self.angles), -1.0, 1.0)
        push = voltage + load / self.stall
        free = np.sign(push) * np.maximum(np.abs(push) - self.sticks, 0.0)
        # Implicit: the rate at the end of the step, with the error that is then left.
        rate = self.top_rate * free
        linear = np.abs(voltage) < 1.0
        rate = np.where(linear, rate / (1.0 + self.top_rate * self.gain * STEP_S), rate)
        if self.play > 0.0:
            lead = self.lead + rate * STEP_S
            edge = 0.5 * self.play
            moved = lead - np.clip(lead, -edge, edge)
            self.lead = lead - moved
        else:
            moved = rate * STEP_S
        self.rates = moved / STEP_S
        self.angles = self.angles + moved

    def _rolling(self, axle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lever (n, k, 2) by which a spin moves the contact, and its velocity from the gimbals."""
        b = self.angles[..., 1]
        radius = self.radius_m
        level, up = axle[..., :2], axle[..., 2]
        if self.edges and self.layer_m > 0.0:
            # On printed layers, a wheel rests on a layer edge, which determines the lever.
            tilt = np.arccos(np.clip(up, -1.0, 1.0))
            height = radius * (1.0 - np.cos(tilt)) / self.layer_m + self.phase / (2.0 * np.pi)
            edge = np.maximum(np.rint(height) - self.phase / (2.0 * np.pi), 0.0)
            on = np.arccos(np.clip(1.0 - edge * self.layer_m / radius, -1.0, 1.0))
            factor = np.sin(on) / np.maximum(np.sin(tilt), 1e-6)
            # A floor that yields by a tenth of a layer smooths the steps.
            level = level * (0.9 + 0.1 * factor)[..., None]
        elif self.layer_m > 0.0:
            layers = radius * (1.0 - up) / self.layer_m
            radius = radius + 0.5 * self.layer_m * np.sin(2.0 * np.pi * layers + self.phase)
        # Velocity of the lowest point of a sphere that turns by Omega: -r Omega x z.
        lever = -radius[..., None] * np.stack([level[..., 1], -level[..., 0]], axis=-1)
        inner = np.stack([-np.cos(b), np.zeros_like(b)], axis=-1)
        turning = self.rates[..., :1] * inner
        turning[..., 1] += self.rates[..., 1]
        pushed = -radius[..., None] * np.stack([turning[..., 1], -turning[..., 0]], axis=-1)
        return lever, pushed

    def _move(self) -> None:
        n, k = self.robots, self.modules
        axle = self.axles()
        lever, pushed = self._rolling(axle)
        ahead = self.pose[:, 2] + STEP_S * self.rate
        c, s = np.cos(ahead), np.sin(ahead)
        places, up = self.places_m, axle[..., 2]
        # Slip of a contact in the axes of its module, as rows of the state (vx, vy, omega, spins).
        rows = np.zeros((n, k, 2, 3 + k))
        for axis, unit in enumerate((self.tangent, self.outward)):
            rows[..., axis, 0] = c[:, None] * unit[..., 0] - s[:, None] * unit[..., 1]
            rows[..., axis, 1] = s[:, None] * unit[..., 0] + c[:, None] * unit[..., 1]
            rows[..., axis, 2] = places[..., 0] * unit[..., 1] - places[..., 1] * unit[..., 0]
            rows[:, range(k), axis, range(3, 3 + k)] = lever[..., axis]
        mass = np.zeros((n, 3 + k, 3 + k))
        mass[:, 0, 0] = mass[:, 1, 1] = self.mass_kg
        mass[:, 2, 2] = self.inertia
        for i in range(k):
            mass[:, 3 + i, 3 + i] = self.spin_inertia
            mass[:, 2, 3 + i] = mass[:, 3 + i, 2] = self.spin_inertia * up[:, i]
        state = np.column_stack([self.velocity, self.rate, self.spin])
        push = np.zeros_like(state)
        push[:, :2] = self.mass_kg * self.slope
        constant_s = np.where(self.spin_goal > self.spin, self.up_s, self.down_s)
        stiff = self.spin_inertia / constant_s
        push[:, 3:] += stiff * self.spin_goal
        damped = mass / STEP_S
        damped[:, range(3, 3 + k), range(3, 3 + k)] += stiff
        known = np.einsum("nij,nj->ni", mass, state) / STEP_S + push
        tipping = (
            self.mass_kg
            * (float(np.mean(self.radius_m)) + _HEIGHT_M)
            * np.stack(
                [
                    c * self.acceleration[:, 0] + s * self.acceleration[:, 1],
                    -s * self.acceleration[:, 0] + c * self.acceleration[:, 1],
                ],
                axis=-1,
            )
        )
        load = loads(places.mean(axis=0), self.mass_kg * GRAVITY, tipping)
        limit = self.friction * load
        after = state
        for _ in range(_ITERATIONS):
            slip = np.einsum("nkaj,nj->nka", rows, after) + pushed
            turning = after[:, 3:] * up + after[:, 2:3]
            viscous, offset, twisting = weights(limit, self.patch_m, slip, turning)
            matrix = damped + np.einsum("nkai,nk,nkaj->nij", rows, viscous, rows)
            right = known - np.einsum("nkaj,nka->nj", rows, viscous[..., None] * pushed + offset)
            # The moment about the normal turns the robot, and its part along the axle the wheel.
            right[:, 2] += twisting.sum(axis=-1)
            right[:, 3:] += up * twisting
            after = np.linalg.solve(matrix, right[..., None])[..., 0]
        slip = np.einsum("nkaj,nj->nka", rows, after) + pushed
        self.force = -viscous[..., None] * slip - offset
        self.twisting = twisting
        self.friction_power = (self.force * slip).sum(axis=(1, 2)) + (twisting * turning).sum(-1)
        self.acceleration = (after[:, :2] - self.velocity) / STEP_S - self.slope
        self.pose[:, :2] += 0.5 * STEP_S * (self.velocity + after[:, :2])
        self.pose[:, 2] += 0.5 * STEP_S * (self.rate + after[:, 2])
        self.velocity, self.rate, self.spin = after[:, :2], after[:, 2], after[:, 3:]

    @property
    def energy(self) -> np.ndarray:
        """Kinetic energy (n,), joules."""
        up = self.axles()[..., 2]
        turning = 0.5 * self.inertia * self.rate**2
        moving = 0.5 * self.mass_kg * (self.velocity**2).sum(axis=-1)
        spins = 0.5 * self.spin_inertia * (self.spin**2).sum(axis=-1)
        cross = self.spin_inertia * (self.spin * up).sum(axis=-1) * self.rate
        return moving + turning + spins + cross
