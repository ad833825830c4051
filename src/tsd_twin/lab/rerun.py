"""`tsd-lab rerun`: the controller on recorded inputs, bit for bit or with another description."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
from tsd_twin.lie import SE2, SO3
from tsd_twin.recording.data import Recording, open_recording
from tsd_twin.recording.rerun import (
    Rerun,
    RerunResult,
    Stretch,
    WhatIf,
    recorded_batches,
    stretches,
)
from tsd_twin.robots import RobotDescription

_PERIOD_S = 0.01
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
        return _what_if(parts, description, _other(args, description), out)
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
    parts: Sequence[Stretch], description: str, other: RobotDescription, out: Output
) -> list[str]:
    result = WhatIf(parts[0], description, other).run()
    _show([result], out)
    lines = [f"{other.name}: {len(result.t_s)} periods run with another description"]
    if result.difference is None:
        return [*lines, "nothing differs"]
    return [
        *lines,
        f"the first difference is {result.difference}",
        f"the largest difference is {result.largest_difference:.3g}",
    ]


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


def _show(results: Sequence[RerunResult], out: Output) -> None:
    """Write the setpoints as a table and the commanded twists as a figure."""
    result = results[0]
    names = [joint.name for joint in result.robot.kinematics().joints]
    t_s = np.array(result.t_s)
    recorded, now = np.array(result.recorded), np.array(result.setpoints)
    columns: dict[str, Any] = {"t_s": t_s}
    for i, name in enumerate(names):
        columns |= {f"{name}_recorded": recorded[:, i], f"{name}_rerun": now[:, i]}
    out.table("rerun", columns)
    kinematics = result.robot.kinematics()
    figure = new_figure(9.0, 6.0, f"{result.robot.name}: commanded twist, recorded and run again")
    axes = figure.subplots(3, 1, sharex=True)
    was, here = (np.asarray(kinematics.forward(each).twist) for each in (recorded, now))
    labels = _LABELS[kinematics.pose_type]
    for i, (axis, label) in enumerate(zip(axes, labels, strict=True)):
        axis.plot(t_s, was[:, i], color=REFERENCE_COLOUR, linewidth=3.0, label="recorded")
        axis.plot(t_s, here[:, i], "--", color=ESTIMATE_COLOUR, label="run again")
        label_axes(axis, "time, s" if i == 2 else "", label)
    add_legend(axes[0])
    out.figure("rerun", figure)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="a recording of tsd-record")
    parser.add_argument("--id", help="robot in the recording, when there are several")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="what if: another value in the description; may be repeated",
    )
    parser.add_argument("--robot", metavar="NAME|FILE", help="what if: another description")
    parser.add_argument(
        "--tolerance",
        type=flags.SCALE,
        default=0.0,
        help="largest difference that counts as none; default 0, bit for bit. Another processor "
        "or another numpy needs 1e-9",
    )


EXPERIMENT = Experiment(
    "rerun",
    run,
    [
        "tsd-lab rerun run.mcap",
        "tsd-lab rerun run.mcap --set limits.acceleration_mps2=1",
        "tsd-lab rerun run.mcap --robot my.toml --out other",
    ],
    add_own_flags=_add_flags,
)
