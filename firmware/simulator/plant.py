# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated motors, gimbals and wheels, from `tsd_twin.simulation`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware.simulator.mx64 import Mx64
from firmware.simulator.power import PowerSimulation
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import SingularitySimulation

_ANGLES = np.array([0, 1, 3, 4, 6, 7])
_WHEELS = np.array([2, 5, 8])


class RobotPlant:
    """Simulated robot driven by servo goals and speed-controller pulses.

    `neutral` contains the servo positions at neutral, in steps, and `reverse` the reversed servos,
    as in the firmware's setup.
    """

    def __init__(
        self, robot: SingularityDescription, neutral: Sequence[int], reverse: Sequence[bool]
    ) -> None:
        # Without model errors, because tests compare positions with goals to the step.
        self.simulation = SingularitySimulation(robot.with_errors(0.0))
        self._neutral = np.array(neutral)
        self._sign = np.where(reverse, -1.0, 1.0)
        self._step_rad = self.simulation.actuation.servos.step_rad
        self._now_s = 0.0
        self._wheels = np.zeros(3)
        self._commands: tuple[float, ...] = ()
        self._joints: Array | None = None
        """Latest joints; the simulation replaces them when they move."""
        self._driven = True
        self._signal_s = 0.0
        self.stuck: set[int] = set()
        """Wheels that do not turn."""

    @property
    def gimbals(self) -> Array:
        """(6,): angles from neutral, radians."""
        return self.simulation.joints[_ANGLES]

    @property
    def wheel_speeds(self) -> Array:
        """(3,): speeds of the wheels, rad/s."""
        return self.simulation.joints[_WHEELS]

    @property
    def pose(self) -> SE2:
        """Pose in the world."""
        return self.simulation.pose

    @property
    def driven(self) -> bool:
        """Whether any wheel is driven."""
        return bool(self.simulation.actuation.speed_goals.any())

    def follow(
        self,
        now_s: float,
        servos: Sequence[Mx64],
        pulses_us: Sequence[float],
        power: PowerSimulation,
    ) -> None:
        """Advance to `now_s`, then apply the goals and update the servo positions.

        A pulse width of 0 means no pulse; the speed controllers keep driving until their signal
        timeout.
        """
        self.simulation.advance(now_s - self._now_s)
        self._now_s = now_s
        joints = self.simulation.joints
        goals = [
            servo.goal if servo.torque and servo.answers and not servo.jammed else None
            for servo in servos
        ]
        if min(pulses_us) > 0.0:
            self._signal_s = now_s
        driven = power.driven and now_s - self._signal_s <= power.wiring.signal_timeout_s
        if driven != self._driven:
            self._driven = driven
            self.simulation.lose_drive()
        commands = (*goals, *pulses_us, driven, *self.stuck)
        if commands == self._commands and joints is self._joints:
            return
        self._joints, angles = joints, self.gimbals
        if commands != self._commands:
            self._commands = commands
            self._command(goals, angles, pulses_us)
        rates = self.simulation.actuation.servos.rate(angles, self._goals)
        steps = np.round(self._neutral + self._sign * angles / self._step_rad)
        for servo, position, rate in zip(servos, steps, self._sign * rates, strict=True):
            servo.position = int(position)
            servo.velocity_steps_per_s = rate / self._step_rad

    def _command(
        self, goals: Sequence[int | None], angles: Array, pulses_us: Sequence[float]
    ) -> None:
        self._goals = np.array(
            [
                angle if goal is None else sign * (goal - neutral) * self._step_rad
                for goal, angle, sign, neutral in zip(
                    goals, angles, self._sign, self._neutral, strict=True
                )
            ]
        )
        setpoint = np.zeros(9)
        setpoint[_ANGLES] = self._goals
        setpoint[_WHEELS] = self._speeds(np.array(pulses_us)) * self._driven
        if min(pulses_us) == 0.0:  # Without a signal, keep the speeds and do not start.
            setpoint[_WHEELS] = self._wheels if self._driven else 0.0
        self._wheels = setpoint[_WHEELS]
        setpoint[_WHEELS[list(self.stuck)]] = 0.0
        self.simulation.command(setpoint)

    def _speeds(self, pulses_us: Array) -> Array:
        motors = self.simulation.actuation.motors
        low_us, high_us = motors.pulses_us
        first, last = motors.signals[0], motors.signals[-1]
        share = np.clip((pulses_us - low_us) / (high_us - low_us), 0.0, 1.0)
        # Controllers ignore pulses within 1 us of zero throttle.
        share[pulses_us < low_us + 1.0] = 0.0
        return motors.speed(first + share * (last - first))
