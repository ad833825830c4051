"""Servos, speed controllers and motors of a singularity drive: all that any plant is driven by."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives import JointKind, SingularityDrive
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim.esc import SpeedControllers
from tsd_twin.sim.motor import Motors
from tsd_twin.sim.servo import Servos
from tsd_twin.sim.wheel_surface import WheelSurface

_SETTLED = 1e-9
"""Radians and rad/s from the goal at which joints count as being there: some 10 nm/s."""


class Actuation:
    """Turns set-points into goals of servos and motors, and joints into measurements.

    `noise` scales the standard deviations of the description: 0 is none, 1 is as described. Gimbal
    angles are noisy each time they are measured; the speed of each wheel is off by a share that
    stays the same for the run. The machine is as its `[calibration]` says, which the robot knows.
    `robot.errors` are those of a built machine, as they are described, and it knows none of them.
    """

    def __init__(
        self,
        robot: SingularityRobot,
        batch: tuple[int, ...],
        seed: int | None,
        noise: float,
        battery_v: float | None,
    ) -> None:
        self.drive: SingularityDrive = robot.kinematics()
        kinds = [joint.kind for joint in self.drive.joints]
        self.angles = np.flatnonzero([kind is JointKind.POSITION for kind in kinds])
        """Indices of the gimbals in the joint vector."""
        self.wheels = np.flatnonzero([kind is JointKind.VELOCITY for kind in kinds])
        """Indices of the wheels in the joint vector."""
        shape = (*batch, len(self.wheels))
        self._trim = robot.trim()
        # Dice of its own: how a machine was built has nothing to do with its noise.
        built = np.random.default_rng(None if seed is None else [seed, 1])
        nominal_v = robot.battery.nominal_v
        off = robot.errors.battery_share * built.standard_normal((*batch, 1))
        given = nominal_v * (1.0 + off) if battery_v is None else battery_v
        self.battery_v: Array = np.broadcast_to(given, off.shape)
        """(..., 1): voltage, of each robot."""
        self.surface = WheelSurface.of(self.drive, robot.errors.layer_m, built, shape)
        self.servos = Servos.of(robot, self.battery_v)
        self.motors = Motors.of(robot)
        self.controllers = SpeedControllers(
            shape, float(self.motors.signals[0]), robot.motor.arming_hold_s
        )
        self._random = np.random.default_rng(seed)
        self._angle_noise_rad = noise * float(np.radians(robot.noise.gimbal_angle_deg))
        spin_errors = noise * robot.noise.spin_share * self._random.standard_normal(shape)
        # The curves were measured at the nominal voltage; a speed controller passes on a share of
        # what the battery has.
        self._speed_share = (
            self.battery_v / nominal_v * (1.0 + spin_errors) * self._trim.scale[self.wheels]
        )
        self._offset = self._trim.offset[self.angles]
        wrong = np.radians(robot.errors.zero_deg)
        self.zero_rad: Array = self._offset + wrong * built.standard_normal(
            (*batch, len(self.angles))
        )
        """(..., 2k): angle at which each gimbal stands when its servo reports 0."""
        self.goals: Array = self.zero_rad.copy()
        """(..., 2k): angles that the servos go for."""
        self.speed_goals: Array = np.zeros(shape)
        """(..., k): speeds that the motors settle at, rad/s."""
        self.play_rad: Array = np.zeros_like(self.goals)
        """(..., 2k): how far the motor of each servo is ahead of its gimbal."""

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, (..., n) in the order of `drive.joints`.

        Wheels turn one way only; a speed of zero or less is zero throttle.

        Raises:
            ValueError: as `checked`.
        """
        told = self._trim.told(self.checked(setpoint))
        self.goals[...] = self.zero_rad + self.servos.goal(told[..., self.angles])
        signal = self.controllers.command(self.motors.signal(told[..., self.wheels]))
        self.speed_goals[...] = self.motors.speed(signal) * self._speed_share

    def checked(self, setpoint: Array) -> Array:
        """Return set-points (..., n), one for each robot.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        joints = len(self.angles) + len(self.wheels)
        return np.broadcast_to(setpoint, (*self.goals.shape[:-1], joints))

    def after(self, joints: Array, elapsed_s: Array) -> Array:
        """Return joints without load at times (m, ..., 1) from now, which the last one becomes."""
        angles, goals = joints[..., self.angles], self.goals
        turning_s, play = self.servos.cross(angles, goals, self.play_rad, elapsed_s)
        self.play_rad = play[-1]
        later = np.empty((len(elapsed_s), *joints.shape))
        later[..., self.angles] = self.servos.after(angles, goals, turning_s)
        speeds = joints[..., self.wheels]
        later[..., self.wheels] = self.motors.after(speeds, self.speed_goals, elapsed_s)
        return later

    def rates(self, joints: Array) -> Array:
        """Return how fast gimbals turn at `joints` (..., n) without load, rad/s; of wheels 0."""
        rates = np.zeros_like(joints)
        speed = self.servos.rate(joints[..., self.angles], self.goals)
        edge_rad = 0.5 * self.servos.backlash_rad
        touches = np.abs(np.copysign(edge_rad, speed) - self.play_rad) <= 1e-12
        rates[..., self.angles] = speed * touches
        return rates

    def settled(self, joints: Array) -> bool:
        """Return whether nothing changes any more."""
        turning = np.abs(self.servos.rate(joints[..., self.angles], self.goals))
        off = np.abs(joints[..., self.wheels] - self.speed_goals)
        slowest = _SETTLED * self.servos.approach_rate_per_s
        return bool(turning.max() < slowest and off.max() < _SETTLED)

    def measure(self, joints: Array) -> Array:
        """Return the joint vector (..., n), its angles as the servos report them: in whole steps.

        Wheel speeds are exact here; whether a robot measures them is for the caller to say.
        """
        measured = joints.copy()
        angles = measured[..., self.angles] - self.zero_rad
        if self._angle_noise_rad > 0.0:
            angles += self._angle_noise_rad * self._random.standard_normal(angles.shape)
        measured[..., self.angles] = self.servos.quantise(angles) + self._offset
        return measured

    def facts(self) -> dict[str, object]:
        """Return voltage, whether the speed controllers are armed, and what pulses they get."""
        return {
            "battery_v": float(self.battery_v.mean()),
            "esc_armed": bool(self.controllers.armed.all()),
            "pulse_us": self.motors.pulse_us(self.controllers.signal).tolist(),
        }
