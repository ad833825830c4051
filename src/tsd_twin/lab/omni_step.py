"""Experiment `omni-step`: 5 m/s and stop at half-way, against the time-optimal profile (Savnani et
al. 2019).
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin import experiment, flag_types, robots
from tsd_twin.client.simulated import PERIOD_S, VirtualRobot
from tsd_twin.experiment import Axes, Experiment, Output
from tsd_twin.lie import Array
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.robots.description import Limits
from tsd_twin.simulation import SimRobot, simulate

_SETTLE_S = 1.0
_LONGEST_S = 120.0


@dataclass(frozen=True, slots=True)
class PointToPointProfile:
    """Time-optimal velocity profile over a distance from rest to rest: triangle or trapezoid.

    Half-way at the limit of acceleration and half braking (Savnani et al. 2019), with the top speed
    held in between when it is reached.
    """

    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    deceleration_mps2: float

    @staticmethod
    def of(distance_m: float, limits: Limits) -> PointToPointProfile:
        """Profile over `distance_m` within these limits."""
        a, d = limits.acceleration_mps2, limits.deceleration_mps2
        return PointToPointProfile(distance_m, limits.speed_mps, a, d)

    @property
    def peak_mps(self) -> float:
        """Highest speed: the top speed, or less over a short distance."""
        a, d = self.acceleration_mps2, self.deceleration_mps2
        return min(self.speed_mps, math.sqrt(2.0 * self.distance_m * a * d / (a + d)))

    @property
    def is_triangle(self) -> bool:
        """Whether the top speed is not reached."""
        return self.peak_mps < self.speed_mps

    @property
    def brake_at_m(self) -> float:
        """Distance at which braking begins; half-way for equal acceleration and deceleration."""
        return self.distance_m - self.peak_mps**2 / (2.0 * self.deceleration_mps2)

    @property
    def duration_s(self) -> float:
        """Duration from rest to rest."""
        up, down = self.peak_mps / self.acceleration_mps2, self.peak_mps / self.deceleration_mps2
        held_m = self.distance_m - 0.5 * self.peak_mps * (up + down)
        return up + down + held_m / self.peak_mps

    def speed(self, t_s: Array) -> Array:
        """Speed at times `t_s` (...), m/s."""
        rising = self.acceleration_mps2 * t_s
        falling = self.deceleration_mps2 * (self.duration_s - t_s)
        return np.clip(np.minimum(rising, falling), 0.0, self.peak_mps)


@dataclass(frozen=True, slots=True, eq=False)
class ProfileRun:
    """Record of a point-to-point run, a row for each period."""

    profile: PointToPointProfile
    t_s: Array
    distance_m: Array
    speed_mps: Array
    commanded_mps: Array

    @property
    def overshoot_m(self) -> float:
        """Overshoot of the final position; negative is short of the end."""
        return float(self.distance_m[-1]) - self.profile.distance_m

    def columns(self) -> dict[str, Array]:
        """Columns of a table."""
        return {
            "t_s": self.t_s,
            "commanded_mps": self.commanded_mps,
            "true_mps": self.speed_mps,
            "ideal_mps": self.profile.speed(self.t_s),
            "distance_m": self.distance_m,
        }


def run_profile(robot: VirtualRobot, profile: PointToPointProfile) -> ProfileRun:
    """Command full speed, then zero from the braking point on, by the robot's own odometry.

    Commands take effect a number of periods later, and are given as many ahead.
    """
    full, none = np.array([profile.speed_mps, 0.0, 0.0]), np.zeros(3)
    rows: list[tuple[float, float, float, float]] = []
    braking, left_s = False, _SETTLE_S
    start_s = robot.now_s
    while left_s > 0.0 and robot.now_s - start_s < _LONGEST_S:
        speed = float(robot.true_twist[0])
        rows.append(
            (
                robot.now_s - start_s,
                float(robot.truth.xy_heading[0]),
                speed,
                robot.controller.twist[0],
            )
        )
        odometry = robot.odometry()
        ahead_m = float(odometry.xy_heading[0] + odometry.twist[0] * PERIOD_S)
        braking = braking or ahead_m >= profile.brake_at_m
        robot.drive(none if braking else full)
        if braking and not robot.controller.twist.any():
            left_s -= PERIOD_S
    t_s, distance_m, speed_mps, commanded_mps = np.array(rows).T
    return ProfileRun(profile, t_s, distance_m, speed_mps, commanded_mps)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """5 m/s and stop at half-way: velocity against the ideal triangle and trapezoid."""
    robot = description_of_kind(robots.load_robot(args.robot), OmniDescription)
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=args.speed,
        acceleration_mps2=args.acceleration,
        deceleration_mps2=args.acceleration,
    )
    robot = msgspec.structs.replace(robot, limits=limits)
    # The shortest distance on which the top speed is reached lies between the two.
    reach_m = args.speed**2 / args.acceleration
    runs: dict[str, ProfileRun] = {}
    goals = {"triangle": 0.6 * reach_m, "trapezoid": 1.6 * reach_m}
    for name, distance_m in out.progress(goals.items(), "driving", len(goals)):
        virtual = VirtualRobot(robot, SimRobot(robot, noise=args.noise))
        runs[name] = run_profile(virtual, PointToPointProfile.of(distance_m, limits))
        out.table(f"omni-step_{name}", runs[name].columns())
    spin = unlimited_step(robot, args.speed)
    out.table("omni-step_unlimited", spin)
    _draw(robot, runs, spin, out)
    late_s = robot.motor.time_constant_s
    lines = [_run_summary(name, each, late_s) for name, each in runs.items()]
    lost = np.max(spin["rim_mps"] - spin["true_mps"])
    return [
        *lines,
        f"unlimited step: rims ahead of the floor by up to {lost:.2f} m/s;"
        f" {spin['true_mps'][-1]:.2f} m/s after {spin['t_s'][-1]:.1f} s",
    ]


def unlimited_step(
    robot: OmniDescription, speed_mps: float, seconds: float = 1.5
) -> dict[str, Array]:
    """Response of a robot to a step of wheel speed without limits."""
    simulation = simulate(robot)
    drive = simulation.kinematics
    full = np.array([speed_mps, 0.0, 0.0])
    simulation.command(drive.inverse(full))
    rows: list[tuple[float, float, float]] = []
    for i in range(round(seconds / 0.01) + 1):
        rim = drive.forward(simulation.measure()[: len(drive.joints)]).twist[0]
        rows.append((0.01 * i, float(simulation.twist()[0]), float(rim)))
        simulation.advance(0.01)
    t_s, true, rim = np.array(rows).T
    return {"t_s": t_s, "true_mps": true, "rim_mps": rim}


def _run_summary(name: str, each: ProfileRun, late_s: float) -> str:
    """Return a text of a run; the lag of the wheels counts twice, at the start and in braking."""
    goal = each.profile
    late_m = 2.0 * late_s * goal.peak_mps if goal.is_triangle else late_s * goal.peak_mps
    return (
        f"{name}: {goal.distance_m:.2f} m in {goal.duration_s:.2f} s at best, peak"
        f" {each.speed_mps.max():.2f} of {goal.peak_mps:.2f} m/s, braking from"
        f" {goal.brake_at_m:.2f} m; stopped {1000 * each.overshoot_m:+.0f} mm from the end"
        f" ({1000 * late_m:.0f} mm are wheels that follow {1000 * late_s:.0f} ms late)"
    )


def _draw(
    robot: OmniDescription, runs: dict[str, ProfileRun], spin: dict[str, Array], out: Output
) -> None:
    figure = experiment.new_figure(12.0, 4.2, f"{robot.title}: full speed, and stop")
    *axes, last = figure.subplots(1, 3)
    for on, (name, each) in zip(axes, runs.items(), strict=True):
        _plot_speed(
            on, each.t_s, each.profile.speed(each.t_s), experiment.REFERENCE_COLOUR, "ideal", "--"
        )
        _plot_speed(on, each.t_s, each.commanded_mps, experiment.ESTIMATE_COLOUR, "commanded", ":")
        _plot_speed(on, each.t_s, each.speed_mps, experiment.TRUTH_COLOUR, "robot")
        experiment.label_axes(
            on, "time (s)", "speed (m/s)", f"{name}, {each.profile.distance_m:.1f} m"
        )
        experiment.add_legend(on)
    _plot_speed(
        last, spin["t_s"], spin["rim_mps"], experiment.ESTIMATE_COLOUR, "by its wheels", ":"
    )
    _plot_speed(last, spin["t_s"], spin["true_mps"], experiment.TRUTH_COLOUR, "robot")
    experiment.label_axes(last, "time (s)", "speed (m/s)", "step without limits: wheels spin")
    experiment.add_legend(last)
    out.figure("omni-step", figure)


def _plot_speed(
    axes: Axes, t: Array, speed: Array, colour: str, label: str, style: str = "-"
) -> None:
    axes.plot(t, speed, style, color=colour, linewidth=1.5, label=label)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--speed", type=flag_types.POSITIVE, default=5.0, metavar="M/S", help="default 5"
    )
    parser.add_argument(
        "--acceleration",
        type=flag_types.POSITIVE,
        default=2.5,
        metavar="M/S2",
        help="either way; default 2.5",
    )


EXPERIMENT = Experiment(
    "omni-step",
    run,
    ["tsd-lab omni-step --out lab", "tsd-lab omni-step --robot mecanum --speed 1.5"],
    robot="omni4",
    noise=True,
    add_own_flags=_flags,
)
