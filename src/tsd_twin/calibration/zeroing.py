"""Experiment `zero`: zeroing of the gimbals as in the thesis (an inch in 30 s at 2,500 rpm).

It spins the wheels of a simulated or real robot on the bus, but does not drive it.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tsd_twin.calibration.operator import (
    add_bus_flags,
    ask_displacement,
    confirm,
    connect,
    hold_control,
    print_line,
)
from tsd_twin.calibration.report import write_description
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import PERCENT_STEPS, Experiment, Output, in_percent_steps
from tsd_twin.client import RobotClient, RobotControl
from tsd_twin.client.connection import RobotConnection
from tsd_twin.lie import SE2, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import decode_pose_measurement
from tsd_twin.messages.status import decode_stamp
from tsd_twin.robots import RPM, SingularityDescription, description_of_kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TimedPose = tuple[float, Array]
"""Time, and x, y, heading (3,) at that time."""


class PoseTracker:
    """Tracks a robot's pose from `sensor/pose` or, without it, the simulator's ground truth."""

    def __init__(self, link: RobotConnection) -> None:
        self._poses = link.subscriber(topics.SENSOR_POSE, 256)
        self._truths = link.subscriber(topics.TRUTH, 256)
        self._by_camera: list[TimedPose] = []
        self._by_simulator: list[TimedPose] = []
        self.refused = ""
        """Reason for the last rejected pose."""

    def poll(self) -> None:
        """Process the samples since the last call."""
        for sample in self._poses.take_samples():
            try:
                pose, stamp_ns = decode_pose_measurement(sample)
                self._by_camera.append((stamp_ns * 1e-9, pose.xy_heading))
            except MessageError as error:
                self.refused = str(error)
        for sample in self._truths.take_samples():
            try:
                at_s = decode_stamp(sample.attachment)[1] * 1e-9
                pose_there = np.array(decode_odometry(sample.payload).xy_heading)
            except MessageError:
                continue
            if np.isfinite(pose_there).all():
                self._by_simulator.append((at_s, pose_there))

    def clear(self) -> None:
        """Discard the poses so far."""
        self.poll()
        self._by_camera.clear()
        self._by_simulator.clear()

    @property
    def poses(self) -> list[TimedPose]:
        """Tracked poses in the order of time, on one clock."""
        return sorted(self._source, key=lambda each: each[0])

    @property
    def moved_m(self) -> float:
        """Distance from the first pose."""
        source = self._source
        return math.dist(source[-1][1][:2], source[0][1][:2]) if source else 0.0

    @property
    def source_name(self) -> str:
        """Source of the poses."""
        return "a camera" if self._source is self._by_camera else "the simulator"

    @property
    def _source(self) -> list[TimedPose]:
        return self._by_camera if len(self._by_camera) > 1 else self._by_simulator


LIMIT_M, LIMIT_S, LIMIT_RPM = 0.0254, 30.0, 2500.0
"""Drift limit of zeroed gimbals: an inch in 30 s (thesis)."""
_CANDIDATES = 120_000
_LIMIT_FRACTION = 0.8
"""Fraction of the limit that may remain after a change; a smaller one needs larger offsets."""


@dataclass(frozen=True, slots=True, eq=False)
class ZeroOffsetDrift:
    """Drift due to zero offsets: a constant body twist (3,) at the wheel speed of the run."""

    twist: Array
    spin_rpm: float
    sigma_mps: float = 0.0
    """Standard deviation of the velocity, in its least certain direction."""

    @property
    def distance_m(self) -> float:
        """Drift of the centre in 30 s at 2,500 rpm; proportional to the wheel speed."""
        return float(np.hypot(*self.twist[:2])) * LIMIT_S * self._limit_scale

    @property
    def distance_sigma_m(self) -> float:
        """Standard deviation of `distance_m`."""
        return self.sigma_mps * LIMIT_S * self._limit_scale

    @property
    def turn_rad(self) -> float:
        """Rotation in that time."""
        return float(self.twist[2]) * LIMIT_S * self._limit_scale

    @property
    def passes(self) -> bool:
        """Whether the gimbals count as zeroed."""
        return self.distance_m < LIMIT_M

    @property
    def _limit_scale(self) -> float:
        return LIMIT_RPM / self.spin_rpm

    def sentence(self) -> str:
        """Describe the drift in 30 s at 2,500 rpm."""
        vx, vy, _ = self.twist
        toward = np.degrees(np.arctan2(vy, vx))
        return (
            f"{1000 * self.distance_m:.1f} mm in {LIMIT_S:.0f} s, towards {toward:.0f} deg, "
            f"and turns {np.degrees(self.turn_rad):.1f} deg"
        )


def drift_of(t_s: Array, poses: Array, spin_rpm: float) -> ZeroOffsetDrift:
    """Fit a constant twist to poses (n, 3) by least squares; times (n,) increase.

    The heading gives the turn rate; with it, the displacement is linear in the velocity.
    """
    after_s = t_s - t_s[0]
    seen = poses.copy()
    seen[:, 2] = np.unwrap(seen[:, 2])
    by_line = np.column_stack([after_s, np.ones_like(after_s)])
    turning, start = np.linalg.lstsq(by_line, seen[:, 2], rcond=None)[0].tolist()
    # Use the heading of the fitted line, because noise of the first heading would rotate all
    # others.
    local = SE2(np.array([0.0, 0.0, -start])).rotate(seen[:, :2])
    rows = np.zeros((len(t_s), 2, 4))
    for i in (0, 1):
        twists = np.zeros((len(t_s), 3))
        twists[:, i], twists[:, 2] = 1.0, turning
        rows[:, :, i] = SE2.exp(twists * after_s[:, None]).xy_heading[:, :2]
        rows[:, i, 2 + i] = 1.0
    flat = rows.reshape(-1, 4)
    found = np.linalg.lstsq(flat, local.ravel(), rcond=None)[0]
    squares = np.square(local.ravel() - flat @ found).sum() / max(1, len(flat) - 4)
    spread = squares * np.linalg.pinv(flat.T @ flat)[:2, :2]
    sigma_mps = float(np.sqrt(max(0.0, np.linalg.eigvalsh(spread)[-1])))
    return ZeroOffsetDrift(np.array([found[0], found[1], turning]), spin_rpm, sigma_mps)


def drift_by_hand(
    moved_m: Array, turned_rad: float, seconds: float, spin_rpm: float
) -> ZeroOffsetDrift:
    """Return the constant twist for a displacement (2,), start frame, and a rotation."""
    return ZeroOffsetDrift(SE2(np.append(moved_m, turned_rad)).log() / seconds, spin_rpm)


def twist_by_zero_offsets(robot: SingularityDescription) -> Array:
    """Return the Jacobian (3, 2k) of the twist at zero command w.r.t. the gimbal angles.

    Contact velocities of upright wheels are r_w spin (alpha, -beta).
    """
    drive = robot.kinematics()
    rims_mps = drive.wheel_radius_m * drive.spin_rad_per_s * drive.spin_ratio
    return drive.twist_from_contacts * np.outer(rims_mps, [1.0, -1.0]).ravel()


def spin_rpm(robot: SingularityDescription) -> float:
    """Return the mean wheel speed while the robot is ready."""
    drive = robot.kinematics()
    return float(np.mean(drive.spin_rad_per_s * drive.spin_ratio)) / RPM


def corrective_steps(
    robot: SingularityDescription, drift: ZeroOffsetDrift
) -> tuple[Array, ZeroOffsetDrift]:
    """Return corrections of the zeros in servo steps (2k,), and the predicted remaining drift.

    A drift has three components, but there are six or more zeros, so the solution is not unique.
    This is the smallest in whole servo steps within the limit or, without one, the solution with
    the smallest drift.
    """
    matrix, step_rad = twist_by_zero_offsets(robot), 2.0 * np.pi / robot.servo.steps_per_turn
    exact = np.linalg.pinv(matrix) @ drift.twist / step_rad
    wide = max(1, int(_CANDIDATES ** (1.0 / len(exact))))
    around = np.arange(wide) - (wide - 1) // 2
    near = np.array(list(itertools.product(around, repeat=len(exact))), dtype=float)
    steps = np.rint(exact) + near
    left = drift.twist - steps @ (step_rad * matrix).T
    least_turn = np.abs(left[:, 2]).min()
    turns_least = np.abs(left[:, 2]) <= 1.01 * least_turn + 1e-9
    way_m = np.hypot(left[:, 0], left[:, 1]) * LIMIT_S * LIMIT_RPM / drift.spin_rpm
    size = np.square(steps - exact).sum(axis=1)
    good = turns_least & (way_m < _LIMIT_FRACTION * LIMIT_M)
    cost = np.where(good, size, np.inf) if good.any() else np.where(turns_least, way_m, np.inf)
    best = int(np.argmin(cost))
    return steps[best], ZeroOffsetDrift(left[best], drift.spin_rpm)


def draw_drift(t_s: Array, poses: Array, drift: ZeroOffsetDrift) -> Figure:
    """Draw poses (n, 3) relative to the start, from above and over time."""
    figure: Any = experiment.new_figure(9.5, 4.4, "Creep of a robot that is commanded to stand")
    left, right = figure.subplots(1, 2)
    millimetres = 1000.0 * poses[:, :2]
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = 1000.0 * LIMIT_M * np.stack([np.cos(turn), np.sin(turn)])
    left.plot(*circle, "--", color=experiment.REFERENCE_COLOUR, linewidth=1.2, label="an inch")
    left.plot(
        *millimetres.T, color=experiment.TRUTH_COLOUR, linewidth=1.8, label="centre of the robot"
    )
    left.plot(*millimetres[-1], "s", color=experiment.TRUTH_COLOUR, markersize=5)
    left.set_aspect("equal", adjustable="datalim")
    experiment.label_axes(left, "forward (mm)", "left (mm)", "from above")
    experiment.add_legend(left, loc="best")
    ends = np.array([0.0, LIMIT_S])
    right.plot(
        t_s,
        np.hypot(*millimetres.T),
        color=experiment.TRUTH_COLOUR,
        linewidth=1.8,
        label="distance",
    )
    way_mm = 1000.0 * drift.distance_m
    right.plot(
        ends,
        ends / LIMIT_S * way_mm,
        ":",
        color=experiment.ESTIMATE_COLOUR,
        label="way at this creep",
    )
    right.axhline(
        1000.0 * LIMIT_M, color=experiment.REFERENCE_COLOUR, linestyle="--", linewidth=1.2
    )
    experiment.label_axes(right, "time (s)", "distance (mm)", "against time")
    experiment.add_legend(right, loc="best")
    return figure


MAX_DISTANCE_M = 0.5
"""Maximum distance before the procedure ends, if poses are measured."""
_MIN_S, _MAX_S = 1.0, 300.0


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Zero the gimbals of a robot on the bus to less than an inch of creep in 30 s at 2,500 rpm."""
    with connect(args) as (client, link):
        robot = description_of_kind(link.robot, SingularityDescription)
        confirm(args, _warning(args, robot, link.id))
        tracker = PoseTracker(link)
        held_s = _hold_still(args, out, client, tracker)
    seen = len(tracker.poses) > 1 and not args.by_hand
    if seen:
        t_s = np.array([at_s for at_s, _ in tracker.poses])
        poses = np.array([pose for _, pose in tracker.poses])
        drift = drift_of(t_s, poses, spin_rpm(robot))
    else:
        if tracker.refused and not args.by_hand:
            print_line(
                f"The poses on sensor/pose were rejected ({tracker.refused}): measure by hand."
            )
        moved_m, turned_rad = ask_displacement()
        drift = drift_by_hand(moved_m, turned_rad, held_s, spin_rpm(robot))
        t_s = np.array([0.0, held_s])
        poses = np.array([np.zeros(3), [*moved_m, turned_rad]])
    poses = (SE2(poses[0]).inverse() @ SE2(poses)).xy_heading
    columns = dict(zip(("x_m", "y_m", "heading_rad"), poses.T, strict=True))
    out.table("zero", {"t_s": t_s - t_s[0]} | columns)
    out.figure("zero", draw_drift(t_s - t_s[0], poses, drift))
    who = f"seen by {tracker.source_name}" if seen else "measured by hand"
    verdict = "PASS" if drift.passes else "FAIL"
    lines = [
        f"{link.id}: wheels at {spin_rpm(robot):.0f} rpm for {held_s:.1f} s, {who}",
        f"creeps {drift.sentence()}; at most {1000 * LIMIT_M:.1f} mm: {verdict}",
    ]
    if abs(drift.distance_m - LIMIT_M) < 2.0 * drift.distance_sigma_m:
        about_mm = 1000 * drift.distance_sigma_m
        lines.append(f"its standard deviation is {about_mm:.1f} mm: more --seconds reduce it")
    return lines if drift.passes else lines + _advice(args, robot, link.description.robot, drift)


