"""Study `budget`: error budget of the open-loop square, by error source and in total."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import reduce
from operator import add
from typing import Any, TypeAlias

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lab import motors, tracking
from tsd_twin.lab.observer import Slip
from tsd_twin.lab.square import THESIS_ROBOT, THESIS_SHARE, unlimited_trajectory
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.routes import Route
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.simulation import Servos, WheelSurface, rolling_tangent

STEP_S = 0.01
_SETTLE_S = 0.5
_NO_LAG = 1e6
"""Speed limit, rad/s, and approach rate, 1/s, of servos without lag."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSet:
    """Error parameters of n robots; all default to zero."""

    speed_scale_error: Array
    """(n, k): relative error of each wheel speed."""
    zero_rad: Array
    """(n, g): zero offset of each gimbal."""
    step_rad: float = 0.0
    """Resolution of gimbal setpoints; 0 is continuous."""
    lag: float = 0.0
    """1: gimbals follow with servo lag; 0: without lag."""
    dead_band_rad: float = 0.0
    """Dead band of the gimbal servos."""
    backlash_rad: float = 0.0
    """Backlash crossed by the motor after a reversal; no effect without lag."""
    delay_s: float = 0.0
    """Delay of the commands."""
    layer_m: float = 0.0
    """Layer height of the printed wheel surface."""
    phase_rad: float | Array = 0.0
    """(n, k): phase of the first layer of each wheel."""
    slip: float = 0.0
    """1: wheels slip with the described friction; 0: pure rolling."""

    def __add__(self, other: ErrorSet) -> ErrorSet:
        """Add two error sets."""
        return ErrorSet(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(ErrorSet)))

    def part(self, rows: slice) -> ErrorSet:
        """Return the errors of a slice of the robots."""
        phase = self.phase_rad
        phase = phase[rows] if isinstance(phase, np.ndarray) else phase
        return replace(
            self,
            speed_scale_error=self.speed_scale_error[rows],
            zero_rad=self.zero_rad[rows],
            phase_rad=phase,
        )


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoopErrors:
    """Position errors of n open-loop runs, metres."""

    rms_m: Array
    """(n,): RMS distance to the reference at the same time."""
    worst_m: Array
    """(n,): maximum distance."""
    closure_m: Array
    """(n,): distance at the end."""
    line_m: Array
    """(n,): maximum distance from the path's line, the only error visible in an XY plot."""
    speed_mps: Array
    """(n,): mean speed in the second halves of the sides, after the slip of the corners."""
    turned_rad: Array
    """(n,): maximum change of the heading along a side."""


