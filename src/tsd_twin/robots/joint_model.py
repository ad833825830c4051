"""Errors and deviations that are expected of the joints of a built robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True)
class FloorErrors:
    """Standard deviations of floor effects on robots with continuously spinning wheels.

    They have three independent causes: drag grows with friction and contact patch, lag falls with
    friction, and lost energy depends on neither. The first four hold at one wheel speed.
    """

    at_rad_per_s: float = 1.0
    """Wheel speed at which the other values hold."""
    speed_scale_sigma: float = 0.0
    """Drag: relative speed loss of a wheel due to floor friction; the absolute loss is the same at
    any speed."""
    turn_rad_per_s: float = 0.0
    """Drag: turn rate against the wheels' spin that joints cannot measure; proportional to the
    wheel speed."""
    slip_lag_s: float = 0.0
    """Lag: time by which the motion lags the joints; proportional to the wheel speed."""
    grip_per_s2: tuple[float, float, float] = (1e3, 1e3, 1e3)
    """Lag: acceleration (m/s², rad/s²) at which the floor saturates."""
    droop_s2_per_m2: float = 0.0
    """Lost energy: relative loss of wheel speed per change of the squared robot speed, when the
    robot accelerates; falls with the square of the wheel speed."""
    restore_up_s: float = 1.0
    """Time constant with which motors restore lost wheel speed."""
    restore_down_s: float = 1.0
    """Time constant with which motors remove gained wheel speed."""
    turn_per_spin: float = 0.0
    """Turn-rate change of the robot equivalent, in floor force, to a unit change of a wheel's
    speed."""


@dataclass(frozen=True, slots=True)
class JointErrors:
    """Standard deviations of measured joints."""

    angle_rad: float = 0.0
    """White noise of a position joint."""
    rounding_rad: float = 0.0
    """Additional rounding error of a joint at rest between two encoder steps."""
    speed_scale_sigma: float = 0.0
    """Bias of a velocity joint, relative to its speed."""
    common_spin_share: float = 0.0
    """Common relative bias of all velocity joints."""
    motor_share: float = 0.0
    """Part of `common_spin_share` that remains if the supply voltage is known."""
    zero_rad: float = 0.0
    """Bias of a position joint's zero."""
    floor: FloorErrors = FloorErrors()
    """Floor effects on continuously spinning wheels; a bias."""
    creep_lag_s: tuple[tuple[float, ...], ...] | None = None
    """(3, 3): twist by which a body lags its rollers per acceleration in m/s² and rad/s², scaled by
    one standard normal number; None without creep."""
    mount_rad: float = 0.0
    """Angle at which a wheel or module is mounted wrongly; a bias."""
    place_m: float = 0.0
    """Displacement of a wheel or pivot along X and along Y; a bias."""
    slope_mps2: float = 0.0
    """Acceleration along a sloping floor, for each of two directions; a bias."""
    random_walk_rad: float = 0.0
    """Random walk of each velocity joint's angle after one second in which any of them turns; grows
    with the square root of time."""

    @property
    def common_mode_sigma(self) -> float:
        """Total common relative bias of all velocity joints."""
        return math.hypot(self.common_spin_share, self.floor.speed_scale_sigma)


@dataclass(frozen=True, slots=True)
class WheelSpeedResponse:
    """First-order model of a wheel speed following its setpoint."""

    start_speed_rad_per_s: float
    """Dead band: setpoints below this do not turn the motor."""
    up_s: float
    """Time constant of acceleration."""
    down_s: float
    """Time constant of deceleration."""


@dataclass(frozen=True, slots=True, eq=False)
class JointCompliance:
    """Expected deviations of position joints of a healthy robot.

    Joints deflect under contact forces. The force of a sliding contact is proportional to its slip,
    as long as the slip is small.
    """

    by_acceleration: Array
    """(n, 3): deflection per acceleration over the ground, rad per m/s² and rad/s²."""
    by_force: Array
    """(n, m): deflection per floor force along each residual component, rad/N."""
    friction_n: float
    """Maximum friction of a sliding contact."""
    spin_to_slip_m: float
    """Slip per wheel speed at which the force reaches 71 % of the friction."""
    lag_s: float
    """Time constant with which joints follow their setpoints."""
    backlash_rad: float
    """Total backlash: maximum lag of a joint after a reversal, within its dynamic lag."""
    dead_band_rad: float
    """Maximum error of a joint at rest."""

    def by_slip(self, spin_rad_per_s: float) -> Array:
        """Return the deflection (n, m) per slip of each contact, rad per m/s."""
        slip_mps = self.spin_to_slip_m * abs(spin_rad_per_s)
        if slip_mps <= 0.0:
            return np.zeros_like(self.by_force)
        return self.friction_n / slip_mps * self.by_force
