"""Experiment `turn`: the wheel speed of a robot, from turns on the spot by a gyro or pose sensor.

It turns a simulated or real robot on the bus. Wheels that spin faster than the table says turn the
robot further than the joints alone predict.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.calibration.operator import (
    add_bus_flags,
    confirm,
    connect,
    hold_control,
    interruptible,
    longest_pause_s,
    watch_keys,
)
from tsd_twin.calibration.report import write_description
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client import RobotClient, RobotControl
from tsd_twin.client.state import OdometryState
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array, wrap
from tsd_twin.messages.status import RobotStatus
from tsd_twin.robots import SingularityDescription, description_of_kind

_TURN_RAD = 2.5
"""Angle of a turn; less than half a rotation, so that wheels and sensor are comparable."""
_RATE_SHARE, _MAX_RATE_RAD_PER_S = 0.8, 2.4
"""Peak turn rate, relative to the limit and absolute."""
_SETTLE_S = 0.6
"""Time at rest after a turn, in which delayed poses arrive."""
_MAX_DISTANCE_M = 0.3
"""Distance from the start at which the drive ends."""
_MAX_SIGMA = 0.05
"""Largest standard deviation of a result that is used."""


@dataclass(frozen=True, slots=True, eq=False)
class SpinResult:
    """Wheel speed relative to the model, common to all wheels."""

    shares: Array
    """(n,): angle of each turn by the sensor relative to the angle by the joints."""
    sensor_sigma: float
    """Standard deviation that does not average out: the scale of a gyro."""

    @property
    def share(self) -> float:
        """Mean wheel speed relative to the model."""
        return float(self.shares.mean())

    @property
    def sigma(self) -> float:
        """Standard deviation of `share`, from the scatter of the turns and the sensor."""
        scatter = float(self.shares.std(ddof=1)) / math.sqrt(len(self.shares))
        return math.hypot(scatter, self.sensor_sigma)


def _peak_rate(robot: SingularityDescription) -> float:
    return min(_RATE_SHARE * robot.limits.turn_rate_rad_per_s, _MAX_RATE_RAD_PER_S)


def measure_turns(
    client: RobotClient,
    control: RobotControl,
    robot: SingularityDescription,
    turns: int,
    key_pressed: Callable[[], bool] = lambda: False,
) -> Iterator[float]:
    """Turn on the spot, alternately both ways; yield the ratio of the angles after each turn.

    The turn rate rises and falls like a half sine wave, so that no encoder rests within one step.

    Raises:
        TwinError: If no gyro or pose sensor measures the turns, the robot leaves its place, a key
            is pressed, or the drive is interrupted.
        ClientError: As for `RobotControl.driving`.
    """
    peak = _peak_rate(robot)
    duration_s = 0.5 * math.pi * _TURN_RAD / peak
    pause_s = longest_pause_s(robot.limits, None)
    start_xy = np.array(client.state.odom.pose[:2])
    for i in range(turns):
        before = _headings(client)
        start_s = client.time_s

        def twist_at(now_s: float, start_s: float = start_s, sign: float = (-1.0) ** i) -> Any:
            phase = (now_s - start_s) / duration_s
            moved_m = math.dist(client.state.odom.pose[:2], start_xy)
            if not moved_m <= _MAX_DISTANCE_M:
                raise TwinError(f"the robot has moved {moved_m:.2f} m from its place")
            if phase >= 1.0:
                return None
            return np.array([0.0, 0.0, sign * peak * math.sin(math.pi * phase)])

        for _ in control.driving(interruptible(twist_at, key_pressed, pause_s)):
            pass
        for _ in control.staying_ready(_SETTLE_S):
            if key_pressed():
                raise TwinError("stopped by a key")
        by_sensor, by_joints = wrap(_headings(client) - before)
        if not abs(by_joints) > 0.5 * _TURN_RAD:
            raise TwinError(
                f"the joints turned the robot by {math.degrees(by_joints):.0f} deg only"
            )
        yield float(by_sensor / by_joints)


def _headings(client: RobotClient) -> Array:
    """Return the heading (2,) with sensors, and by the joints alone.

    Raises:
        TwinError: If the robot has no second estimate, or a heading is not finite.
    """
    best, joints = client.state.odom, client.state.odom_alternative
    if not isinstance(joints, OdometryState):
        raise TwinError("nothing measures the turn: it needs [gyro] or a pose sensor")
    headings = np.array([best.pose.heading_rad, joints.pose.heading_rad])
    if not np.isfinite(headings).all():
        raise TwinError("the estimated heading is not finite")
    return headings


def sensor_sigma_of(robot: SingularityDescription, status: RobotStatus) -> float:
    """Return the relative error of turns by the sensor: 0 for a pose sensor, else the gyro's scale.

    Raises:
        TwinError: If the robot has neither.
    """
    if status.pose_sensor is not None and status.pose_sensor.used > 0:
        return 0.0
    if robot.gyro is None:
        raise TwinError("nothing measures the turn: it needs [gyro] or a pose sensor")
    return robot.gyro.scale_share


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Learn the wheel speed of a robot on the bus from turns on the spot, in seconds."""
    with connect(args) as (client, link):
        robot = description_of_kind(link.robot, SingularityDescription)
        status = client.state.status
        sensor_sigma = sensor_sigma_of(robot, status)
        confirm(args, _warning(args, robot, link.id))
        shares: list[float] = []
        with hold_control(client, args.operator) as control, watch_keys() as pressed:
            out.show_progress(control.arming(), 1.0, "spinning up")
            turns = measure_turns(client, control, robot, args.turns, pressed)
            shares += out.progress(turns, "turning, any key stops", args.turns)
        text = link.description.robot
    found = SpinResult(np.array(shares), sensor_sigma)
    out.table("turn", {"turn": [*range(1, len(shares) + 1)], "share": shares})
    _draw(found, out)
    sensor = "a gyro" if sensor_sigma > 0.0 else "a pose sensor"
    lines = [
        f"{link.id}: {args.turns} turns of {math.degrees(_TURN_RAD):.0f} deg, measured by {sensor}",
        f"wheels spin at {found.share:.4f} +- {found.sigma:.4f} of the model, "
        "the mean of all wheels",
    ]
    if not found.sigma < _MAX_SIGMA:
        raise TwinError(f"the turns scatter too much: {found.share:.3f} +- {found.sigma:.3f}")
    return [*lines, *_write(args, robot, text, found)]


