"""Robots on roller wheels, and a sphere on two-row wheels, with independent equations.

Written from the mechanics alone, without the project's simulation or kinematics. A roller grips
along its axle, with friction that grows with the creep and saturates, and rolls along the other
direction with a small resistance. Speed controllers have an integral part and a limited torque.
Implicit Euler steps; arrays have one row per robot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.independent.built import Undeclared, built, gyro_of, loads, slope_of

STEP_S = 0.0025
GRAVITY = 9.81
_RPM = 2.0 * np.pi / 60.0
CREEP_MPS = 0.01
"""Creep at which friction reaches half of its limit."""
_RESISTANCE = 0.003
"""Rolling resistance of a roller, relative to its load."""
_HEIGHT = 1.0
"""Height of the centre of mass, in wheel radii."""
_ITERATIONS = 3


def grip(limit_n: np.ndarray, creep: np.ndarray, saturates_mps: float = CREEP_MPS) -> np.ndarray:
    """Friction per creep, N per m/s: an arc tangent that approaches `limit_n`."""
    share = 0.5 * np.pi * np.abs(creep) / saturates_mps
    slope = np.where(share > 1e-6, np.arctan(share) / np.maximum(share, 1e-12), 1.0)
    return limit_n / saturates_mps * slope


class Wheels:
    """Speed-controlled wheels (n, k) with the torque curve of a DC motor."""

    def __init__(self, motor: Any, shape: tuple[int, int], inertia: float, driven: float) -> None:
        self.inertia = inertia
        self.gain = driven / motor.time_constant_s
        self.integral_per_s = 4.0
        self.top = motor.no_load_speed_rpm * _RPM / motor.gear_ratio
        self.stall = 4.0 * motor.power_w / self.top
        self.limit = self.stall * motor.current_limit
        self.speed = np.zeros(shape)
        self.goal = np.zeros(shape[1])
        self._sum = np.zeros(shape)

    def torque(self) -> tuple[np.ndarray, np.ndarray]:
        """Torque at speed zero, and its decrease per speed, over the coming step."""
        error = self.goal - self.speed
        wanted = self.gain * error + self._sum
        share = self.speed / self.top
        low = np.maximum(-self.stall * (1.0 + share), -self.limit)
        high = np.minimum(self.stall * (1.0 - share), self.limit)
        free = (wanted > low) & (wanted < high)
        self._sum = np.where(
            free, self._sum + self.integral_per_s * self.gain * error * STEP_S, self._sum
        )
        at_zero = np.where(free, self.gain * self.goal + self._sum, np.clip(wanted, low, high))
        return at_zero, np.where(free, self.gain, 0.0)


class RollerPlant:
    """`robots` platforms built from a description, driven by the same setpoints."""

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
        drive, mass = robot.drive, robot.mass
        random = np.random.default_rng([seed, 10])
        self.robots, self.count = robots, len(drive.wheels)
        shape = (robots, self.count)
        place_m, mount, slope_deg = built(robot.errors, errors, undeclared)
        self.places_m = np.array([[w.x_m, w.y_m] for w in drive.wheels]) + (
            place_m * random.standard_normal((*shape, 2))
        )
        heading = np.radians([w.direction_deg for w in drive.wheels])
        self.heading = heading + mount * random.standard_normal(shape)
        self.roller = np.radians([w.roller_deg for w in drive.wheels])
        self.roller = self.roller + mount * random.standard_normal(shape) * (self.roller != 0.0)
        self.radius_m = drive.wheel_radius_m * (
            1.0 + undeclared.radius_share * random.standard_normal(shape)
        )
        self.friction = drive.friction if undeclared.friction is None else undeclared.friction
        self.slope = slope_of(robots, seed, slope_deg)
        self.mass_kg, self.inertia = mass.total_kg, mass.yaw_inertia_kg_m2
        rotor = robot.motor.rotor_inertia_kg_m2 * robot.motor.gear_ratio**2
        wheel = 0.5 * mass.wheel_kg * drive.wheel_radius_m**2 + rotor
        share = mass.total_kg * drive.wheel_radius_m**2 / self.count
        self.wheels = Wheels(robot.motor, shape, wheel, wheel + share)
        self.seen_share = 1.0 + noise * robot.noise.speed_scale_sigma * random.standard_normal(
            shape
        )
        self.creeps_m = noise * robot.noise.creep_m
        self.gyro = gyro_of(getattr(robot, "gyro", None), robots, seed, undeclared)
        tracking = robot.dead_wheels
        self.tracking = None if tracking is None else Tracking(tracking, robots, seed, noise)
        self._random = random
        self.pose = np.zeros((robots, 3))
        self.velocity = np.zeros((robots, 2))
        self.rate = np.zeros(robots)
        self.crept_rad = np.zeros(robots)
        """Angle (n,) by which the random walk of contacts turned the robots in the last period."""
        self.period_s = STEP_S
        self.acceleration = np.zeros((robots, 2))
        self.friction_power = np.zeros(robots)

    def command(self, setpoint: np.ndarray) -> None:
        self.wheels.goal = np.array(setpoint)

    def advance(self, dt_s: float) -> None:
        self.crept_rad[:], self.period_s = 0.0, dt_s
        for _ in range(round(dt_s / STEP_S)):
            self._move()

    def measure(self) -> np.ndarray:
        joints = self.wheels.speed * self.seen_share
        # A gyro also measures random turning, as its mean over the period.
        rate = self.rate + self.crept_rad / self.period_s
        if self.tracking is not None:
            return np.column_stack([joints, self.tracking.read(rate)])
        if self.gyro is None:
            return joints
        return np.column_stack([joints, self.gyro.read(rate)])

    def _move(self) -> None:
        n, k = self.robots, self.count
        wheels, places = self.wheels, self.places_m
        ahead = self.pose[:, 2] + STEP_S * self.rate
        along = self.heading + self.roller + ahead[:, None]
        rows = np.zeros((n, k, 2, 3 + k))
        for axis, angle in enumerate((along, along + 0.5 * np.pi)):
            rows[..., axis, 0], rows[..., axis, 1] = np.cos(angle), np.sin(angle)
            body = angle - ahead[:, None]
            rows[..., axis, 2] = places[..., 0] * np.sin(body) - places[..., 1] * np.cos(body)
        # The rim moves backwards at the floor, and only its part along the roller axle creeps.
        rows[:, range(k), 0, range(3, 3 + k)] = -self.radius_m * np.cos(self.roller)
        own = np.zeros((n, k))
        if self.creeps_m > 0.0:
            turns = np.abs(wheels.speed).max(axis=-1, keepdims=True) > 1e-3
            noise = self._random.standard_normal((n, k))
            own = turns * self.creeps_m / np.sqrt(STEP_S) * noise
        mass = np.zeros((3 + k, 3 + k))
        mass[range(3 + k), range(3 + k)] = [
            self.mass_kg, self.mass_kg, self.inertia, *[wheels.inertia] * k,
        ]  # fmt: skip
        state = np.column_stack([self.velocity, self.rate, wheels.speed])
        at_zero, falls = wheels.torque()
        known = state @ mass / STEP_S
        known[:, :2] += self.mass_kg * self.slope
        known[:, 3:] += at_zero
        damped = np.broadcast_to(mass / STEP_S, (n, 3 + k, 3 + k)).copy()
        damped[:, range(3, 3 + k), range(3, 3 + k)] += falls
        c, s = np.cos(ahead), np.sin(ahead)
        tipping = (
            self.mass_kg
            * _HEIGHT
            * float(np.mean(self.radius_m))
            * np.stack(
                [
                    c * self.acceleration[:, 0] + s * self.acceleration[:, 1],
                    -s * self.acceleration[:, 0] + c * self.acceleration[:, 1],
                ],
                axis=-1,
            )
        )
        load = loads(places.mean(axis=0), self.mass_kg * GRAVITY, tipping)
        after = state
        for _ in range(_ITERATIONS):
            creep = np.einsum("nkaj,nj->nka", rows, after)
            viscous = np.stack(
                [
                    grip(self.friction * load, creep[..., 0]),
                    grip(_RESISTANCE * load, creep[..., 1]),
                ],
                axis=-1,
            )
            matrix = damped + np.einsum("nkai,nka,nkaj->nij", rows, viscous, rows)
            after = np.linalg.solve(matrix, known[..., None])[..., 0]
        creep = np.einsum("nkaj,nj->nka", rows, after)
        self.friction_power = -(viscous * creep**2).sum(axis=(1, 2))
        self.acceleration = (after[:, :2] - self.velocity) / STEP_S - self.slope
        moved = np.column_stack(
            [0.5 * (self.velocity + after[:, :2]), 0.5 * (self.rate + after[:, 2])]
        )
        if self.creeps_m > 0.0:
            # Each contact drifts at random, and the robot follows the least-squares mean.
            grips = rows[..., 0, :3]
            crept = np.einsum("nij,nj->ni", np.linalg.pinv(grips), own)
            self.crept_rad += STEP_S * crept[:, 2]
            moved += crept
        self.pose += STEP_S * moved
        if self.tracking is not None:
            body = moved.copy()
            body[:, 0] = c * moved[:, 0] + s * moved[:, 1]
            body[:, 1] = -s * moved[:, 0] + c * moved[:, 1]
            self.tracking.advance(body, STEP_S)
        self.velocity, self.rate, wheels.speed = after[:, :2], after[:, 2], after[:, 3:]

    @property
    def energy(self) -> np.ndarray:
        """Kinetic energy (n,), joules."""
        moving = 0.5 * self.mass_kg * (self.velocity**2).sum(axis=-1)
        spins = 0.5 * self.wheels.inertia * (self.wheels.speed**2).sum(axis=-1)
        return moving + 0.5 * self.inertia * self.rate**2 + spins


class Tracking:
    """Two passive wheels that count pulses, and a rate gyro."""

    def __init__(self, table: Any, robots: int, seed: int, noise: float) -> None:
        random = np.random.default_rng([seed, 13])
        mount = np.radians(noise * table.mounting_deg) * random.standard_normal((robots, 2))
        angle = np.radians([w.direction_deg for w in table.wheels]) + mount
        x, y = (np.array([getattr(w, key) for w in table.wheels]) for key in ("x_m", "y_m"))
        self._rows = np.stack(
            [np.cos(angle), np.sin(angle), x * np.sin(angle) - y * np.cos(angle)], axis=-1
        )
        radius = 1.0 + noise * table.radius_share * random.standard_normal((robots, 2))
        self._radius_m = table.radius_m * radius
        self._pulse = 2.0 * np.pi / table.pulses_per_turn
        self._angles = random.uniform(0.0, self._pulse, (robots, 2))
        drift = noise * np.radians(table.gyro_drift_deg_per_h) / 3600.0
        self._drift = drift * random.standard_normal(robots)

    def advance(self, body: np.ndarray, dt_s: float) -> None:
        ways = (self._rows * body[:, None, :]).sum(axis=-1)
        self._angles += dt_s * ways / self._radius_m

    def read(self, rate: np.ndarray) -> np.ndarray:
        pulses = np.floor(self._angles / self._pulse) * self._pulse
        return np.column_stack([pulses, rate + self._drift])


class SpherePlant:
    """`robots` spheres on wheels with two alternating rows of rollers.

    Weiss, Langlois and Hayes 2008: mounting by Eq. 21 and 23, rows by Eq. 8 to 12.
    """

    def __init__(
        self,
        robot: Any,
        robots: int,
        seed: int,
        *,
        errors: float = 1.0,  # noqa: ARG002  Common signature.
        noise: float = 1.0,
        undeclared: Undeclared | None = None,
    ) -> None:
        undeclared = undeclared or Undeclared()
        drive, mass = robot.drive, robot.mass
        random = np.random.default_rng([seed, 10])
        self.robots, self.count = robots, len(drive.wheels)
        shape = (robots, self.count)
        mount = np.radians(undeclared.mount_deg) * random.standard_normal(shape)
        azimuth = np.radians([w.azimuth_deg for w in drive.wheels]) + mount
        below = np.radians([w.below_equator_deg for w in drive.wheels])
        turn = np.radians([w.turn_deg for w in drive.wheels])
        cb, sb = np.cos(below), np.sin(below)
        ca, sa = np.cos(azimuth), np.sin(azimuth)
        self.contact = np.stack([cb * ca, cb * sa, -sb + 0.0 * ca], axis=-1)
        along = np.stack([-sa, ca, 0.0 * ca], axis=-1)
        across = np.cross(self.contact, along)
        turn = turn[:, None]
        self.drives = np.cos(turn) * along + np.sin(turn) * across
        self.axle = np.cross(self.contact, self.drives)
        self.off = np.arcsin(
            drive.row_distance_m / (2.0 * (drive.sphere_radius_m + drive.roller_radius_m))
        )
        self.row = 2.0 * np.pi / drive.rollers
        self.sphere_m = drive.sphere_radius_m
        self.radius_m = drive.wheel_radius_m * (
            1.0 + undeclared.radius_share * random.standard_normal(shape)
        )
        self.inertia = 0.4 * mass.sphere_kg * drive.sphere_radius_m**2
        rotor = robot.motor.rotor_inertia_kg_m2 * robot.motor.gear_ratio**2
        wheel = 0.5 * mass.wheel_kg * drive.wheel_radius_m**2 + rotor
        carried = self.inertia * (drive.wheel_radius_m / drive.sphere_radius_m) ** 2
        self.wheels = Wheels(robot.motor, shape, wheel, wheel + carried)
        self.limit_n = 0.6 * mass.sphere_kg * GRAVITY / (self.count * np.mean(sb))
        self.seen_share = 1.0 + noise * robot.noise.speed_scale_sigma * random.standard_normal(
            shape
        )
        self.creeps_m = noise * robot.noise.creep_m
        self._random = random
        self.angles = np.zeros(shape)
        self.turn = np.broadcast_to(np.eye(3), (robots, 3, 3)).copy()
        """(n, 3, 3): orientation of the spheres."""
        self.rate = np.zeros((robots, 3))

    def command(self, setpoint: np.ndarray) -> None:
        self.wheels.goal = np.array(setpoint)

    def measure(self) -> np.ndarray:
        return self.wheels.speed * self.seen_share

    def advance(self, dt_s: float) -> None:
        for _ in range(round(dt_s / STEP_S)):
            self._move()

    def _move(self) -> None:
        n, k = self.robots, self.count
        wheels = self.wheels
        # The first row is towards the axle, the second away from it.
        first = np.mod(np.floor(self.angles / self.row), 2.0) == 0.0
        side = np.where(first, 1.0, -1.0)[..., None]
        at = np.cos(self.off) * self.contact + side * np.sin(self.off) * self.axle
        rows = np.zeros((n, k, 3 + k))
        rows[..., :3] = self.sphere_m * np.cross(at, self.drives)
        rows[:, range(k), range(3, 3 + k)] = -self.radius_m
        mass = np.concatenate([np.full(3, self.inertia), np.full(k, wheels.inertia)])
        state = np.column_stack([self.rate, wheels.speed])
        at_zero, falls = wheels.torque()
        known = state * mass / STEP_S
        known[:, 3:] += at_zero
        damped = np.broadcast_to(np.diag(mass) / STEP_S, (n, 3 + k, 3 + k)).copy()
        damped[:, range(3, 3 + k), range(3, 3 + k)] += falls
        after = state
        for _ in range(_ITERATIONS):
            creep = np.einsum("nkj,nj->nk", rows, after)
            # Stiff contacts, for a sphere described as rolling without creep.
            viscous = grip(np.full((n, k), self.limit_n), creep, 0.1 * CREEP_MPS)
            matrix = damped + np.einsum("nki,nk,nkj->nij", rows, viscous, rows)
            after = np.linalg.solve(matrix, known[..., None])[..., 0]
        rate = 0.5 * (self.rate + after[:, :3])
        if self.creeps_m > 0.0:
            turns = np.abs(wheels.speed).max(axis=-1, keepdims=True) > 1e-3
            own = turns * self.creeps_m / np.sqrt(STEP_S) * self._random.standard_normal((n, k))
            rate = rate + np.einsum("nij,nj->ni", np.linalg.pinv(rows[..., :3]), own)
        self.turn = turned_by(STEP_S * rate) @ self.turn
        self.angles += 0.5 * STEP_S * (wheels.speed + after[:, 3:])
        self.rate, wheels.speed = after[:, :3], after[:, 3:]


def turned_by(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), by Rodrigues' formula."""
    angle = np.sqrt((vectors**2).sum(axis=-1))[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = z, -y, x
    sine, bend = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + sine * cross + bend * (cross @ cross)


def turned(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) of rotation matrices, for less than half a turn."""
    m = matrices
    axis = 0.5 * np.stack(
        [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=-1
    )
    sine = np.sqrt((axis**2).sum(axis=-1))
    angle = np.arctan2(sine, 0.5 * (np.trace(m, axis1=1, axis2=2) - 1.0))
    return axis * (angle / np.maximum(sine, 1e-12))[:, None]