def _hold_still(
    args: argparse.Namespace, out: Output, client: RobotClient, tracker: PoseTracker
) -> float:
    """Hold the robot ready at standstill; return the time that was held or tracked."""
    held_s = 0.0
    with hold_control(client, args.operator) as control:
        out.show_progress(control.arming(), 1.0, "spinning up")
        tracker.clear()
        held = in_percent_steps(_hold_and_track(control, args.seconds, tracker), args.seconds)
        for percent in out.progress(held, "standing still, Ctrl-C stops", PERCENT_STEPS):
            held_s = max(held_s, percent * args.seconds / PERCENT_STEPS)
    seen = tracker.poses
    return seen[-1][0] - seen[0][0] if seen else held_s


def _hold_and_track(control: RobotControl, seconds: float, tracker: PoseTracker) -> Iterator[float]:
    """Hold and track the pose; end early if the robot drifts too far."""
    for held_s in control.staying_ready(seconds):
        tracker.poll()
        yield held_s
        if tracker.moved_m > MAX_DISTANCE_M:
            return
    yield seconds


def _warning(args: argparse.Namespace, robot: SingularityDescription, robot_id: str) -> str:
    return (
        f"{robot_id} will spin its wheels at {spin_rpm(robot):.0f} rpm, commanded to stand still, "
        f"for {args.seconds:g} s.\nGive it 1 m of free, level floor on all sides, mark its centre "
        "and its heading,\nand have the hardware stop at hand. Ctrl-C here disarms it."
    )


