"""The reference run of Savnani et al. 2019: 5 m/s at once, and 0 from half-way on."""

from __future__ import annotations

import argparse
import math

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.lab import look
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.half_way import Dash, Run, dash
from tsd_twin.lab.look import Axes
from tsd_twin.lab.output import Output
from tsd_twin.lab.virtual_robot import VirtualRobot
from tsd_twin.lie import Array
from tsd_twin.robots import OmniRobot, of_kind
from tsd_twin.sim import SimRobot, simulate


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive a triangle, a trapezoid, and a step that friction cannot give; draw all three."""
    robot = of_kind(robots.load(args.robot), OmniRobot)
    if not (0.0 < args.speed < math.inf and 0.0 < args.acceleration < math.inf):
        raise TwinError("--speed and --acceleration must be above zero, and finite")
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=args.speed,
        acceleration_mps2=args.acceleration,
        deceleration_mps2=args.acceleration,
    )
    robot = msgspec.structs.replace(robot, limits=limits)
    # The shortest way on which the top speed is reached lies between the two.
    reach_m = args.speed**2 / args.acceleration
    runs: dict[str, Run] = {}
    goals = {"triangle": 0.6 * reach_m, "trapezoid": 1.6 * reach_m}
    for name, distance_m in out.progress(goals.items(), "driving", len(goals)):
        virtual = VirtualRobot(robot, SimRobot(robot, noise=args.noise))
        runs[name] = dash(virtual, Dash.of(distance_m, limits))
        out.table(f"omni-step_{name}", runs[name].columns())
    spin = wheel_spin(robot, args.speed)
    out.table("omni-step_unlimited", spin)
    _draw(robot, runs, spin, out)
    late_s = robot.motor.time_constant_s
    lines = [_said(name, each, late_s) for name, each in runs.items()]
    lost = np.max(spin["rim_mps"] - spin["true_mps"])
    return [
        *lines,
        f"unlimited step: rims ahead of the floor by up to {lost:.2f} m/s;"
        f" {spin['true_mps'][-1]:.2f} m/s after {spin['t_s'][-1]:.1f} s",
    ]


def wheel_spin(robot: OmniRobot, speed_mps: float, seconds: float = 1.5) -> dict[str, Array]:
    """Return what a robot does whose wheels are told a speed at once, without any limit."""
    simulation = simulate(robot)
    drive = simulation.drive
    full = np.array([speed_mps, 0.0, 0.0])
    simulation.command(drive.inverse(full))
    rows: list[tuple[float, float, float]] = []
    for i in range(round(seconds / 0.01) + 1):
        rim = drive.forward(simulation.measure()[: len(drive.joints)]).twist[0]
        rows.append((0.01 * i, float(simulation.twist()[0]), float(rim)))
        simulation.advance(0.01)
    t_s, true, rim = np.array(rows).T
    return {"t_s": t_s, "true_mps": true, "rim_mps": rim}


def _said(name: str, each: Run, late_s: float) -> str:
    """Say how a run went; wheels that follow late are late twice, at the start and in braking."""
    goal = each.dash
    late_m = 2.0 * late_s * goal.peak_mps if goal.is_triangle else late_s * goal.peak_mps
    return (
        f"{name}: {goal.distance_m:.2f} m in {goal.duration_s:.2f} s at best, peak"
        f" {each.speed_mps.max():.2f} of {goal.peak_mps:.2f} m/s, braking from"
        f" {goal.brake_at_m:.2f} m; stopped {1000 * each.overshoot_m:+.0f} mm from the end"
        f" ({1000 * late_m:.0f} mm are wheels that follow {1000 * late_s:.0f} ms late)"
    )


def _draw(robot: OmniRobot, runs: dict[str, Run], spin: dict[str, Array], out: Output) -> None:
    figure = look.figure(12.0, 4.2, f"{robot.title}: full speed, and stop")
    *axes, last = figure.subplots(1, 3)
    for on, (name, each) in zip(axes, runs.items(), strict=True):
        _curve(on, each.t_s, each.dash.speed(each.t_s), look.REFERENCE, "ideal", "--")
        _curve(on, each.t_s, each.commanded_mps, look.ESTIMATE, "commanded", ":")
        _curve(on, each.t_s, each.speed_mps, look.TRUTH, "robot")
        look.dress(on, "time (s)", "speed (m/s)", f"{name}, {each.dash.distance_m:.1f} m")
        look.legend(on)
    _curve(last, spin["t_s"], spin["rim_mps"], look.ESTIMATE, "what its wheels say", ":")
    _curve(last, spin["t_s"], spin["true_mps"], look.TRUTH, "robot")
    look.dress(last, "time (s)", "speed (m/s)", "told at once: wheels spin")
    look.legend(last)
    out.picture("omni-step", figure)


def _curve(axes: Axes, t: Array, speed: Array, colour: str, label: str, style: str = "-") -> None:
    axes.plot(t, speed, style, color=colour, linewidth=1.5, label=label)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="omni4", metavar="NAME|FILE", help="default omni4")
    parser.add_argument("--speed", type=float, default=5.0, metavar="M/S", help="default 5")
    parser.add_argument(
        "--acceleration", type=float, default=2.5, metavar="M/S2", help="either way; default 2.5"
    )
    parser.add_argument("--noise", type=float, default=1.0, metavar="SCALE", help="default 1")


EXPERIMENT = Experiment(
    name="omni-step",
    purpose="5 m/s and stop at half-way: velocity against the ideal triangle and trapezoid.",
    run=run,
    examples=["tsd-lab omni-step --out lab", "tsd-lab omni-step --robot mecanum --speed 1.5"],
    add_flags=_flags,
)