def _write(
    args: argparse.Namespace, robot: SingularityDescription, text: str, found: SpinResult
) -> list[str]:
    old = robot.calibration.spin_scale or [1.0] * robot.drive.modules
    scale = [round(found.share * each, 5) for each in old]
    sigma = round(found.sigma, 5)
    lines = [f"[calibration] spin_scale = {scale}", f"[errors] motor_share = {sigma}"]
    if args.write_to:
        changes = {"calibration": {"spin_scale": scale}, "errors": {"motor_share": sigma}}
        write_description(args.write_to, text, changes)
        lines.append(f"written into {args.write_to}: start the robot with it")
    return lines


def _warning(args: argparse.Namespace, robot: SingularityDescription, robot_id: str) -> str:
    seconds = args.turns * (0.5 * math.pi * _TURN_RAD / _peak_rate(robot) + _SETTLE_S)
    return (
        f"{robot_id} will turn on the spot, {args.turns} times by "
        f"{math.degrees(_TURN_RAD):.0f} deg, for {seconds:.0f} s.\n"
        "Give it 0.5 m of free, level floor on all sides, and have the "
        "hardware stop at hand. Any key here stops and disarms it."
    )


def _draw(found: SpinResult, out: Output) -> None:
    figure = experiment.new_figure(7.0, 3.6, "Wheel speed from turns on the spot")
    axes: Any = figure.subplots()
    numbers = np.arange(1, len(found.shares) + 1)
    axes.plot(numbers, found.shares, "o", color=experiment.TRUTH_COLOUR, label="each turn")
    low, high = found.share - found.sigma, found.share + found.sigma
    axes.axhspan(low, high, color=experiment.ESTIMATE_COLOUR, alpha=0.2, label="mean, 1 sigma")
    experiment.label_axes(axes, "turn", "wheel speed relative to the model")
    experiment.add_legend(axes)
    out.figure("turn", figure)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    add_bus_flags(parser)
    flags.add(parser, "--turns", "alternately both ways", flags.whole(2, 40), 8)
    text = "description to put the wheel speeds into, its comments kept"
    flags.add(parser, "--write-to", text, metavar="FILE.toml")


EXPERIMENT = Experiment(
    "turn",
    run,
    [
        "tsd-lab turn                            the robot of this machine, mock or not",
        "tsd-lab turn --write-to my.toml         and put its wheel speed into its description",
    ],
    add_own_flags=_add_flags,
)
