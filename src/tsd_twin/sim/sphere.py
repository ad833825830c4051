"""Spherical platforms in virtual time: motors, and wheels whose contact hops between two rows."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SO3, Array
from tsd_twin.robots import SphereRobot
from tsd_twin.sim.geared import GearedSimulation


class SphereSimulation(GearedSimulation):
    """`batch` platforms of one description, all at the same virtual time; `()` is a single one.

    Nothing slips. The sphere always turns as the rows that carry make it, whatever model an
    estimate uses; at the start each wheel stands at the beginning of its first row.
    """

    longest_step_s = 0.005
    """Wheels come to speed within some tens of milliseconds."""

    def __init__(
        self,
        robot: SphereRobot,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SO3 | None = None,
    ) -> None:
        self.drive = drive = robot.kinematics()
        self._inertia = robot.driven_inertia_kg_m2(drive)
        shape = (*batch, drive.wheels)
        super().__init__(robot, shape, self._inertia, seed=seed, noise=noise, battery_v=battery_v)
        self.pose = SO3.identity(batch) if pose is None else SO3.identity(batch) @ pose
        """True orientation of the sphere in the world."""
        self.angles_rad: Array = np.zeros_like(self.joints)
        """(..., k): how far each wheel has turned."""
        self._time_constant_s = robot.motor.time_constant_s

    def twist(self) -> Array:
        """Return the true angular velocity (..., 3) in the base frame, on the rows of now."""
        return self.drive.true_twist(self.joints, self.drive.side(self.angles_rad))

    def facts(self) -> dict[str, object]:
        """Return the voltage, and which row of each wheel carries: 1 or 2."""
        rows = 1.5 + 0.5 * self.drive.side(self.angles_rad)
        return {"battery_v": self.battery_v, "rows": rows.astype(int).tolist()}

    def _step(self, dt_s: float) -> None:
        low, high = self._motors.bounds(self.joints)
        gained = (self._goals - self.joints) * -np.expm1(-dt_s / self._time_constant_s)
        gained = np.clip(gained, low * (dt_s / self._inertia), high * (dt_s / self._inertia))
        joints = self.joints + gained
        joints[np.abs(joints) + np.abs(self._goals) < 1e-9] = 0.0
        middle = 0.5 * (self.joints + joints)
        angles = self.angles_rad + dt_s * middle
        side = self.drive.mean_side(self.angles_rad, angles)
        twist = self.drive.true_twist(middle, side)
        self.pose = self.drive.move(self.pose, twist, dt_s)
        self.joints, self.angles_rad = joints, angles
