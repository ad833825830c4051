"""Singularity drives in virtual time: one, or a batch in lockstep."""

from __future__ import annotations

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim.esc import SpeedControllers
from tsd_twin.sim.motor import Motors
from tsd_twin.sim.plant import KinematicPlant
from tsd_twin.sim.servo import Servos

_LONGEST_STEP_S = 0.02
"""The approach of the servos, some 30 per second, is a smooth curve over this."""
_SETTLED = 1e-9
"""Radians and rad/s from the goal at which joints count as being there: some 10 nm/s."""


class SingularitySimulation:
    """`batch` robots of one description, all at the same virtual time; `()` is a single one.

    Servos, speed controllers and motors feed a kinematic plant. `noise` scales the standard
    deviations of the description: 0 is none, 1 is as described. Gimbal angles are noisy each time
    they are measured; the speed of each wheel is off by a share that stays the same for the run.
    """

    def __init__(
        self,
        robot: SingularityRobot,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SE2 | None = None,
    ) -> None:
        self.drive = robot.kinematics()
        kinds = [joint.kind for joint in self.drive.joints]
        self._angles = np.flatnonzero([kind is JointKind.POSITION for kind in kinds])
        self._wheels = np.flatnonzero([kind is JointKind.VELOCITY for kind in kinds])
        wheels = (*batch, len(self._wheels))
        self.battery_v = robot.battery.nominal_v if battery_v is None else battery_v
        self.servos = Servos.of(robot, self.battery_v)
        self.motors = Motors.of(robot)
        self.controllers = SpeedControllers(
            wheels, float(self.motors.signals[0]), robot.motor.arming_hold_s
        )
        self._plant = KinematicPlant(self.drive)
        self._random = np.random.default_rng(seed)
        self._angle_noise_rad = noise * float(np.radians(robot.noise.gimbal_angle_deg))
        spin_errors = noise * robot.noise.spin_share * self._random.standard_normal(wheels)
        # The curves were measured at the nominal voltage; a speed controller passes on a share of
        # what the battery has.
        self._speed_share = self.battery_v / robot.battery.nominal_v * (1.0 + spin_errors)
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self.joints: Array = np.zeros((*batch, len(kinds)))
        """(..., n): true joint vector."""
        self._goals = np.zeros((*batch, len(self._angles)))
        self._speed_goals = np.zeros(wheels)
        self._halves = np.array([0.5, 1.0]).reshape(2, *(1,) * (len(batch) + 1))

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, (..., n) in the order of `drive.joints`.

        Wheels turn one way only; a speed of zero or less is zero throttle.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        setpoint = np.broadcast_to(setpoint, self.joints.shape)
        self._goals[...] = self.servos.goal(setpoint[..., self._angles])
        signal = self.controllers.command(self.motors.signal(setpoint[..., self._wheels]))
        self._speed_goals[...] = self.motors.speed(signal) * self._speed_share

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass: in short steps while joints move, in one when all are still."""
        self.controllers.advance(dt_s)
        left_s = dt_s
        while left_s > 0.0:
            steps = np.ceil(left_s / _LONGEST_STEP_S)
            step_s = left_s if steps <= 1.0 or self._settled() else left_s / float(steps)
            self._step(step_s)
            left_s -= step_s

    def measure(self) -> Array:
        """Return the joint vector (..., n), its angles as the servos report them: in whole steps.

        Wheel speeds are exact here; whether a robot measures them is for the caller to say.
        """
        measured = self.joints.copy()
        angles = measured[..., self._angles]
        if self._angle_noise_rad > 0.0:
            angles += self._angle_noise_rad * self._random.standard_normal(angles.shape)
        measured[..., self._angles] = self.servos.quantise(angles)
        return measured

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        rates = np.zeros_like(self.joints)
        rates[..., self._angles] = self.servos.rate(self.joints[..., self._angles], self._goals)
        return self.drive.forward(self.joints, rates).twist

    def facts(self) -> dict[str, object]:
        """Return voltage, whether the speed controllers are armed, and what pulses they get."""
        return {
            "battery_v": self.battery_v,
            "esc_armed": bool(self.controllers.armed.all()),
            "pulse_us": self.motors.pulse_us(self.controllers.signal).tolist(),
        }

    def _settled(self) -> bool:
        angle_errors = np.abs(self.joints[..., self._angles] - self._goals)
        speed_errors = np.abs(self.joints[..., self._wheels] - self._speed_goals)
        return bool(angle_errors.max() < _SETTLED and speed_errors.max() < _SETTLED)

    def _step(self, dt_s: float) -> None:
        elapsed_s = dt_s * self._halves
        nodes = np.empty((3, *self.joints.shape))
        nodes[0] = self.joints
        nodes[1:, ..., self._angles] = self.servos.after(
            self.joints[..., self._angles], self._goals, elapsed_s
        )
        nodes[1:, ..., self._wheels] = self.motors.after(
            self.joints[..., self._wheels], self._speed_goals, elapsed_s
        )
        self.pose = self._plant.move(self.pose, nodes, dt_s)
        self.joints = nodes[2]
