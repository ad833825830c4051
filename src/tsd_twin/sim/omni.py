"""Platforms on wheels with rollers in virtual time: motors, grip, and what slips when it ends."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.robots import OmniRobot
from tsd_twin.sim.dead_wheels import DeadWheelSensors
from tsd_twin.sim.geared import GearedSimulation

_CREEP_MPS = 0.01
"""A roller pulls with its full friction when its rim is some times faster than the floor."""
_GRAVITY_MPS2 = 9.81
_ROUNDS = 30
_CLOSE_MPS = 0.2 * _CREEP_MPS
"""Creep that is known to this is known well enough."""
_SETTLED = 1e-9
"""Metres, or radians, a second below which nothing moves."""


class OmniSimulation(GearedSimulation):
    """`batch` robots of one description, all at the same virtual time; `()` is a single one.

    A rigid body on wheels that carry equal shares of its weight. A roller holds the floor along its
    axle, by friction that grows with the creep and ends at its limit; there the wheel slips, and
    its encoder does not know.
    """

    longest_step_s = 0.0025
    """Wheels that lose their grip speed up within some milliseconds."""

    def __init__(
        self,
        robot: OmniRobot,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SE2 | None = None,
    ) -> None:
        self.drive = drive = robot.kinematics()
        shape, inertia = (*batch, drive.wheels), robot.driven_inertia_kg_m2(drive)
        super().__init__(robot, shape, inertia, seed=seed, noise=noise, battery_v=battery_v)
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self._twist = np.zeros((*batch, 3))
        self._grip = drive.grip_from_twist
        # Of a wheel's speed, the part along the roller's axle.
        self._arm_m = drive.wheel_radius_m * np.cos(drive.rollers_rad)
        self._pull_m = (1.0 - robot.drive.slip) * self._arm_m
        mass = robot.mass
        self._body = np.array([mass.total_kg, mass.total_kg, mass.yaw_inertia_kg_m2])
        self._wheel = robot.wheel_inertia_kg_m2
        self._friction_n = robot.drive.friction * mass.total_kg * _GRAVITY_MPS2 / drive.wheels
        self._sensors = None
        if robot.dead_wheels is not None:
            self._sensors = DeadWheelSensors(robot.dead_wheels, batch, self._random, noise)

    def measure(self) -> Array:
        """Return the wheel speeds, and what dead wheels and gyro say, (..., k + s)."""
        speeds = super().measure()
        if self._sensors is None:
            return speeds
        return np.concatenate([speeds, self._sensors.measure(self._twist)], axis=-1)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        return self._twist.copy()

    def slipping(self) -> Array:
        """Return how much faster each rim is than the floor under it, (..., k), m/s."""
        return self._arm_m * self.joints - self._twist @ self._grip.T

    def facts(self) -> dict[str, object]:
        """Return the voltage, and how fast the wheels slip."""
        return {
            "battery_v": self.battery_v,
            "slip_mps": np.round(self.slipping(), 4).tolist(),
        }

    def _rests(self) -> bool:
        return super()._rests() and not self._twist.any()

    def _step(self, dt_s: float) -> None:
        joints, twist = self._after(dt_s)
        middle = 0.5 * (self._twist + twist)
        self.pose = self.pose @ SE2.exp(dt_s * middle)
        if self._sensors is not None:
            self._sensors.advance(middle, dt_s)
        # The axes have turned with the body, the velocity in the world has not.
        angle = -dt_s * middle[..., 2]
        cos, sin = np.cos(angle), np.sin(angle)
        vx, vy = twist[..., 0].copy(), twist[..., 1].copy()
        twist[..., 0], twist[..., 1] = cos * vx - sin * vy, sin * vx + cos * vy
        if not self._goals.any() and np.abs(twist).max() < _SETTLED:
            twist[...], joints[...] = 0.0, 0.0
        self.joints, self._twist = joints, twist

    def _after(self, dt_s: float) -> tuple[Array, Array]:
        """Return wheel speeds and twist by the implicit Euler equations of wheels and body.

        Friction is c s with the creep s, and c falls as the creep grows: solved again with the c of
        the creep that came out, until that is the one that went in.
        """
        low, high = self._motors.bounds(self.joints)
        wanted = self._motors.gain_nm_s * (self._goals - self.joints)
        free = (wanted > low) & (wanted < high)
        gain: Array = np.where(free, self._motors.gain_nm_s, 0.0)
        torque = np.where(free, gain * self._goals, np.clip(wanted, low, high))
        joints, twist = self.joints, self._twist
        creep = self._creep(joints, twist)
        going = np.ones((*twist.shape[:-1], 1), dtype=bool)
        for _ in range(_ROUNDS):
            c = self._friction_n / np.sqrt(creep * creep + _CREEP_MPS**2)
            solved = self._linear(c, gain, torque, dt_s)
            # One that is done is left as it is, so that a batch is its members.
            joints = np.where(going, solved[0], joints)
            twist = np.where(going, solved[1], twist)
            before, creep = creep, self._creep(joints, twist)
            change = np.maximum.reduce(np.abs(creep - before), axis=-1, keepdims=True)
            going = going & (change >= _CLOSE_MPS)
            if not going.any():
                break
        return joints, twist

    def _linear(self, c: Array, gain: Array, torque: Array, dt_s: float) -> tuple[Array, Array]:
        """Return wheel speeds and twist for friction c s and torque less gain times speed.

        Each wheel's equation gives its speed from the twist; that leaves three for the body.
        """
        grip, heavy = self._grip, self._wheel / dt_s
        total = heavy + gain + c * self._arm_m * self._pull_m
        alone = (heavy * self.joints + torque) / total
        along = c * self._arm_m / total
        weight = c * (1.0 - self._pull_m * along)
        matrix = np.diag(self._body / dt_s) + (grip.T * weight[..., None, :]) @ grip
        push = self._twist * (self._body / dt_s) + (c * self._pull_m * alone) @ grip
        twist = np.asarray(np.linalg.solve(matrix, push[..., None])[..., 0], dtype=float)
        return alone + along * (twist @ grip.T), twist

    def _creep(self, joints: Array, twist: Array) -> Array:
        return self._pull_m * joints - twist @ self._grip.T
