"""Actuator models of a singularity drive: speed controllers, motors, gimbal servos, printed wheel
surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import RPM, SingularityDescription

_ARMING_SHARE = 0.9
"""Share of the described hold that controllers take to arm: a description leaves them a margin."""


class SpeedControllers:
    """Arming state machine of speed controllers from power-up on; arrays have one entry per motor.

    The hold starts with the first command, and again with each signal that is not zero throttle.
    Once armed, a controller stays so.
    """

    def __init__(self, shape: tuple[int, ...], zero_throttle: float, hold_s: float) -> None:
        self._zero_throttle = zero_throttle
        self._hold_s = _ARMING_SHARE * hold_s
        self._holding = np.zeros(shape, dtype=bool)
        self._held_s = np.zeros(shape)
        self._was_armed = np.zeros(shape, dtype=bool)
        self._is_idle = False
        """Whether more time changes nothing: all that hold have held for long enough."""
        self.signal: Array = np.full(shape, zero_throttle)
        """Newest signal commanded."""

    @property
    def armed(self) -> npt.NDArray[np.bool_]:
        """Controllers that pass their signal on."""
        return self._was_armed | (self._holding & (self._held_s >= self._hold_s))

    @property
    def is_repeatable(self) -> bool:
        """Whether the newest signals change nothing when they are given again.

        So it is when all pass theirs on, and when zero throttle is the newest signal of all.
        """
        return bool(self._was_armed.all() or self._holding.all())

    def command(self, signal: Array) -> Array:
        """Take a new throttle signal; return the one that reaches the motors until the next."""
        self._was_armed = self.armed
        self.signal = signal
        self._holding = signal <= self._zero_throttle
        self._held_s *= self._holding
        self._is_idle = False
        return np.where(self._was_armed, signal, self._zero_throttle)

    def lose_power(self) -> None:
        """Lose power: no motor is driven, and they arm anew."""
        self._was_armed[...] = self._holding[...] = self._is_idle = False
        self._held_s[...] = 0.0

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        if self._is_idle:
            return
        self._held_s += dt_s * self._holding
        self._is_idle = bool((~self._holding | (self._held_s >= self._hold_s)).all())


@dataclass(frozen=True, slots=True, eq=False)
class Motors:
    """Model of motors and speed controllers, on arrays (..., k): one entry per motor."""

    signals: Array
    """(r,): throttle signals of the calibration table, rising; the first is zero throttle."""
    speeds_rad_per_s: Array
    """(k, r): measured speed of each motor at each signal."""
    start_speed_rad_per_s: float
    """A motor whose curve gives less than this stands still."""
    time_constant_up_s: float
    time_constant_down_s: float
    pulses_us: tuple[float, float]
    """Pulse widths of the first and of the last signal."""

    @staticmethod
    def of(robot: SingularityDescription) -> Motors:
        """Motors of `robot`, as measured at its nominal voltage."""
        motor = robot.motor
        return Motors(
            signals=np.array(motor.signal),
            speeds_rad_per_s=np.array(motor.speed_rpm) * RPM,
            start_speed_rad_per_s=motor.start_speed_rpm * RPM,
            time_constant_up_s=motor.time_constant_up_s,
            time_constant_down_s=motor.time_constant_down_s,
            pulses_us=(motor.pulse_low_us, motor.pulse_high_us),
        )

    def signal(self, speed_rad_per_s: Array) -> Array:
        """Throttle signal that makes each motor turn at `speed_rad_per_s` (..., k).

        The inverse of the measured curve, kept within the table. Zero and below is zero throttle.
        """
        signal = np.empty(np.shape(speed_rad_per_s))
        for i, curve in enumerate(self.speeds_rad_per_s):
            signal[..., i] = np.interp(speed_rad_per_s[..., i], curve, self.signals)
        # The curve starts flat, so its inverse at zero could be any signal of the dead zone.
        return np.where(speed_rad_per_s > 0.0, signal, self.signals[0])

    def speed(self, signal: Array) -> Array:
        """Speed, rad/s, that each motor settles at for its `signal` (..., k)."""
        speed = np.empty(np.shape(signal))
        for i, curve in enumerate(self.speeds_rad_per_s):
            speed[..., i] = np.interp(signal[..., i], self.signals, curve)
        # Rounding must not stop a motor that is commanded to turn at its starting speed.
        start = self.start_speed_rad_per_s * (1.0 - 1e-9)
        return np.where(speed < start, 0.0, speed)

    def pulse_us(self, signal: Array) -> Array:
        """Pulse width, microseconds, of `signal`."""
        first, last = self.signals[0], self.signals[-1]
        low, high = self.pulses_us
        return low + (signal - first) / (last - first) * (high - low)

    def after(self, speed: Array, goal: Array, elapsed_s: Array) -> Array:
        """Speed `elapsed_s` later of motors that settle at `goal`, exactly; rad/s."""
        up_s, down_s = self.time_constant_up_s, self.time_constant_down_s
        time_constant_s = np.where(goal > speed, up_s, down_s)
        return goal + (speed - goal) * np.exp(-elapsed_s / time_constant_s)


@dataclass(frozen=True, slots=True)
class Servos:
    """Model of position servos under proportional control, as the MX-64; arrays of any shape.

    A servo turns at `approach_rate_per_s` times its error, up to its speed limit. Within the dead
    band the voltage is too low for the friction of the gears. Between motor and output shaft, which
    has the encoder, is play; a motor that reverses crosses it first. Gimbals have no load.
    """

    step_rad: float
    """Goals and measurements are whole numbers of this."""
    speed_limit_rad_per_s: float | Array
    approach_rate_per_s: float | Array
    angle_limit_rad: float
    """A goal beyond this, on either side, is taken for the last step within it."""
    dead_band_rad: float = 0.0
    """Position error below which a servo stands still."""
    backlash_rad: float = 0.0
    """Total backlash."""

    @staticmethod
    def of(robot: SingularityDescription, battery_v: float | Array) -> Servos:
        """Servos of `robot`; their top speed follows the voltage."""
        share = battery_v / robot.battery.nominal_v
        return Servos(
            step_rad=2.0 * np.pi / robot.servo.steps_per_turn,
            speed_limit_rad_per_s=robot.servo.no_load_speed_rpm * RPM * share,
            approach_rate_per_s=robot.servo.approach_rate_per_s,
            angle_limit_rad=float(np.radians(robot.drive.max_tilt_deg)),
            dead_band_rad=float(np.radians(robot.errors.dead_band_deg)),
            backlash_rad=float(np.radians(robot.errors.backlash_deg)),
        )

    @property
    def are_ideal(self) -> bool:
        """Whether they have neither a dead band nor play."""
        return self.dead_band_rad == 0.0 and self.backlash_rad == 0.0

    def quantise(self, angle: Array) -> Array:
        """Return `angle`, radians, at the nearest step."""
        return np.rint(angle / self.step_rad) * self.step_rad

    def goal(self, setpoint: Array) -> Array:
        """Goal angle of a servo for `setpoint`, quantised and limited, radians."""
        last = math.floor(self.angle_limit_rad / self.step_rad) * self.step_rad
        return np.minimum(np.maximum(self.quantise(setpoint), -last), last)

    def rate(self, angle: Array, goal: Array) -> Array:
        """Speed, rad/s, of motors whose gimbals are at `angle` on the way to `goal`."""
        limit, error = self.speed_limit_rad_per_s, goal - angle
        # A servo stops right at the edge of the dead band, give or take a rounding.
        moves = np.abs(error) > self.dead_band_rad * (1.0 + 1e-9)
        return np.clip(self.approach_rate_per_s * error * moves, -limit, limit)

    def after(self, angle: Array, goal: Array, elapsed_s: Array) -> Array:
        """Angle `elapsed_s` later without play, exactly: top speed first, then exponential."""
        error = goal - angle
        distance = np.abs(error)
        limit, rate = self.speed_limit_rad_per_s, self.approach_rate_per_s
        near_rad = limit / rate
        if (distance <= near_rad).all():
            left = distance + distance * np.expm1(-rate * elapsed_s)
        else:
            near = np.minimum(distance, near_rad)
            at_top_speed_s = np.minimum(elapsed_s, (distance - near) / limit)
            left = distance - limit * at_top_speed_s
            left += near * np.expm1(-rate * (elapsed_s - at_top_speed_s))
        if self.dead_band_rad > 0.0:
            left = np.maximum(left, np.minimum(distance, self.dead_band_rad))
        return goal - np.copysign(left, error)

    def cross(
        self, angle: Array, goal: Array, play: Array, elapsed_s: Array
    ) -> tuple[Array, Array]:
        """Remainder of `elapsed_s` after the motor has crossed its play, and the play.

        `play`, radians, is how far the motor is ahead of its gimbal, at most half the backlash on
        either side. The gimbal stands meanwhile, so the motor turns evenly.
        """
        speed, edge_rad = self.rate(angle, goal), 0.5 * self.backlash_rad
        # Rounding may leave the play beyond its edge by a little; that must not grow.
        to_go = np.maximum(edge_rad - np.sign(speed) * play, 0.0)
        crossing_s = to_go / np.maximum(np.abs(speed), 1e-300)
        spent_s = np.where(speed == 0.0, elapsed_s, np.minimum(elapsed_s, crossing_s))
        return elapsed_s - spent_s, np.clip(play + speed * spent_s, -edge_rad, edge_rad)


@dataclass(frozen=True, slots=True, eq=False)
class WheelSurface:
    """Rolling radius of printed wheels by the tilt of their axles.

    Layers lie across the axle; their surface is up to half a layer outside or inside of the sphere,
    one period per layer, with a phase for each wheel. Not modelled: a hard wheel that stands on the
    edge of a layer.
    """

    kinematics: SingularityKinematics
    layer_m: float
    phase_rad: Array
    """(..., k)."""

    @staticmethod
    def of(
        kinematics: SingularityKinematics,
        layer_m: float,
        random: np.random.Generator,
        shape: tuple[int, ...],
    ) -> WheelSurface:
        """Wheels with layers of `layer_m` at random phases; `shape` is (..., k)."""
        return WheelSurface(kinematics, layer_m, random.uniform(0.0, 2.0 * np.pi, shape))

    def outside_m(self, joints: Array) -> Array:
        """By how much the radius (..., k) at the floor is larger than described."""
        if self.layer_m == 0.0:
            return np.zeros(self.phase_rad.shape)
        modules = joints.reshape(*joints.shape[:-1], self.kinematics.modules, 3)
        upright = np.cos(modules[..., 0]) * np.cos(modules[..., 1])
        layers = self.kinematics.wheel_radius_m * (1.0 - upright) / self.layer_m
        return 0.5 * self.layer_m * np.sin(2.0 * np.pi * layers + self.phase_rad)

    def roll(self, joints: Array) -> Array:
        """Joints (..., n) that roll on spheres as `joints` do on these wheels."""
        if self.layer_m == 0.0:
            return joints
        rolling = joints.copy()
        rolling[..., 2::3] *= 1.0 + self.outside_m(joints) / self.kinematics.wheel_radius_m
        return rolling


class SimulationOptions(TypedDict, total=False):
    """Options of all simulations; by default seed 0, no noise and the nominal battery voltage."""

    seed: int | None
    noise: float
    """Factor on the standard deviations of the description."""
    battery_v: float | None
