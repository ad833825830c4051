"""`tsd-lab rerun`: the controller on recorded inputs, bit for bit or with another description."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from tsd_twin import robots
from tsd_twin.cli import flags
from tsd_twin.cli.experiment import (
    ESTIMATE_COLOUR,
    REFERENCE_COLOUR,
    Experiment,
    Output,
    add_legend,
    label_axes,
    new_figure,
)
from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.recording.data import Recording, open_recording
from tsd_twin.recording.rerun import (
    Rerun,
    RerunResult,
    Stretch,
    recorded_batches,
    stretches,
    wrapped,
)
from tsd_twin.recording.what_if import Resimulation, WhatIf
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import PLANTS

_PERIOD_S = 0.01
_SAME_MM = 0.05
"""Difference of distances that the output does not show."""
_LABELS: dict[type[Any], tuple[str, str, str]] = {
    SE2: ("vx, m/s", "vy, m/s", "omega, rad/s"),
    SO3: ("wx, rad/s", "wy, rad/s", "wz, rad/s"),
}


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Today's controller on the inputs of a recording, compared bit for bit.

    Raises:
        TwinError: If the file has no inputs, or the results differ with the same description.
    """
    recording = open_recording(args.file)
    robot = chosen_robot(recording, args.id)
    parts = stretches(recorded_batches(recording, robot))
    if not parts:
        raise TwinError(f"{args.file}: no state of the controller of {robot} is in it")
    description = recording.description(robot)
    if args.set or args.robot:
        return _what_if(parts[0], description, _other(args, description), args, out)
    if args.resimulate:
        raise TwinError("--resimulate needs --set or --robot")
    lines: list[str] = []
    results: list[RerunResult] = []
    for part in parts:
        start_s = time.perf_counter()
        result = Rerun(part, description, args.tolerance).run()
        results.append(result)
        lines.append(_line(robot, result, time.perf_counter() - start_s))
        if result.difference is not None:
            _show(results, out)
            raise TwinError(
                f"{robot} differs from the recording {result.difference}; "
                f"the largest difference of all is {result.largest_difference:.3g}"
            )
    _show(results, out)
    if len(parts) > 1:
        lines.append(f"the input log has {len(parts) - 1} gaps, after which a state follows")
    return lines


def _line(robot: str, result: RerunResult, took_s: float) -> str:
    periods = len(result.t_s)
    share = periods * _PERIOD_S / max(took_s, 1e-9)
    return (
        f"{robot}: {periods} periods run again, {share:.0f} x real time: "
        "set-points and estimates are the recorded ones"
    )


def _what_if(
    part: Stretch, description: str, other: RobotDescription, args: argparse.Namespace, out: Output
) -> list[str]:
    """Run with the recorded and the other description, and compare where both end."""
    recorded = robots.parse_description(description, "the recorded description")
    runs: list[RerunResult] = []
    for robot in (recorded, other):
        if args.resimulate:
            runs.append(Resimulation(part, description, robot, plant=args.plant).run())
        else:
            runs.append(WhatIf(part, description, robot).run())
    was, now = runs
    _show([now], out, None if not args.resimulate else was)
    how = "simulated with" if args.resimulate else "run with"
    lines = [f"{other.name}: {len(now.t_s)} periods {how} the recorded and another description"]
    lines += _ends(was, now, is_simulated=args.resimulate)
    return [*lines, *_largest(was if args.resimulate else None, now)]


def _ends(was: RerunResult, now: RerunResult, *, is_simulated: bool) -> list[str]:
    """Return the end poses of a planar robot, and their distances from the pose sensor."""
    if len(now.odometry[-1]) != 3:
        return []
    what = "simulated odometry" if is_simulated else "odometry without pose sensor"
    lines = [
        f"end of {what}, in odom:",
        f"  recorded description  {_pose_text(was.odometry[-1])}",
        f"  other description     {_pose_text(now.odometry[-1])}",
    ]
    motions = [run.sensed_motion() for run in (was, now)]
    if motions[0] is None or motions[1] is None:
        return lines if is_simulated else [*lines, "no pose sensor is in the recording"]
    sensed = motions[0][0]
    lines += [
        "motion while the pose sensor saw the robot, in its axes at the start:",
        f"  pose sensor           {_pose_text(sensed)}",
    ]
    off_m: list[float] = []
    names = ("recorded description ", "other description    ")
    for name, (own_sensed, reckoned) in zip(names, cast("Any", motions), strict=True):
        off = wrapped(reckoned - own_sensed)
        off_m.append(float(np.hypot(*off[:2])))
        lines.append(
            f"  {name} {_pose_text(reckoned)}: {1e3 * off_m[-1]:.1f} mm and "
            f"{math.degrees(off[2]):.2f} deg from the pose sensor"
        )
    nearer = "nearer to" if off_m[1] < off_m[0] else "farther from"
    apart_mm = 1e3 * abs(off_m[1] - off_m[0])
    if apart_mm < _SAME_MM:
        return [*lines, "both end equally far from the pose sensor"]
    return [*lines, f"the other description ends {apart_mm:.1f} mm {nearer} the pose sensor"]


def _pose_text(pose: Array) -> str:
    return f"x {pose[0]:.4f} m, y {pose[1]:.4f} m, heading {math.degrees(pose[2]):.2f} deg"


