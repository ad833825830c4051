"""Actuators of simulated singularity drives: servos, speed controllers and motors as built."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from tsd_twin.kinematics import JointKind, SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.robots.description import BuildErrors
from tsd_twin.simulation.actuators import (
    EscModel,
    Motors,
    Servos,
    WheelSurface,
)

_SETTLED = 1e-9
"""Distance (rad or rad/s) below which joints count as being at their goal: about 10 nm/s."""
_CACHED_STEPS = 16
"""Number of cached step lengths; steps of 0.01 s differ in their last digits."""


@functools.lru_cache(maxsize=_CACHED_STEPS)
def _decays(
    rate: float, up_s: float, down_s: float, times_s: tuple[float, ...]
) -> list[list[float]]:
    """Return the servo decay minus 1 and both motor decays (up, down) for each time."""
    elapsed_s = np.array(times_s)
    decays = np.expm1(-rate * elapsed_s), np.exp(-elapsed_s / up_s), np.exp(-elapsed_s / down_s)
    return np.stack(decays, axis=-1).tolist()


class Actuation:
    """Converts setpoints into goals of servos and motors, and joints into measurements.

    `noise` scales the described standard deviations. Measured gimbal angles have noise; each wheel
    speed has a constant relative error. The controller knows the machine's `[calibration]`, but not
    its `robot.errors`.
    """

    def __init__(
        self,
        robot: SingularityDescription,
        batch: tuple[int, ...],
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
    ) -> None:
        self.kinematics: SingularityKinematics = robot.kinematics()
        kinds = [joint.kind for joint in self.kinematics.joints]
        self.angles = np.flatnonzero([kind is JointKind.POSITION for kind in kinds])
        """Indices of the gimbals in the joint vector."""
        self.wheels = np.flatnonzero([kind is JointKind.VELOCITY for kind in kinds])
        """Indices of the wheels in the joint vector."""
        self._joints = len(kinds)
        shape = (*batch, len(self.wheels))
        self._offsets = robot.actuator_offsets()
        # A separate random generator makes construction errors independent of the noise.
        built = np.random.default_rng(None if seed is None else [seed, 1])
        nominal_v = robot.battery.nominal_v
        off = robot.errors.battery_share * built.standard_normal((*batch, 1))
        given = nominal_v * (1.0 + off) if battery_v is None else battery_v
        self.battery_v: Array = np.broadcast_to(given, off.shape)
        """(..., 1): battery voltage of each robot."""
        self.surface = WheelSurface.of(self.kinematics, robot.errors.layer_m, built, shape)
        self._sound_servos = Servos.of(robot, nominal_v)
        self.servos = Servos.of(robot, self.battery_v)
        self.layout = BuiltLayout.of(self.kinematics, robot.errors, batch, seed)
        self.servo_shares: Array = np.ones((*batch, len(self.angles)))
        """(..., 2k): speed of each servo relative to a healthy one."""
        self.motors = Motors.of(robot)
        self.controllers = EscModel(shape, float(self.motors.signals[0]), robot.motor.arming_hold_s)
        self._random = np.random.default_rng(seed)
        self._angle_noise_rad = noise * float(np.radians(robot.noise.gimbal_angle_deg))
        spin_errors = noise * robot.noise.speed_scale_sigma * self._random.standard_normal(shape)
        self._nominal_v = nominal_v
        self.sound_shares: Array = (1.0 + spin_errors) * self._offsets.scale[self.wheels]
        """(..., k): speed of each healthy wheel relative to the motor table."""
        self._wheel_shares: Array = np.ones(shape)
        self._unloaded: Array = np.zeros(shape)
        """(..., k): speeds from the motor table for the latest signals."""
        self._offset = self._offsets.offset[self.angles]
        wrong = np.radians(robot.errors.zero_deg)
        self.zero_rad: Array = self._offset + wrong * built.standard_normal(
            (*batch, len(self.angles))
        )
        """(..., 2k): true gimbal angle when its servo reports 0."""
        curve_error = robot.errors.motor_share * built.standard_normal((*batch, 1))
        self.sound_shares = self.sound_shares * (1.0 + curve_error)
        self.goals: Array = self.zero_rad.copy()
        """(..., 2k): goal angles of the servos."""
        self.speed_goals: Array = np.zeros(shape)
        """(..., k): steady-state speeds of the motors, rad/s."""
        self.backlash_rad: Array = np.zeros_like(self.goals)
        """(..., 2k): lead of each servo's motor over its gimbal."""
        self._all_on = False
        """Whether all motors are running."""
        self._repeatable: tuple[tuple[int, ...], bytes] | None = None
        """Latest setpoint, if repeating it has no effect."""
        self._last_speeds = b""
        """Latest commanded speeds, if repeating them has no effect."""

    def command(self, setpoint: Array) -> bool:
        """Set the setpoints (..., n) of all actuators; return whether this can have any effect.

        Wheels turn in one direction only; speeds up to zero give zero throttle.

        Raises:
            ValueError: As in `checked`.
        """
        same = (np.shape(setpoint), np.asarray(setpoint, dtype=float).tobytes())
        if same == self._repeatable:
            return False
        actuators = self._offsets.to_actuators(self.checked(setpoint))
        self.goals[...] = self.zero_rad + self.servos.goal(actuators[..., self.angles])
        self._set_motor_speeds(actuators[..., self.wheels])
        self._repeatable = same if self._last_speeds else None
        return True

    def _set_motor_speeds(self, speeds: Array) -> None:
        """Command the motor speeds (..., k)."""
        speed_bytes = speeds.tobytes()
        if speed_bytes == self._last_speeds:
            return
        signal = self.controllers.command(self.motors.signal(speeds))
        self._unloaded[...] = self.motors.speed(signal)
        self._set_speed_goals()
        self._last_speeds = speed_bytes if self.controllers.is_repeatable else b""

    def lose_drive(self) -> None:
        """Cut the speed controllers' power: motors are off, and controllers must arm again."""
        self.controllers.lose_power()
        self._unloaded[...] = 0.0
        self._set_speed_goals()
        self._repeatable, self._last_speeds = None, b""

    def degrade(self, shares: Array) -> None:
        """Slow down joints: `shares` (..., n) are speeds relative to healthy joints."""
        shares = np.broadcast_to(shares, (*self.goals.shape[:-1], self._joints))
        self.servo_shares = shares[..., self.angles].copy()
        self._wheel_shares = shares[..., self.wheels].copy()
        self._update_supply()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.battery_v = np.full_like(self.battery_v, battery_v)
        self._update_supply()

    def _update_supply(self) -> None:
        sound = self._sound_servos
        limit = sound.speed_limit_rad_per_s * self.battery_v / self._nominal_v
        self.servos = replace(
            sound,
            speed_limit_rad_per_s=limit * self.servo_shares,
            approach_rate_per_s=sound.approach_rate_per_s * self.servo_shares,
        )
        self._set_speed_goals()
        self._repeatable = None  # The same setpoints now cause a different motion.

    def _set_speed_goals(self) -> None:
        # The curves were measured at nominal voltage.
        share = self.battery_v / self._nominal_v * self.sound_shares * self._wheel_shares
        self.speed_goals[...] = self._unloaded * share
        self._all_on = bool(self.speed_goals.all())

    def checked(self, setpoint: Array) -> Array:
        """Validate setpoints and broadcast them to (..., n).

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        shape = (*self.goals.shape[:-1], self._joints)
        return setpoint if np.shape(setpoint) == shape else np.broadcast_to(setpoint, shape)

    def after(self, joints: Array, elapsed_s: Array) -> Array:
        """Advance unloaded joints to times (m, ..., 1) from now; the last becomes the state."""
        if joints.ndim == 1 and (few := self._single_after(joints, elapsed_s)) is not None:
            return few
        angles, goals = joints[..., self.angles], self.goals
        turning_s = elapsed_s
        if not self.servos.are_ideal:
            turning_s, play = self.servos.cross(angles, goals, self.backlash_rad, elapsed_s)
            self.backlash_rad = play[-1]
        later = np.empty((len(elapsed_s), *joints.shape))
        modules = later.reshape(*later.shape[:-1], len(self.wheels), 3)
        turned = self.servos.after(angles, goals, turning_s)
        modules[..., :2] = turned.reshape(*turned.shape[:-1], len(self.wheels), 2)
        speeds = joints[..., self.wheels]
        modules[..., 2] = self.motors.after(speeds, self.speed_goals, elapsed_s)
        return later

    def _single_after(self, joints: Array, elapsed_s: Array) -> Array | None:
        """Compute `after` for a single robot in plain floats: three times as fast, bit-identical.

        Returns None if a servo is not ideal, degraded, or at its maximum speed.
        """
        servos, motors = self.servos, self.motors
        limit, rate = servos.speed_limit_rad_per_s, servos.approach_rate_per_s
        if not (servos.are_ideal and isinstance(rate, float) and np.size(limit) == 1):
            return None
        now, goals, speed_goals = joints.tolist(), self.goals.tolist(), self.speed_goals.tolist()
        errors = [goal - now[i] for goal, i in zip(goals, self.angles.tolist(), strict=True)]
        near_rad = float(np.take(limit, 0)) / rate
        if not all(abs(error) <= near_rad for error in errors):
            return None
        times_s, later = tuple(elapsed_s.ravel().tolist()), list[float]()
        up_s, down_s = motors.time_constant_up_s, motors.time_constant_down_s
        for fallen, up, down in _decays(rate, up_s, down_s, times_s):
            distances = [abs(error) + abs(error) * fallen for error in errors]
            turned = [
                goal - math.copysign(left, error)
                for goal, left, error in zip(goals, distances, errors, strict=True)
            ]
            for at, goal in enumerate(speed_goals):
                speed = now[3 * at + 2]
                speed = goal + (speed - goal) * (up if goal > speed else down)
                later += (turned[2 * at], turned[2 * at + 1], speed)
        return np.array(later).reshape(len(times_s), len(now))

    def rates(self, joints: Array) -> Array:
        """Return the unloaded gimbal rates at `joints` (..., n), rad/s; 0 for wheels."""
        rates = np.zeros_like(joints)
        speed = self.servos.rate(joints[..., self.angles], self.goals)
        edge_rad = 0.5 * self.servos.backlash_rad
        touches = np.abs(np.copysign(edge_rad, speed) - self.backlash_rad) <= 1e-12
        rates[..., self.angles] = speed * touches
        return rates

    def come_to_rest(self, joints: Array) -> None:
        """Snap joints (..., n) of modules with stopped motors to rest once nearly there."""
        if self._all_on:
            return
        off = self.speed_goals == 0.0
        speeds, angles = joints[..., self.wheels], joints[..., self.angles]
        slow = off & (np.abs(speeds) < _SETTLED)
        near = np.repeat(slow, 2, axis=-1) & (np.abs(angles - self.goals) < _SETTLED)
        joints[..., self.wheels] = np.where(slow, 0.0, speeds)
        joints[..., self.angles] = np.where(near, self.goals, angles)

    @property
    def is_exact(self) -> bool:
        """Whether measurements are free of noise."""
        return self._angle_noise_rad <= 0.0

    def stands(self, joints: Array) -> bool:
        """Return whether all wheels are at rest and all gimbals exactly at their goals."""
        return not (
            self._all_on
            or self.speed_goals.any()
            or joints[..., self.wheels].any()
            or (joints[..., self.angles] != self.goals).any()
        )

    def settled(self, joints: Array) -> bool:
        """Return whether all transients have decayed."""
        turning = np.abs(self.servos.rate(joints[..., self.angles], self.goals))
        off = np.abs(joints[..., self.wheels] - self.speed_goals)
        slowest = _SETTLED * np.asarray(self.servos.approach_rate_per_s)
        return bool((turning < slowest).all() and off.max() < _SETTLED)

    def measure(self, joints: Array) -> Array:
        """Return the joint vector (..., n), with angles quantized to servo steps.

        Wheel speeds are exact; callers decide whether a robot measures them.
        """
        measured = joints.copy()
        angles = joints.take(self.angles, axis=-1) - self.zero_rad
        if self._angle_noise_rad > 0.0:
            angles += self._angle_noise_rad * self._random.standard_normal(angles.shape)
        measured[..., self.angles] = self.servos.quantise(angles) + self._offset
        return measured

    def hardware_status(self) -> dict[str, object]:
        """Return voltage, arming state and pulse widths of the speed controllers."""
        return {
            "battery_v": fmean(self.battery_v.ravel().tolist()),
            "esc_armed": all(self.controllers.armed.ravel().tolist()),
            "pulse_us": self.motors.pulse_us(self.controllers.signal).tolist(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class BuiltLayout:
    """Places and mounting angles of the modules of built robots."""

    turned_rad: Array
    """(..., k): angle by which each module is turned about the vertical."""
    displaced_m: Array
    """(..., k, 2): displacement of each pivot."""
    downhill_rad: Array
    """(...): direction of the slope of the floor in the world."""
    twist_from_contacts: Array | None
    """(..., 3, 2k): as in the kinematics; None for modules as described."""

    @staticmethod
    def of(
        kinematics: SingularityKinematics,
        errors: BuildErrors,
        batch: tuple[int, ...],
        seed: int | None,
    ) -> BuiltLayout:
        """Return the layout of robots with these errors."""
        # A separate generator keeps other errors of a robot the same with any layout.
        random = np.random.default_rng(None if seed is None else [seed, 5])
        shape = (*batch, kinematics.modules)
        turned = math.radians(errors.mount_deg) * random.standard_normal(shape)
        displaced = errors.place_m * random.standard_normal((*shape, 2))
        downhill = random.uniform(0.0, 2.0 * np.pi, batch)
        if not (turned.any() or displaced.any()):
            return BuiltLayout(turned, displaced, downhill, None)
        angles = kinematics.azimuths_rad - 0.5 * np.pi + turned
        x, y = np.moveaxis(kinematics.pivots_m + displaced, -1, 0)
        c, s = np.cos(angles), np.sin(angles)
        rows = np.stack(
            [
                np.stack([c, s, s * x - c * y], axis=-1),
                np.stack([-s, c, c * x + s * y], axis=-1),
            ],
            axis=-2,
        )
        inverse = np.linalg.pinv(rows.reshape(*batch, 2 * kinematics.modules, 3))
        return BuiltLayout(turned, displaced, downhill, inverse)

    def twist(
        self, kinematics: SingularityKinematics, joints: Array, rates: Array | None = None
    ) -> Array:
        """Return the twist (..., 3) of rolling; arguments as in the kinematics."""
        if self.twist_from_contacts is None:
            return kinematics.twist(joints, rates)
        contacts = kinematics.contacts(joints, rates)
        flat = contacts.reshape(*contacts.shape[:-2], -1)
        return np.asarray((self.twist_from_contacts @ flat[..., None])[..., 0], dtype=float)
