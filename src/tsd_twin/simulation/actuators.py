"""Actuator models of a singularity drive: ESCs, motors, gimbal servos, printed wheel surface."""

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
"""Fraction of the described hold time that controllers need to arm; descriptions include a
margin."""


class EscModel:
    """Arming state machine of speed controllers (ESCs); arrays have one entry per motor.

    The hold starts with the first command, and restarts with each signal above zero throttle. Once
    armed, a controller remains armed.
    """

    def __init__(self, shape: tuple[int, ...], zero_throttle: float, hold_s: float) -> None:
        self._zero_throttle = zero_throttle
        self._hold_s = _ARMING_SHARE * hold_s
        self._holding = np.zeros(shape, dtype=bool)
        self._held_s = np.zeros(shape)
        self._was_armed = np.zeros(shape, dtype=bool)
        self._is_idle = False
        """Whether waiting has no effect, because all holds are complete."""
        self.signal: Array = np.full(shape, zero_throttle)
        """Latest commanded signal."""

    @property
    def armed(self) -> npt.NDArray[np.bool_]:
        """Controllers that forward their signal."""
        return self._was_armed | (self._holding & (self._held_s >= self._hold_s))

    @property
    def is_repeatable(self) -> bool:
        """Whether repeating the latest signals has no effect.

        This is the case if all controllers forward their signals, or if all signals are zero
        throttle.
        """
        return bool(self._was_armed.all() or self._holding.all())

    def command(self, signal: Array) -> Array:
        """Set the throttle signals; return those that reach the motors until the next call."""
        self._was_armed = self.armed
        self.signal = signal
        self._holding = signal <= self._zero_throttle
        self._held_s *= self._holding
        self._is_idle = False
        return np.where(self._was_armed, signal, self._zero_throttle)

    def lose_power(self) -> None:
        """Lose power: motors are off, and controllers must arm again."""
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
    """Model of motors and speed controllers, on arrays (..., k) with one entry per motor."""

    signals: Array
    """(r,): throttle signals of the calibration table, increasing from zero throttle."""
    speeds_rad_per_s: Array
    """(k, r): measured speed of each motor at each signal."""
    start_speed_rad_per_s: float
    """Minimum speed on the curve at which a motor turns."""
    time_constant_up_s: float
    time_constant_down_s: float
    pulses_us: tuple[float, float]
    """Pulse widths of the first and last signal."""

    @staticmethod
    def of(robot: SingularityDescription) -> Motors:
        """Return the motors of `robot`, as measured at nominal voltage."""
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
        """Return the throttle signal (..., k) for each motor to turn at `speed_rad_per_s` (..., k).

        Inverts the measured curve, clamped to the table. Speeds up to zero give zero throttle.
        """
        signal = np.empty(np.shape(speed_rad_per_s))
        for i, curve in enumerate(self.speeds_rad_per_s):
            signal[..., i] = np.interp(speed_rad_per_s[..., i], curve, self.signals)
        # The curve starts flat, so zero would map to an arbitrary signal of the dead zone.
        return np.where(speed_rad_per_s > 0.0, signal, self.signals[0])

    def speed(self, signal: Array) -> Array:
        """Return the steady-state speed (..., k), rad/s, for `signal` (..., k)."""
        speed = np.empty(np.shape(signal))
        for i, curve in enumerate(self.speeds_rad_per_s):
            speed[..., i] = np.interp(signal[..., i], self.signals, curve)
        # Rounding must not stop a motor that is commanded to turn at its starting speed.
        start = self.start_speed_rad_per_s * (1.0 - 1e-9)
        return np.where(speed < start, 0.0, speed)

    def pulse_us(self, signal: Array) -> Array:
        """Return the pulse width of `signal`, microseconds."""
        first, last = self.signals[0], self.signals[-1]
        low, high = self.pulses_us
        return low + (signal - first) / (last - first) * (high - low)

    def after(self, speed: Array, goal: Array, elapsed_s: Array) -> Array:
        """Return the exact speeds, rad/s, after `elapsed_s` with the steady-state speeds `goal`."""
        up_s, down_s = self.time_constant_up_s, self.time_constant_down_s
        time_constant_s = np.where(goal > speed, up_s, down_s)
        return goal + (speed - goal) * np.exp(-elapsed_s / time_constant_s)


