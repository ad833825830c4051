"""Experiments `omni-step` and `atlas`: figures of the two papers on other platforms.

`omni-step`: 5 m/s and stop at the midpoint, against the time-optimal profile (Savnani et al. 2019).
`atlas`: error of the ideal kinematics of a sphere on wheels with two rows of rollers, Fig. 7 of
Weiss et al. 2008.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Axes, Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import TwinError
from tsd_twin.kinematics.row_effect import RowEffect, row_effect
from tsd_twin.lie import Array
from tsd_twin.robots import OmniDescription, SphereDescription, description_of_kind
from tsd_twin.simulation import SimRobot, simulate

_SETTLE_S = 1.0
_MAX_S = 120.0


@dataclass(frozen=True, slots=True)
class PointToPointProfile:
    """Time-optimal velocity profile over a distance from rest to rest: triangle or trapezoid.

    Maximum acceleration, then maximum braking from the midpoint (Savnani et al. 2019), with the top
    speed held in between if it is reached.
    """

    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    deceleration_mps2: float

    @property
    def peak_mps(self) -> float:
        """Peak speed: the top speed, or less over a short distance."""
        a, d = self.acceleration_mps2, self.deceleration_mps2
        return min(self.speed_mps, math.sqrt(2.0 * self.distance_m * a * d / (a + d)))

    @property
    def is_triangle(self) -> bool:
        """Whether the top speed is not reached."""
        return self.peak_mps < self.speed_mps

    @property
    def brake_at_m(self) -> float:
        """Position where braking begins; midway for equal acceleration and deceleration."""
        return self.distance_m - self.peak_mps**2 / (2.0 * self.deceleration_mps2)

    @property
    def duration_s(self) -> float:
        """Duration from rest to rest."""
        up, down = self.peak_mps / self.acceleration_mps2, self.peak_mps / self.deceleration_mps2
        held_m = self.distance_m - 0.5 * self.peak_mps * (up + down)
        return up + down + held_m / self.peak_mps

    def speed(self, t_s: Array) -> Array:
        """Return the speed at times `t_s` (...), m/s."""
        rising = self.acceleration_mps2 * t_s
        falling = self.deceleration_mps2 * (self.duration_s - t_s)
        return np.clip(np.minimum(rising, falling), 0.0, self.peak_mps)


@dataclass(frozen=True, slots=True, eq=False)
class ProfileRun:
    """Record of a point-to-point run, with a row per period."""

    profile: PointToPointProfile
    t_s: Array
    distance_m: Array
    speed_mps: Array
    commanded_mps: Array

    @property
    def overshoot_m(self) -> float:
        """Overshoot of the final position; negative if short of the end."""
        return float(self.distance_m[-1]) - self.profile.distance_m

    def columns(self) -> dict[str, Array]:
        """Return the columns of a table."""
        return {
            "t_s": self.t_s,
            "commanded_mps": self.commanded_mps,
            "true_mps": self.speed_mps,
            "ideal_mps": self.profile.speed(self.t_s),
            "distance_m": self.distance_m,
        }


def run_profile(robot: VirtualRobot, profile: PointToPointProfile) -> ProfileRun:
    """Command full speed, then zero from the braking point, using the robot's odometry.

    Commands take effect several periods later, and are sent ahead accordingly.
    """
    full, none = np.array([profile.speed_mps, 0.0, 0.0]), np.zeros(3)
    rows: list[tuple[float, float, float, float]] = []
    braking, left_s = False, _SETTLE_S
    start_s = robot.now_s
    while left_s > 0.0 and robot.now_s - start_s < _MAX_S:
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


def run_omni_step(args: argparse.Namespace, out: Output) -> list[str]:
    """5 m/s and stop at the midpoint: velocity against the ideal triangle and trapezoid."""
    robot = description_of_kind(robots.load_robot(args.robot), OmniDescription)
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=args.speed,
        acceleration_mps2=args.acceleration,
        deceleration_mps2=args.acceleration,
    )
    robot = msgspec.structs.replace(robot, limits=limits)
    # The minimum distance for reaching the top speed lies between the two.
    reach_m = args.speed**2 / args.acceleration
    runs: dict[str, ProfileRun] = {}
    goals = {"triangle": 0.6 * reach_m, "trapezoid": 1.6 * reach_m}
    for name, distance_m in out.progress(goals.items(), "driving", len(goals)):
        virtual = VirtualRobot(robot, SimRobot(robot, noise=args.noise))
        profile = PointToPointProfile(distance_m, args.speed, args.acceleration, args.acceleration)
        runs[name] = run_profile(virtual, profile)
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


def unlimited_step(robot: OmniDescription, speed_mps: float) -> dict[str, Array]:
    """Return the response of a robot to an unlimited step of wheel speed over 1.5 s."""
    simulation = simulate(robot)
    drive = simulation.kinematics
    full = np.array([speed_mps, 0.0, 0.0])
    simulation.command(drive.inverse(full))
    rows: list[tuple[float, float, float]] = []
    for i in range(151):
        rim = drive.forward(simulation.measure()[: len(drive.joints)]).twist[0]
        rows.append((0.01 * i, float(simulation.twist()[0]), float(rim)))
        simulation.advance(0.01)
    t_s, true, rim = np.array(rows).T
    return {"t_s": t_s, "true_mps": true, "rim_mps": rim}


def _run_summary(name: str, each: ProfileRun, late_s: float) -> str:
    """Format a run; the lag of the wheels counts twice, at the start and in braking."""
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


def _omni_step_flags(parser: argparse.ArgumentParser) -> None:
    flags.add(parser, "--speed", "default 5", flags.POSITIVE, 5.0, "M/S")
    flags.add(parser, "--acceleration", "either way", flags.POSITIVE, 2.5, "M/S2")


OMNI_STEP = Experiment(
    "omni-step",
    run_omni_step,
    ["tsd-lab omni-step --out lab", "tsd-lab omni-step --robot mecanum --speed 1.5"],
    robot="omni4",
    noise=True,
    add_own_flags=_omni_step_flags,
)

PAPER_MM = 12.5
_ROUNDING = 1e-6


def run_atlas(args: argparse.Namespace, out: Output) -> list[str]:
    """Fig. 7 of the Atlas paper: ideal against dual-row kinematics over 13 seconds."""
    robot = description_of_kind(robots.load_robot(args.robot), SphereDescription)
    if args.row_distance_mm is not None:
        distance_m = args.row_distance_mm / 1000.0
        geometry = msgspec.structs.replace(robot.drive, row_distance_m=distance_m)
        robot = msgspec.structs.replace(robot, drive=geometry)
        for problem, _ in robot.problems():
            raise TwinError(f"--row-distance-mm {args.row_distance_mm:g}: {problem}")
    effect = row_effect(robot.kinematics())
    out.table("atlas", effect.columns())
    _draw_effect(robot, effect, out)
    angle, share = np.degrees(effect.angle_rad), 100.0 * np.abs(effect.share)
    return [
        f"{robot.title}, rows {1000 * robot.drive.row_distance_m:g} mm apart, inputs of Table 1",
        f"  (the paper has 3.2 deg and 3.8 % for rows {PAPER_MM:g} mm apart):",
        f"  peak angle     {_peak_text(angle, effect.t_s, 'deg')}",
        f"  peak magnitude {_peak_text(share, effect.t_s, '%')}",
    ]


def _peak_text(values: Array, t_s: Array, unit: str) -> str:
    """Format the maximum of `values` and its first time, if it exceeds rounding."""
    peak = float(values.max())
    first = int((values > (1.0 - _ROUNDING) * peak).argmax())
    when = f" at {t_s[first]:.2f} s" if peak > _ROUNDING else ""
    return f"{peak:.2f} {unit}{when}"


def _draw_effect(robot: SphereDescription, effect: RowEffect, out: Output) -> None:
    title = f"{robot.title}: what is left out when a wheel has two rows of rollers"
    figure = experiment.new_figure(10.0, 6.4, title)
    inputs, angle, share = figure.subplots(3, 1, sharex=True, height_ratios=[2, 3, 3])
    for i in range(effect.speeds.shape[1]):
        colour, label = experiment.SERIES_COLOURS[i], f"wheel {i + 1}"
        inputs.plot(effect.t_s, effect.speeds[:, i], color=colour, linewidth=1.2, label=label)
    experiment.label_axes(inputs, "", "speed (rad/s)", "inputs: Table 1, linear in time")
    experiment.add_legend(inputs, ncols=3)
    angle.plot(
        effect.t_s, np.degrees(effect.angle_rad), color=experiment.ESTIMATE_COLOUR, linewidth=1.0
    )
    experiment.label_axes(angle, "", "angle (deg)", "between ideal and true angular velocity")
    share.plot(effect.t_s, 100.0 * effect.share, color=experiment.TRUTH_COLOUR, linewidth=1.0)
    experiment.label_axes(
        share, "time (s)", "magnitude (%)", "by how much the ideal one is too slow"
    )
    out.figure("atlas", figure)


def _atlas_flags(parser: argparse.ArgumentParser) -> None:
    text = "distance of the two rows, instead of that of the file; 0 is an ideal wheel"
    flags.add(parser, "--row-distance-mm", text, flags.number(0.0), metavar="D")


ATLAS = Experiment(
    "atlas",
    run_atlas,
    ["tsd-lab atlas --out lab", "tsd-lab atlas --row-distance-mm 0"],
    robot="atlas",
    add_own_flags=_atlas_flags,
)