def drive_open_loop(
    robot: SingularityDescription, trajectory: Trajectory, errors: ErrorSet
) -> OpenLoopErrors:
    """Simulate the trajectory open loop, all robots in lockstep.

    Wheels start at speed. Each period's command is the reference at its midpoint.
    """
    drive: Kinematics[SE2] = robot.kinematics()
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    servos = _servos_with(robot, errors)
    runs = len(errors.speed_scale_error)
    surface = WheelSurface(
        robot.kinematics(), errors.layer_m, np.zeros((runs, 1)) + errors.phase_rad
    )
    slip = Slip(robot, (runs,)) if errors.slip > 0.0 else None
    steps = round((trajectory.duration_s + _SETTLE_S) / STEP_S)
    t_s: Array = STEP_S * np.arange(steps, dtype=np.float64)
    setpoints = drive.inverse(trajectory.at(t_s + 0.5 * STEP_S).twist)
    goals = setpoints[:, is_angle]
    if errors.step_rad > 0.0:
        goals = np.round(goals / errors.step_rad) * errors.step_rad
    # The model is time-invariant, so a delayed robot has the state of the earlier time.
    references = trajectory.at(t_s + STEP_S + errors.delay_s).pose[:, :2]
    nodes = np.empty((3, runs, len(is_angle)))
    nodes[..., ~is_angle] = setpoints[0, ~is_angle] * (1.0 + errors.speed_scale_error)
    play = np.zeros_like(errors.zero_rad)
    angles, pose = errors.zero_rad.copy(), SE2(np.tile(trajectory.at(0.0).pose, (runs, 1)))
    squared, worst, error_m, off_line = (np.zeros(runs) for _ in range(4))
    route = trajectory.route
    corners = route.at(np.array([0.0, *route.breaks_m, route.length_m])).pose[:, :2]
    sides = len(corners) - 1
    speeds, headings = np.zeros((steps, runs)), np.zeros((steps, runs))
    halves = np.array([0.5, 1.0])[:, None, None] * STEP_S
    for step, (goal, reference_xy) in enumerate(zip(goals, references, strict=True)):
        aim = goal + errors.zero_rad
        if servos is None:
            nodes[:, :, is_angle] = aim
        else:
            nodes[0][:, is_angle] = angles
            turning_s, plays = servos.cross(angles, aim, play, halves)
            nodes[1:, :, is_angle] = servos.after(angles, aim, turning_s)
            play = plays[1]
        angles = nodes[2][:, is_angle]
        tangent = rolling_tangent(drive, surface.roll(nodes), STEP_S)
        if slip is not None:
            before = slip.twist
            tangent = 0.5 * STEP_S * (before + slip.advance(tangent / STEP_S, STEP_S, 2))
        pose = pose @ SE2.exp(tangent)
        speeds[step] = np.hypot(tangent[:, 0], tangent[:, 1]) / STEP_S
        headings[step] = pose.xy_heading[:, 2]
        off_line = np.maximum(off_line, _distance_from_lines(pose.xy_heading[:, :2], corners))
        error = pose.xy_heading[:, :2] - reference_xy
        error_m = np.hypot(error[:, 0], error[:, 1])
        squared += error_m * error_m
        worst = np.maximum(worst, error_m)
    side = round(trajectory.duration_s / sides / STEP_S)
    by_side = np.s_[: sides * side]
    straight = speeds[by_side].reshape(sides, side, runs)[:, side // 2 :]
    turned = np.ptp(headings[by_side].reshape(sides, side, runs), axis=1)
    return OpenLoopErrors(
        np.sqrt(squared / steps),
        worst,
        error_m,
        off_line,
        straight.mean(axis=(0, 1)),
        turned.max(axis=0),
    )


def _distance_from_lines(xy: Array, corners: Array) -> Array:
    """Return the distances (n,) of points (n, 2) from the lines between corners (c, 2)."""
    starts, sides = corners[:-1], np.diff(corners, axis=0)
    off = xy[:, None] - starts
    along = (off * sides).sum(axis=-1) / np.square(sides).sum(axis=-1)
    off -= np.clip(along, 0.0, 1.0)[..., None] * sides
    return np.hypot(off[..., 0], off[..., 1]).min(axis=1)


def _servos_with(robot: SingularityDescription, errors: ErrorSet) -> Servos | None:
    """Return the servo model with these errors, or None for gimbals without lag."""
    play = {"dead_band_rad": errors.dead_band_rad, "backlash_rad": errors.backlash_rad}
    servos = replace(Servos.of(robot, robot.battery.nominal_v), **play)
    if errors.lag > 0.0:
        return servos
    if errors.dead_band_rad == 0.0:
        return None
    return replace(servos, speed_limit_rad_per_s=_NO_LAG, approach_rate_per_s=_NO_LAG)


DrawErrors: TypeAlias = Callable[[SingularityDescription, np.random.Generator, int], ErrorSet]


@dataclass(frozen=True, slots=True)
class ErrorSource:
    """Error source: name, size with its reference, and random generator."""

    name: str
    size: str
    draw: DrawErrors


def _no_errors(robot: SingularityDescription, runs: int) -> ErrorSet:
    return ErrorSet(
        np.zeros((runs, robot.drive.modules)), np.zeros((runs, 2 * robot.drive.modules))
    )


def _same_for_all(given: Callable[[SingularityDescription], dict[str, float]]) -> DrawErrors:
    """Return a generator of errors that depend only on the description."""
    return lambda robot, _random, runs: replace(_no_errors(robot, runs), **given(robot))


def _draw_zero(robot: SingularityDescription, random: np.random.Generator, runs: int) -> ErrorSet:
    none, sigma = _no_errors(robot, runs), np.radians(robot.errors.zero_deg)
    return replace(none, zero_rad=sigma * random.standard_normal(none.zero_rad.shape))


def _draw_spin(robot: SingularityDescription, random: np.random.Generator, runs: int) -> ErrorSet:
    none = _no_errors(robot, runs)
    share = robot.noise.speed_scale_sigma * random.standard_normal(none.speed_scale_error.shape)
    return replace(none, speed_scale_error=share)


def _draw_line(robot: SingularityDescription, _random: np.random.Generator, runs: int) -> ErrorSet:
    none = _no_errors(robot, runs)
    return replace(none, speed_scale_error=none.speed_scale_error + spin_error_of_line(robot))


def _draw_battery(
    robot: SingularityDescription, random: np.random.Generator, runs: int
) -> ErrorSet:
    none = _no_errors(robot, runs)
    share = robot.errors.battery_share * random.standard_normal((runs, 1))
    return replace(none, speed_scale_error=none.speed_scale_error + share)


def _draw_motor(robot: SingularityDescription, random: np.random.Generator, runs: int) -> ErrorSet:
    none = _no_errors(robot, runs)
    share = robot.errors.motor_share * random.standard_normal((runs, 1))
    return replace(none, speed_scale_error=none.speed_scale_error + share)


def _draw_layers(robot: SingularityDescription, random: np.random.Generator, runs: int) -> ErrorSet:
    none = _no_errors(robot, runs)
    phase = random.uniform(0.0, 2.0 * np.pi, none.speed_scale_error.shape)
    return replace(none, layer_m=robot.errors.layer_m, phase_rad=phase)


def spin_error_of_line(robot: SingularityDescription) -> Array:
    """Return the relative speed error (k,) of motors driven by the line of Table 2.

    The signal comes from the line through all rows, as in the thesis, and the speed from the table.
    """
    signal: Array = np.array(robot.motor.signal)
    rpm: Array = np.array(robot.motor.speed_rpm)
    line = motors.fit_lines(signal, rpm, np.ones(len(signal), dtype=bool))
    wanted = robot.drive.cruise_speed_rpm
    given: Array = (wanted - line.offset) / line.slope
    turns = np.empty(len(rpm))
    for i, row in enumerate(rpm):
        turns[i] = np.interp(given[i], signal, row)
    return turns / wanted - 1.0


MOTOR_LINE = ErrorSource(
    "line of Table 2", "spin of each motor by the line, not the table", _draw_line
)
"""Avoidable calibration error: simulator and controller use the table instead."""
ERROR_SOURCES = (
    ErrorSource(
        "lag of the servos",
        "[servo]: 32 per s, 63 rpm (MX-64)",
        _same_for_all(lambda _: {"lag": 1.0}),
    ),
    ErrorSource(
        "lag, and play",
        "[errors]: 0.33 deg (Robotis e-Manual)",
        _same_for_all(
            lambda robot: {"lag": 1.0, "backlash_rad": math.radians(robot.errors.backlash_deg)}
        ),
    ),
    ErrorSource(
        "dead band",
        "[errors]: 0.044 deg, half a step",
        _same_for_all(lambda robot: {"dead_band_rad": math.radians(robot.errors.dead_band_deg)}),
    ),
    ErrorSource(
        "steps of the servos",
        "[servo]: 4,096 a turn (MX-64)",
        _same_for_all(lambda robot: {"step_rad": 2.0 * np.pi / robot.servo.steps_per_turn}),
    ),
    ErrorSource(
        "delay of the bus",
        "[errors]: 5 ms (as modelled for the bridge)",
        _same_for_all(lambda robot: {"delay_s": robot.errors.delay_s}),
    ),
    ErrorSource("spin of each wheel", "[noise]: 1 %", _draw_spin),
    ErrorSource("battery", "[errors]: 3 %, all wheels alike (assumed)", _draw_battery),
    ErrorSource(
        "gimbal zero", "[errors]: 95 % creep less than an inch in 30 s (thesis)", _draw_zero
    ),
    ErrorSource("printed layers", "[errors]: 0.2 mm", _draw_layers),
    ErrorSource(
        "slip on the floor",
        "[floor]: friction 0.8 (assumed)",
        _same_for_all(lambda _: {"slip": 1.0}),
    ),
    ErrorSource("motor table", "[errors]: 4 %, all wheels alike (Table 1)", _draw_motor),
)


_ALL_SOURCES = "all of these"
BATCH = 1000
"""Batch size of robots, so that their arrays fit into the CPU cache."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Error budget of the open-loop square: each source alone, and all together."""
    robot = description_of_kind(robots.load_robot(args.robot), SingularityDescription)
    cases = {source.name: [source] for source in ERROR_SOURCES}
    variants = _variants(robot)
    cases |= {
        _ALL_SOURCES: list(ERROR_SOURCES),
        **{name: list(ERROR_SOURCES) for name in variants},
        MOTOR_LINE.name: [MOTOR_LINE],
        "all and the line": [*ERROR_SOURCES, MOTOR_LINE],
    }
    runs = {
        name: args.runs if len(used) > 1 and name not in variants else max(1, args.runs // 10)
        for name, used in cases.items()
    }
    jobs = [(name, at) for name in cases for at in range(0, runs[name], BATCH)]
    random = np.random.default_rng(args.seed)
    errors = {
        name: drawn_errors(variants.get(name, robot), random, used, runs[name])
        for name, used in cases.items()
    }
    trajectory = unlimited_trajectory(Route(tracking.named_path("square")))
    found: dict[str, list[OpenLoopErrors]] = {name: [] for name in cases}
    for name, at in out.progress(jobs, "driving squares", len(jobs)):
        part = errors[name].part(slice(at, at + BATCH))
        found[name].append(drive_open_loop(variants.get(name, robot), trajectory, part))
    worst, off_line = (
        {
            name: 100.0 * np.concatenate([getattr(outcome, key) for outcome in outcomes])
            for name, outcomes in found.items()
        }
        for key in ("worst_m", "line_m")
    )
    middle, high, line_middle, line_high = (
        {name: float(np.quantile(values, share)) for name, values in of.items()}
        for of in (worst, off_line)
        for share in (0.5, 0.95)
    )
    out.table(
        "budget",
        {
            "source": list(worst),
            "size": ["; ".join(source.size for source in used) for used in cases.values()],
            "runs": [len(values) for values in worst.values()],
            "median_percent": list(middle.values()),
            "p95_percent": list(high.values()),
            "line_median_percent": list(line_middle.values()),
            "line_p95_percent": list(line_high.values()),
        },
    )
    of_thesis = args.robot == THESIS_ROBOT
    _draw_budget(off_line, line_middle, line_high, out, of_thesis=of_thesis)
    lines = [
        "largest error of position on the open-loop square, % of the side (median, 95 of 100):",
        f"  {'':20} {'in time':>11} {'from the line':>15}",
    ]
    lines += [
        f"  {name:20} {middle[name]:5.1f} {high[name]:5.1f}"
        f" {line_middle[name]:9.1f} {line_high[name]:5.1f}"
        for name in worst
    ]
    if of_thesis:
        lines.append(
            f"  the thesis reports at most {100 * THESIS_SHARE:.0f}, read off a plot of y against "
            "x: that is from the line"
        )
    return lines


def _variants(robot: SingularityDescription) -> dict[str, SingularityDescription]:
    """Return robots for unknown values: floor friction, wheel speed."""
    measured = with_exact_motor_table(robot)
    made: dict[str, SingularityDescription] = {}
    for friction in (0.5, 0.35, 0.2):
        floor = msgspec.structs.replace(robot.floor, friction=friction)
        made[f"all, friction {friction:g}"] = msgspec.structs.replace(robot, floor=floor)
    for share in (1.5, 2.0):
        rpm = share * robot.drive.cruise_speed_rpm
        drive = msgspec.structs.replace(robot.drive, cruise_speed_rpm=rpm)
        made[f"all, {rpm:,.0f} rpm"] = msgspec.structs.replace(measured, drive=drive)
    return made


def with_exact_motor_table(robot: SingularityDescription) -> SingularityDescription:
    """Return the robot at other wheel speeds, where its motor table has rows."""
    errors = msgspec.structs.replace(robot.errors, motor_share=0.0)
    return msgspec.structs.replace(robot, errors=errors)


def drawn_errors(
    robot: SingularityDescription, random: np.random.Generator, used: list[ErrorSource], runs: int
) -> ErrorSet:
    """Draw the errors of `runs` robots from all sources `used`."""
    return reduce(add, (source.draw(robot, random, runs) for source in used))


def _draw_budget(
    off_line: dict[str, Array],
    middle: dict[str, float],
    high: dict[str, float],
    out: Output,
    *,
    of_thesis: bool,
) -> None:
    figure: Any = experiment.new_figure(10.0, 4.4, "What each error costs on the open-loop square")
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1.0])
    names = list(off_line)[::-1]
    rows = np.arange(len(names))
    left.barh(rows, [high[n] for n in names], 0.7, color="#f0c8b4", label="95 of 100 runs")
    left.barh(
        rows,
        [middle[n] for n in names],
        0.7,
        color=experiment.TRUTH_COLOUR,
        label="half of all runs",
    )
    left.set_yticks(rows, names)
    experiment.label_axes(
        left, "largest distance from the line (% of the side)", "", "one at a time, and together"
    )
    experiment.add_legend(left, loc="upper right")
    right.hist(off_line[_ALL_SOURCES], 60, color=experiment.TRUTH_COLOUR)
    if of_thesis:
        line: dict[str, Any] = {"color": experiment.REFERENCE_COLOUR, "linestyle": "--"}
        left.axvline(100 * THESIS_SHARE, linewidth=1.0, **line)
        right.axvline(100 * THESIS_SHARE, linewidth=1.0, label="thesis", **line)
    experiment.label_axes(
        right, "largest distance from the line (% of the side)", "runs", "all of them, run by run"
    )
    experiment.add_legend(right)
    out.figure("budget", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    text = "with all errors together; default 10,000; a tenth for one error, or a variant"
    flags.add(parser, "--runs", text, flags.whole(1), 10_000)


EXPERIMENT = Experiment(
    "budget",
    run,
    ["python -m research budget --out lab", "python -m research budget --runs 1000 --seed 1"],
    robot="tsd",
    seed_of="all errors",
    add_own_flags=_flags,
)
