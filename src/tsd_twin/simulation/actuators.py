"""Actuator models of a singularity drive: speed controllers, motors, gimbal servos, printed wheel
surface.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from tsd_twin.kinematics import JointKind, SingularityKinematics
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


_REMEMBERED = 16
"""Number of step lengths that are remembered: steps of 0.01 s differ in their last digits."""


@functools.lru_cache(maxsize=_REMEMBERED)
def _decays(
    rate: float, up_s: float, down_s: float, times_s: tuple[float, ...]
) -> list[list[float]]:
    """Return for each time the decay of a servo, less 1, and those of a motor, up and down."""
    elapsed_s = np.array(times_s)
    decays = np.expm1(-rate * elapsed_s), np.exp(-elapsed_s / up_s), np.exp(-elapsed_s / down_s)
    return np.stack(decays, axis=-1).tolist()


_SETTLED = 1e-9
"""Radians and rad/s from the goal at which joints count as being there: some 10 nm/s."""


class SimulationOptions(TypedDict, total=False):
    """Options of all simulations; by default seed 0, no noise and the nominal battery voltage."""

    seed: int | None
    noise: float
    """Factor on the standard deviations of the description."""
    battery_v: float | None


class Actuation:
    """Turns set-points into goals of servos and motors, and joints into measurements.

    `noise` scales the standard deviations of the description. Measured gimbal angles have noise;
    the speed of each wheel is off by a constant share. The controller knows the `[calibration]` of
    the machine, and none of its `robot.errors`.
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
        # A separate random generator: the errors of construction are independent of the noise.
        built = np.random.default_rng(None if seed is None else [seed, 1])
        nominal_v = robot.battery.nominal_v
        off = robot.errors.battery_share * built.standard_normal((*batch, 1))
        given = nominal_v * (1.0 + off) if battery_v is None else battery_v
        self.battery_v: Array = np.broadcast_to(given, off.shape)
        """(..., 1): voltage, of each robot."""
        self.surface = WheelSurface.of(self.kinematics, robot.errors.layer_m, built, shape)
        self._sound_servos = Servos.of(robot, nominal_v)
        self.servos = Servos.of(robot, self.battery_v)
        self.servo_shares: Array = np.ones((*batch, len(self.angles)))
        """(..., 2k): speed of each servo relative to a sound one."""
        self.motors = Motors.of(robot)
        self.controllers = SpeedControllers(
            shape, float(self.motors.signals[0]), robot.motor.arming_hold_s
        )
        self._random = np.random.default_rng(seed)
        self._angle_noise_rad = noise * float(np.radians(robot.noise.gimbal_angle_deg))
        spin_errors = noise * robot.noise.spin_share * self._random.standard_normal(shape)
        self._nominal_v = nominal_v
        self._sound_share = (1.0 + spin_errors) * self._offsets.scale[self.wheels]
        self._wheel_shares: Array = np.ones(shape)
        self._unloaded: Array = np.zeros(shape)
        """(..., k): speeds by the motor table for the newest signals."""
        self._offset = self._offsets.offset[self.angles]
        wrong = np.radians(robot.errors.zero_deg)
        self.zero_rad: Array = self._offset + wrong * built.standard_normal(
            (*batch, len(self.angles))
        )
        """(..., 2k): angle at which each gimbal stands when its servo reports 0."""
        self.goals: Array = self.zero_rad.copy()
        """(..., 2k): goal angles of the servos."""
        self.speed_goals: Array = np.zeros(shape)
        """(..., k): steady-state speeds of the motors, rad/s."""
        self.play_rad: Array = np.zeros_like(self.goals)
        """(..., 2k): how far the motor of each servo is ahead of its gimbal."""
        self._all_on = False
        """Whether no motor is shut off."""
        self._repeatable: tuple[tuple[int, ...], bytes] | None = None
        """The newest set-point, if it changes nothing when it is given again."""
        self._last_speeds = b""
        """The newest commanded speeds, if they change nothing when they are commanded again."""

    def command(self, setpoint: Array) -> bool:
        """Give all actuators new set-points, (..., n); return whether that can change anything.

        Wheels turn one way only; a speed of zero or less is zero throttle.

        Raises:
            ValueError: as `checked`.
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
        """Take the power of the speed controllers away: no motor is driven, and they arm anew."""
        self.controllers.lose_power()
        self._unloaded[...] = 0.0
        self._set_speed_goals()
        self._repeatable, self._last_speeds = None, b""

    def degrade(self, shares: Array) -> None:
        """Let each joint be slower from now on: `shares` (..., n) of a sound one's speed."""
        shares = np.broadcast_to(shares, (*self.goals.shape[:-1], self._joints))
        self.servo_shares = shares[..., self.angles].copy()
        self._wheel_shares = shares[..., self.wheels].copy()
        self._update_supply()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery from now on."""
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
        self._repeatable = None  # The same set-points now mean another motion.

    def _set_speed_goals(self) -> None:
        # The curves were measured at the nominal voltage.
        share = self.battery_v / self._nominal_v * self._sound_share * self._wheel_shares
        self.speed_goals[...] = self._unloaded * share
        self._all_on = bool(self.speed_goals.all())

    def checked(self, setpoint: Array) -> Array:
        """Set-points (..., n), one for each robot.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        shape = (*self.goals.shape[:-1], self._joints)
        return setpoint if np.shape(setpoint) == shape else np.broadcast_to(setpoint, shape)

    def after(self, joints: Array, elapsed_s: Array) -> Array:
        """Joints without load at times (m, ..., 1) from now, which the last one becomes."""
        if joints.ndim == 1 and (few := self._few_after(joints, elapsed_s)) is not None:
            return few
        angles, goals = joints[..., self.angles], self.goals
        turning_s = elapsed_s
        if not self.servos.are_ideal:
            turning_s, play = self.servos.cross(angles, goals, self.play_rad, elapsed_s)
            self.play_rad = play[-1]
        later = np.empty((len(elapsed_s), *joints.shape))
        modules = later.reshape(*later.shape[:-1], len(self.wheels), 3)
        turned = self.servos.after(angles, goals, turning_s)
        modules[..., :2] = turned.reshape(*turned.shape[:-1], len(self.wheels), 2)
        speeds = joints[..., self.wheels]
        modules[..., 2] = self.motors.after(speeds, self.speed_goals, elapsed_s)
        return later

    def _few_after(self, joints: Array, elapsed_s: Array) -> Array | None:
        """Return `after` of one robot in plain floats: in a third of the time, and the same bits.

        None if a servo is not ideal, slower than a sound one, or at its top speed.
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
        """How fast gimbals turn at `joints` (..., n) without load, rad/s; of wheels 0."""
        rates = np.zeros_like(joints)
        speed = self.servos.rate(joints[..., self.angles], self.goals)
        edge_rad = 0.5 * self.servos.backlash_rad
        touches = np.abs(np.copysign(edge_rad, speed) - self.play_rad) <= 1e-12
        rates[..., self.angles] = speed * touches
        return rates

    def come_to_rest(self, joints: Array) -> None:
        """Put joints (..., n) that are all but at rest there: of modules with motors shut off."""
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
        """Whether what is measured has no noise."""
        return self._angle_noise_rad <= 0.0

    def stands(self, joints: Array) -> bool:
        """Whether all wheels stand and all gimbals are exactly at their goals."""
        return not (
            self._all_on
            or self.speed_goals.any()
            or joints[..., self.wheels].any()
            or (joints[..., self.angles] != self.goals).any()
        )

    def settled(self, joints: Array) -> bool:
        """Whether nothing changes any more."""
        turning = np.abs(self.servos.rate(joints[..., self.angles], self.goals))
        off = np.abs(joints[..., self.wheels] - self.speed_goals)
        slowest = _SETTLED * np.asarray(self.servos.approach_rate_per_s)
        return bool((turning < slowest).all() and off.max() < _SETTLED)

    def measure(self, joints: Array) -> Array:
        """Joint vector (..., n), its angles as the servos report them: in whole steps.

        Wheel speeds are exact here; whether a robot measures them is for the caller to say.
        """
        measured = joints.copy()
        angles = joints.take(self.angles, axis=-1) - self.zero_rad
        if self._angle_noise_rad > 0.0:
            angles += self._angle_noise_rad * self._random.standard_normal(angles.shape)
        measured[..., self.angles] = self.servos.quantise(angles) + self._offset
        return measured

    def hardware_status(self) -> dict[str, object]:
        """Voltage, whether the speed controllers are armed, and what pulses they get."""
        return {
            "battery_v": fmean(self.battery_v.ravel().tolist()),
            "esc_armed": all(self.controllers.armed.ravel().tolist()),
            "pulse_us": self.motors.pulse_us(self.controllers.signal).tolist(),
        }
