"""Simulation of singularity drives: actuators, and rolling without slip to fourth order."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Unpack

import numpy as np

from tsd_twin.kinematics import JointKind, SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.robots.description import BuildErrors
from tsd_twin.simulation.actuators import (
    EscModel,
    Motors,
    Servos,
    SimulationOptions,
    WheelSurface,
)

_SLOPES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])
"""Derivatives at start, middle and end of the parabola through three values there, times dt."""
_SIMPSON = np.array([[1.0, 4.0, 1.0]]) / 6.0
_SETTLED = 1e-9
"""Distance (rad or rad/s) below which joints count as being at their goal: about 10 nm/s."""
_CACHED_STEPS = 16
"""Number of cached step lengths; steps of 0.01 s differ in their last digits."""


@functools.lru_cache(maxsize=_CACHED_STEPS)
def _step_rules(dt_s: float) -> tuple[Array, Array]:
    """Return the matrices for derivatives and integral over a step of `dt_s` seconds."""
    return _SLOPES / dt_s, dt_s * _SIMPSON


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


def rolling_tangent(
    kinematics: SingularityKinematics,
    joints: Array,
    dt_s: float,
    layout: BuiltLayout | None = None,
) -> Array:
    """Return the tangent (..., 3) of rolling without slip over a step of `dt_s` seconds.

    The built robot has the described `layout` by default.

    `joints` (3, ..., n) are the true joint vectors at its start, middle and end. Gimbal rates come
    from the parabola through them, so that Simpson's rule sums exactly to the rotation angle over
    any number of steps.

    The twist changes during the step, and rotations do not commute with translations; the second
    term of the Magnus expansion preserves fourth order. Source: Iserles and Norsett, "On the
    solution of linear differential equations in Lie groups" (1999), with the sign for twists in the
    body frame.
    """
    by_node = joints.reshape(3, -1)
    slopes, weights = _step_rules(dt_s)
    rates = (slopes @ by_node).reshape(joints.shape)
    if layout is None:
        twists = kinematics.twist(joints, rates)
    else:
        twists = layout.twist(kinematics, joints, rates)
    tangent = (weights @ twists.reshape(3, -1)).reshape(twists.shape[1:])
    # For a single robot, list elements are faster than array elements.
    vx, vy, omega = twists.T.tolist() if twists.ndim == 2 else np.moveaxis(twists, -1, 0)
    twelfth = dt_s * dt_s / 12.0
    tangent[..., 0] += twelfth * (omega[2] * vy[0] - omega[0] * vy[2])
    tangent[..., 1] += twelfth * (omega[0] * vx[2] - omega[2] * vx[0])
    return tangent


_MAX_STEP_S = 0.02
"""Maximum integration step, short compared to the servo time constant of about 1/30 s."""


class SingularitySimulation:
    """`batch` robots in lockstep virtual time; `()` is a single robot.

    Servos, speed controllers and motors drive wheels that roll without slip; bodies have no mass.
    For `noise` see `Actuation`.
    """

    def __init__(
        self,
        robot: SingularityDescription,
        batch: tuple[int, ...] = (),
        *,
        pose: SE2 | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        self.actuation = Actuation(robot, batch, **options)
        self.kinematics = self.actuation.kinematics
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self.joints: Array = np.zeros((*batch, len(self.kinematics.joints)))
        """(..., n): true joint vector."""
        self.joints[..., self.actuation.angles] = self.actuation.zero_rad
        self._at_rest = False
        self._displacements: dict[float, SE2] = {}
        """Displacements by step length, for steps that leave all joints unchanged."""
        self._measured: Array | None = None
        """Cached noise-free measurement while no joint changes."""
        self._halves = np.array([0.5, 1.0]).reshape(2, *(1,) * (len(batch) + 1))

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of all actuators, as in `Actuation.command`."""
        if self.actuation.command(setpoint):
            self._clear_cache()

    def degrade(self, shares: Array) -> None:
        """Slow down joints, as in `Actuation.degrade`."""
        self.actuation.degrade(shares)
        self._clear_cache()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.actuation.set_battery(battery_v)
        self._clear_cache()

    def _clear_cache(self) -> None:
        self._at_rest = False
        self._displacements.clear()

    def lose_drive(self) -> None:
        """Cut the speed controllers' power, as in `Actuation.lose_drive`."""
        self.actuation.lose_drive()
        self._clear_cache()

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s`: in short steps while joints move, otherwise in one."""
        self.actuation.controllers.advance(dt_s)
        if self._at_rest:
            return  # A step would leave everything bit-identical.
        left_s = dt_s
        while left_s > 0.0:
            steps = math.ceil(left_s / _MAX_STEP_S)
            short = steps <= 1 or self.actuation.settled(self.joints)
            step_s = left_s if short else left_s / steps
            self._step(step_s)
            left_s -= step_s
        self._at_rest = self.actuation.stands(self.joints)

    def measure(self) -> Array:
        """Return the joint vector (..., n) as in `Actuation.measure`."""
        if self._measured is not None:
            return self._measured.copy()
        measured = self.actuation.measure(self.joints)
        if self.actuation.is_exact:
            self._measured = measured.copy()
        return measured

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        rates = self.actuation.rates(self.joints)
        rolling = self.actuation.surface.roll(self.joints)
        return self.actuation.layout.twist(self.kinematics, rolling, rates)

    def hardware_status(self) -> dict[str, object]:
        """Return the actuator status."""
        return self.actuation.hardware_status()

    def _step(self, dt_s: float) -> None:
        moved = self._displacements.get(dt_s)
        if moved is None:
            moved = self._move_joints(dt_s)
        self.pose = self.pose @ moved

    def _move_joints(self, dt_s: float) -> SE2:
        """Move the joints by a step, and return the displacement of the body."""
        before = self.joints.tobytes() + self.actuation.backlash_rad.tobytes()
        nodes = np.empty((3, *self.joints.shape))
        nodes[0] = self.joints
        nodes[1:] = self.actuation.after(self.joints, dt_s * self._halves)
        rolling = self.actuation.surface.roll(nodes)
        moved = SE2.exp(rolling_tangent(self.kinematics, rolling, dt_s, self.actuation.layout))
        self.joints = nodes[2]
        self.actuation.come_to_rest(self.joints)
        if self.joints.tobytes() + self.actuation.backlash_rad.tobytes() != before:
            self._displacements.clear()
            self._measured = None
        elif len(self._displacements) < _CACHED_STEPS:
            self._displacements[dt_s] = moved
        return moved