@dataclass(frozen=True, slots=True)
class Servos:
    """Model of proportionally controlled position servos such as the MX-64; arrays of any shape.

    A servo's speed is `approach_rate_per_s` times its error, clamped to its limit. Within the dead
    band the voltage cannot overcome gear friction. The motor has backlash relative to the output
    shaft, where the encoder sits; a reversing motor crosses it first. Gimbals have no load.
    """

    step_rad: float
    """Resolution of goals and measurements."""
    speed_limit_rad_per_s: float | Array
    approach_rate_per_s: float | Array
    angle_limit_rad: float
    """Goals are clamped to the last step within this angle, in both directions."""
    dead_band_rad: float = 0.0
    """Position error below which a servo does not move."""
    backlash_rad: float = 0.0
    """Total backlash."""

    @staticmethod
    def of(robot: SingularityDescription, battery_v: float | Array) -> Servos:
        """Return the servos of `robot`; their maximum speed is proportional to the voltage."""
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
        """Whether they have neither dead band nor backlash."""
        return self.dead_band_rad == 0.0 and self.backlash_rad == 0.0

    def quantise(self, angle: Array) -> Array:
        """Round `angle`, radians, to the nearest step."""
        return np.rint(angle / self.step_rad) * self.step_rad

    def goal(self, setpoint: Array) -> Array:
        """Return the goal angle of a servo for `setpoint`, quantised and limited, radians."""
        last = math.floor(self.angle_limit_rad / self.step_rad) * self.step_rad
        return np.minimum(np.maximum(self.quantise(setpoint), -last), last)

    def rate(self, angle: Array, goal: Array) -> Array:
        """Return the motor speed, rad/s, for gimbals at `angle` moving towards `goal`."""
        limit, error = self.speed_limit_rad_per_s, goal - angle
        # Servos stop exactly at the edge of the dead band, up to rounding.
        moves = np.abs(error) > self.dead_band_rad * (1.0 + 1e-9)
        return np.clip(self.approach_rate_per_s * error * moves, -limit, limit)

    def after(self, angle: Array, goal: Array, elapsed_s: Array) -> Array:
        """Return the exact angle after `elapsed_s` without backlash: linear, then exponential."""
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
        """Return the remainder of `elapsed_s` after crossing the backlash, and the new `play`.

        `play`, radians, is the motor's lead over its gimbal, at most half the backlash in each
        direction. The gimbal is at rest until then, so the motor speed is constant.
        """
        speed, edge_rad = self.rate(angle, goal), 0.5 * self.backlash_rad
        # Rounding may leave the play slightly beyond its edge; prevent further growth.
        to_go = np.maximum(edge_rad - np.sign(speed) * play, 0.0)
        crossing_s = to_go / np.maximum(np.abs(speed), 1e-300)
        spent_s = np.where(speed == 0.0, elapsed_s, np.minimum(elapsed_s, crossing_s))
        return elapsed_s - spent_s, np.clip(play + speed * spent_s, -edge_rad, edge_rad)


@dataclass(frozen=True, slots=True, eq=False)
class WheelSurface:
    """Rolling radius of printed wheels as a function of axle tilt.

    Layers are perpendicular to the axle. Their surface deviates by up to half a layer from the
    sphere, with one period per layer and a phase for each wheel. Not modelled: a hard wheel resting
    on the edge of a layer.
    """

    kinematics: SingularityKinematics
    layer_m: float
    phase_rad: Array
    """(..., k): phase for each wheel."""

    @staticmethod
    def of(
        kinematics: SingularityKinematics,
        layer_m: float,
        random: np.random.Generator,
        shape: tuple[int, ...],
    ) -> WheelSurface:
        """Return wheels with layers of `layer_m` at random phases; `shape` is (..., k)."""
        return WheelSurface(kinematics, layer_m, random.uniform(0.0, 2.0 * np.pi, shape))

    def outside_m(self, joints: Array) -> Array:
        """Return the excess (..., k) of the radius at the floor over its description."""
        if self.layer_m == 0.0:
            return np.zeros(self.phase_rad.shape)
        modules = joints.reshape(*joints.shape[:-1], self.kinematics.modules, 3)
        upright = np.cos(modules[..., 0]) * np.cos(modules[..., 1])
        layers = self.kinematics.wheel_radius_m * (1.0 - upright) / self.layer_m
        return 0.5 * self.layer_m * np.sin(2.0 * np.pi * layers + self.phase_rad)

    def roll(self, joints: Array) -> Array:
        """Return joints (..., n) that roll on ideal spheres as `joints` do on these wheels."""
        if self.layer_m == 0.0:
            return joints
        rolling = joints.copy()
        rolling[..., 2::3] *= 1.0 + self.outside_m(joints) / self.kinematics.wheel_radius_m
        return rolling


class SimulationOptions(TypedDict, total=False):
    """Options of all simulations; the defaults are seed 0, no noise and nominal battery voltage."""

    seed: int | None
    noise: float
    """Factor on the described standard deviations."""
    battery_v: float | None