def _largest(was: RerunResult | None, now: RerunResult) -> list[str]:
    """Return the largest differences of set-points and estimates, with quantity, unit and time."""
    other = now if was is None else RerunResult(now.robot, now.t_s, was.setpoints, now.setpoints)
    lines: list[str] = []
    joints = now.robot.kinematics().joints
    for kind, unit in ((JointKind.POSITION, "rad"), (JointKind.VELOCITY, "rad/s")):
        largest = other.largest_setpoint_difference(kind)
        if largest is not None:
            apart, step, joint = largest
            lines.append(
                f"largest difference of set-points: {joints[joint].name} by {apart:.3g} {unit} "
                f"at {now.t_s[step]:.2f} s"
            )
    if len(now.odometry[0]) == 3:
        recorded = now.recorded_estimates if was is None else was.estimates
        moved = np.nan_to_num(np.array(now.estimates) - np.array(recorded))[:, :3]
        distance = np.hypot(moved[:, 0], moved[:, 1])
        step = int(np.argmax(distance))
        if distance[step] > 0.0:
            lines.append(
                f"largest difference of the estimated position: {1e3 * distance[step]:.3g} mm "
                f"at {now.t_s[step]:.2f} s"
            )
    return lines or ["nothing differs"]


def chosen_robot(recording: Recording, chosen: str | None) -> str:
    """Return the chosen robot of a recording, or its only one.

    Raises:
        TwinError: If none is chosen and the recording has none or several.
    """
    if chosen is not None:
        return chosen
    if len(recording.robots) != 1:
        raise TwinError(
            f"{', '.join(recording.robots) or 'no robot'} are in {recording.path}: choose with --id"
        )
    return recording.robots[0]


def _other(args: argparse.Namespace, description: str) -> RobotDescription:
    """Return the description selected by `--robot` and `--set`."""
    text, name = description, "the recorded description"
    if args.robot:
        text, name = robots.read_description(args.robot), args.robot
    for assignment in args.set:
        text = with_value(text, assignment)
    return robots.parse_description(text, name)


def with_value(text: str, assignment: str) -> str:
    """Return a description with one value changed, such as `limits.acceleration_mps2=1`.

    Raises:
        TwinError: If the assignment is malformed or its table does not exist.
    """
    path, equals, value = assignment.partition("=")
    *tables, key = path.strip().split(".")
    document: Any = tomlkit.parse(text)
    table: Any = document
    try:
        for name in tables:
            table = table[name]
        table[key] = tomlkit.value(value.strip())
    except (KeyError, TypeError, TOMLKitError) as error:
        raise TwinError(f"--set: '{assignment}' is not like limits.acceleration_mps2=1") from error
    if not equals:
        raise TwinError(f"--set: '{assignment}' has no value")
    return tomlkit.dumps(document)


def _show(results: Sequence[RerunResult], out: Output, was: RerunResult | None = None) -> None:
    """Write setpoints and estimates as a table, and the commanded twists as a figure.

    The reference is the run `was`, or by default the recording.
    """
    result = results[0]
    names = [joint.name for joint in result.robot.kinematics().joints]
    t_s = np.array(result.t_s)
    recorded = np.array(result.recorded if was is None else was.setpoints)
    now = np.array(result.setpoints)
    columns: dict[str, Any] = {"t_s": t_s}
    for i, name in enumerate(names):
        columns |= {f"{name}_recorded": recorded[:, i], f"{name}_rerun": now[:, i]}
    if len(result.odometry[0]) == 3:
        first = np.array(result.recorded_estimates if was is None else was.estimates)
        estimates = (first, np.array(result.estimates), np.array(result.odometry))
        for name, poses in zip(("recorded", "rerun", "odometry"), estimates, strict=True):
            columns |= {
                f"{key}_{name}": poses[:, i] for i, key in enumerate(("x_m", "y_m", "heading_rad"))
            }
    out.table("rerun", columns)
    kinematics = result.robot.kinematics()
    figure = new_figure(9.0, 6.0, f"{result.robot.name}: commanded twist, recorded and run again")
    axes = figure.subplots(3, 1, sharex=True)
    before, here = (np.asarray(kinematics.forward(each).twist) for each in (recorded, now))
    labels = _LABELS[kinematics.pose_type]
    for i, (axis, label) in enumerate(zip(axes, labels, strict=True)):
        axis.plot(t_s, before[:, i], color=REFERENCE_COLOUR, linewidth=3.0, label="recorded")
        axis.plot(t_s, here[:, i], "--", color=ESTIMATE_COLOUR, label="run again")
        label_axes(axis, "time, s" if i == 2 else "", label)
    add_legend(axes[0])
    out.figure("rerun", figure)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="a recording of tsd-record")
    parser.add_argument("--id", help="robot in the recording, when there are several")
    text = "what if: another value in the description"
    flags.add(parser, "--set", text, metavar="KEY=VALUE", repeated=True)
    parser.add_argument("--robot", metavar="NAME|FILE", help="what if: another description")
    text = (
        "what if: run the recorded commands on a simulated robot, whose joints follow the new "
        "set-points, as changed limits need"
    )
    parser.add_argument("--resimulate", action="store_true", help=text)
    flags.add(parser, "--plant", "of --resimulate", default="kinematic", choices=PLANTS)
    text = (
        "largest difference that counts as none; default 0, bit for bit. Another processor "
        "or another numpy needs 1e-9"
    )
    flags.add(parser, "--tolerance", text, flags.SCALE, 0.0)


EXPERIMENT = Experiment(
    "rerun",
    run,
    [
        "tsd-lab rerun run.mcap",
        "tsd-lab rerun run.mcap --set drive.wheel_radius_m=0.041",
        "tsd-lab rerun run.mcap --set limits.acceleration_mps2=1 --resimulate",
        "tsd-lab rerun run.mcap --robot my.toml --out other",
    ],
    add_own_flags=_add_flags,
)
