"""Spherical platforms in virtual time: motors, and wheels whose contact hops between two rows."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SO3, Array
from tsd_twin.robots import SphereRobot
from tsd_twin.sim.geared_motor import GearedMotors

_LONGEST_STEP_S = 0.005
"""Wheels come to speed within some tens of milliseconds."""


class SphereSimulation:
    """`batch` platforms of one description, all at the same virtual time; `()` is a single one.

    Nothing slips. The sphere always turns as the rows that carry make it, whatever model an
    estimate uses; at the start each wheel stands at the beginning of its first row. `noise` scales
    the standard deviations of the description: each wheel measures its speed wrong by a share that
    stays the same for the run.
    """

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
        self.battery_v = robot.battery.nominal_v if battery_v is None else battery_v
        self.pose = SO3.identity(batch) if pose is None else SO3.identity(batch) @ pose
        """True orientation of the sphere in the world."""
        self.joints: Array = np.zeros((*batch, drive.wheels))
        """(..., k): true wheel speeds."""
        self.angles_rad: Array = np.zeros_like(self.joints)
        """(..., k): how far each wheel has turned."""
        self._goals = np.zeros_like(self.joints)
        motor = robot.motor
        self._inertia = robot.driven_inertia_kg_m2(drive)
        share = self.battery_v / robot.battery.nominal_v
        self._motors = GearedMotors.of(motor, self._inertia, share)
        self._time_constant_s = motor.time_constant_s
        random = np.random.default_rng(seed)
        shape = self.joints.shape
        self._scale = 1.0 + noise * robot.noise.spin_share * random.standard_normal(shape)

    def command(self, setpoint: Array) -> None:
        """Give all motors new speeds, (..., k), rad/s.

        Raises:
            ValueError: a number is not finite, or there is not one for each wheel.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        self._goals[...] = np.broadcast_to(setpoint, self.joints.shape)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        if not (self.joints.any() or self._goals.any()):
            return
        steps = int(np.ceil(dt_s / _LONGEST_STEP_S - 1e-9))
        for _ in range(steps):
            self._step(dt_s / steps)

    def measure(self) -> Array:
        """Return the wheel speeds (..., k)."""
        return self.joints * self._scale

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