def _advice(
    args: argparse.Namespace, robot: SingularityDescription, text: str, drift: ZeroOffsetDrift
) -> list[str]:
    steps, left = corrective_steps(robot, drift)
    drive = robot.kinematics()
    offset = robot.actuator_offsets().offset.reshape(-1, 3)[:, :2].ravel()
    offset = np.degrees(offset + steps * 2.0 * np.pi / robot.servo.steps_per_turn)
    pairs = [[round(float(angle), 4) for angle in pair] for pair in offset.reshape(-1, 2)]
    lines = ["zeros that explain it, in whole steps of the servos:"]
    for name, moved, (alpha, beta) in zip(
        drive.actuators, steps.reshape(-1, 2), pairs, strict=True
    ):
        lines.append(
            f"  {name}: alpha {moved[0]:+.0f} to {alpha:.3f} deg, "
            f"beta {moved[1]:+.0f} to {beta:.3f} deg"
        )
    lines.append(f"with them it should creep {left.sentence()}")
    lines.append(
        "the solution is not unique: offsets that press wheels against each other move no robot, "
        "and only tsd-lab calibrate finds them"
    )
    if args.write_to:
        write_description(args.write_to, text, {"calibration": {"tilt_offset_deg": pairs}})
        lines.append(f"written into {args.write_to}: start the robot with it, and zero again")
    return lines


def _flags(parser: argparse.ArgumentParser) -> None:
    add_bus_flags(parser)
    text = f"to watch it; default {LIMIT_S:g}"
    flags.add(parser, "--seconds", text, flags.number(_MIN_S, _MAX_S), LIMIT_S)
    parser.add_argument(
        "--by-hand", action="store_true", help="ask how far it went, also when its pose is measured"
    )
    text = "description to put new zeros into, its comments kept; or a copy of the robot's own"
    flags.add(parser, "--write-to", text, metavar="FILE.toml")


EXPERIMENT = Experiment(
    "zero",
    run,
    [
        "tsd-lab zero                            the robot of this machine, mock or not",
        "tsd-lab zero --write-to my.toml         and put better zeros into its description",
        "tsd-lab zero --id left --seconds 5      one of several, when it creeps far",
    ],
    add_own_flags=_flags,
)
