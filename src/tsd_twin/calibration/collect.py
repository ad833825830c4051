"""Collection of calibration data: driven on the bus, read from a log, or simulated."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.calibration import drive_log
from tsd_twin.calibration.bus_drive import drive_on_bus
from tsd_twin.calibration.drive_log import Recording, read_recordings
from tsd_twin.calibration.guided_drive import GuidedRoute, plan_calibration
from tsd_twin.calibration.report import edit_description
from tsd_twin.cli.experiment import Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot, voltage_share
from tsd_twin.lie import Array
from tsd_twin.messages.status import BiasStatus
from tsd_twin.robots import SingularityDescription, description_of_kind
from tsd_twin.sensors.pose import Camera, CameraNoise, Frame
from tsd_twin.simulation import SimRobot

OFFSET_SIGMA_DEG = 0.3
"""Standard deviation of a random gimbal zero, as set with a spirit level (assumed)."""
RADIUS_SIGMA_SHARE, SPIN_SIGMA_SHARE = 0.01, 0.01
"""Standard deviations of both radii, as measured with a ruler, and of a motor curve (assumed)."""


def random_robot(
    believed: SingularityDescription, random: np.random.Generator
) -> SingularityDescription:
    """Return a random robot built from a description, with parameter errors.

    The errors of zeros and wheel speeds in `[errors]` and `[noise]` are set to zero, and drawn into
    `[calibration]` instead, for comparison with the fit.
    """
    modules = believed.drive.modules
    trim = believed.actuator_offsets()
    offset = np.degrees(trim.offset).reshape(modules, 3)[:, :2]
    offset = offset + OFFSET_SIGMA_DEG * random.standard_normal((modules, 2))
    scale = trim.scale.reshape(modules, 3)[:, 2] * (
        1.0 + SPIN_SIGMA_SHARE * random.standard_normal(modules)
    )
    radii = 1.0 + RADIUS_SIGMA_SHARE * random.standard_normal(2)
    scale = scale * (1.0 + believed.errors.motor_share * random.standard_normal())
    return with_calibration(
        msgspec.structs.replace(
            believed,
            noise=msgspec.structs.replace(believed.noise, speed_scale_sigma=0.0),
            errors=msgspec.structs.replace(believed.errors, zero_deg=0.0, motor_share=0.0),
        ),
        offset,
        scale,
        believed.drive.wheel_radius_m * radii[0],
        believed.drive.rms_radius_m * radii[1],
    )


def with_calibration(
    robot: SingularityDescription,
    offset_deg: Array,
    scale: Array,
    wheel_radius_m: float,
    pivot_radius_m: float,
) -> SingularityDescription:
    """Return the robot with other radii, zeros `offset_deg` (k, 2) and wheel-speed `scale` (k,).

    `pivot_radius_m` is the root mean square if pivot distances differ.
    """
    pairs = [(float(alpha), float(beta)) for alpha, beta in offset_deg]
    return msgspec.structs.replace(
        robot,
        drive=msgspec.structs.replace(
            robot.drive.with_rms_radius(pivot_radius_m), wheel_radius_m=float(wheel_radius_m)
        ),
        calibration=msgspec.structs.replace(
            robot.calibration, tilt_offset_deg=pairs, spin_scale=[float(each) for each in scale]
        ),
    )


FAST_WHEEL_RATIO = 1.6
"""Relative speed of the fast wheel in each run except the first."""
SPEED_MPS, SIDE_M, TURN_RAD_PER_S = 1.0, 1.0, 2.0
TACHOMETER_SHARE = 0.002
"""Noise of a single wheel-speed reading (assumed)."""
_REST_S = 0.5
"""Longer than the delay of the camera."""


def spin_ratios(modules: int) -> list[list[float]]:
    """Return each run's wheel speeds relative to cruise speed: all equal, then one faster.

    At equal speeds only three combinations of the gimbal zeros are observable; the others only
    press the wheels against each other. A faster wheel weights its zeros more, which makes all of
    them observable.
    """
    return [
        [FAST_WHEEL_RATIO if i == j - 1 else 1.0 for i in range(modules)]
        for j in range(modules + 1)
    ]


def excitation_twists() -> Array:
    """Return the twists (n, 3) of a run for each period: squares and turns in both directions."""
    sides = SPEED_MPS * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    legs: list[tuple[Array, float]] = [(np.zeros(3), _REST_S)]
    for way, corners in ((1.0, sides), (-1.0, sides[::-1])):
        legs += [(np.append(side, 0.0), SIDE_M / SPEED_MPS) for side in corners]
        turn = np.array([0.0, 0.0, way * TURN_RAD_PER_S])
        legs.append((turn, 2.0 * math.pi / TURN_RAD_PER_S))
    legs.append((np.zeros(3), _REST_S))
    return np.concatenate([np.tile(leg, (round(s / PERIOD_S), 1)) for leg, s in legs])


def simulate_run(
    believed: SingularityDescription,
    machine: SimRobot,
    ratio: list[float],
    seed: int,
    start_s: float = 0.0,
    *,
    tachometer: bool,
) -> Recording:
    """Simulate an open-loop run with wheels at `ratio` (k,) of cruise speed.

    The robot has been at rest since `start_s`.
    """
    random = np.random.default_rng(seed)
    drive = msgspec.structs.replace(believed.drive, spin_ratio=ratio)
    robot = VirtualRobot(msgspec.structs.replace(believed, drive=drive), machine, start_s)
    at_voltage = voltage_share(robot)
    camera = Camera(CameraNoise(), random)
    rows: list[tuple[float, Array, Array, Array]] = []
    frames: list[Frame] = []
    start_s = robot.now_s
    for twist in excitation_twists():
        now_s = robot.now_s - start_s
        angles = robot.controller.joints.reshape(-1, 3)[:, :2].ravel()
        commanded = at_voltage * robot.controller.setpoint[2::3]
        rows.append((now_s, angles, commanded, machine.truth(robot.now_s).joints[2::3]))
        frames += camera.capture(now_s, robot.truth)
        robot.drive(twist)
    t_s, measured, commanded, speeds = (np.array(column) for column in zip(*rows, strict=True))
    spin = speeds * (1.0 + TACHOMETER_SHARE * random.standard_normal(speeds.shape))
    return Recording(
        t_s,
        measured,
        commanded,
        spin if tachometer else np.full(spin.shape, np.nan),
        np.array([frame.taken_s for frame in frames]),
        np.array([frame.pose for frame in frames]),
    )


_RATIO_TOLERANCE = 0.05
NEXT_DESCRIPTION = "calibrate_next.toml"


def spin_ratio_of(run: Recording) -> Array:
    """Return the wheel-speed setpoints (k,) of a run, relative to the slowest."""
    speeds = np.median(run.commanded_rad_per_s, axis=0)
    return (speeds / speeds.min()).round(3)


def missing_spin_ratios(recordings: Sequence[Recording]) -> list[list[float]]:
    """Return the wheel-speed ratios that the recordings lack."""
    driven = [spin_ratio_of(run) for run in recordings]
    return [
        ratio
        for ratio in spin_ratios(recordings[0].modules)
        if not any(np.abs(each - ratio).max() < _RATIO_TOLERANCE for each in driven)
    ]


def next_run_advice(out: Output, log: str, text: str, recordings: Sequence[Recording]) -> list[str]:
    """Return advice for the next run, and write its description; empty if no run is missing.

    `text` is the description of the robot, `log` the file with the runs so far.
    """
    left = missing_spin_ratios(recordings)
    if not left:
        return []
    out.text(
        NEXT_DESCRIPTION,
        edit_description(text, NEXT_DESCRIPTION, {"drive": {"spin_ratio": left[0]}}),
    )
    log_at, next_at = out.folder / log, out.folder / NEXT_DESCRIPTION
    more = f"{len(left)} more run{'s' if len(left) > 1 else ''}"
    return [
        f"{more} with one wheel faster would make each zero observable: start it with --robot",
        f"  {next_at}, and then tsd-lab calibrate --drive --log {log_at} --out {out.folder}",
    ]


@dataclass(frozen=True, slots=True)
class CalibrationData:
    """Calibration data: description, recordings, and the true parameters if simulated."""

    what: str
    text: str
    """The active description in TOML."""
    robot: SingularityDescription
    recordings: list[Recording]
    true: SingularityDescription | None = None
    """True parameters of a simulated robot."""
    learned: Mapping[str, BiasStatus] = field(default_factory=dict[str, BiasStatus])
    """Biases estimated by the robot, if it was on the bus."""


def _drive_on_bus(args: argparse.Namespace, out: Output) -> CalibrationData:
    """Run a guided drive; return it after earlier recordings."""
    earlier: list[Recording] = []

    def plan(robot: SingularityDescription) -> GuidedRoute:
        # A log that cannot be read is refused before the drive.
        earlier.extend(read_recordings(args.log, robot) if args.log else [])
        return plan_calibration(robot, args.room, args.speed)

    what = "squares of {:.2f} m and turn on the spot, both ways"
    found = drive_on_bus(args, out, plan, what)
    recordings = [*earlier, found.recording]
    return CalibrationData(
        found.robot_id, found.text, found.robot, recordings, learned=found.learned
    )


LOG_TABLE = "calibrate_log"
"""File of the recordings."""
_RUN_SPACING_S = 60.0
"""Time between the starts of two simulated runs, which are shorter."""


def collect(args: argparse.Namespace, out: Output) -> CalibrationData:
    """Collect the calibration data selected by the flags; write new drives to a file."""
    if args.drive:
        out.refuse_overwrite(f"{LOG_TABLE}.csv", args.log)
    found = _drive_on_bus(args, out) if args.drive else _without_bus(args, out)
    if args.drive or not args.log:
        out.table(LOG_TABLE, drive_log.recording_columns(found.recordings))
    return found


def _without_bus(args: argparse.Namespace, out: Output) -> CalibrationData:
    """Read drives from a log, or simulate them."""
    text = robots.read_description(args.robot)
    robot = description_of_kind(robots.load_robot(args.robot), SingularityDescription)
    if args.log:
        recordings = drive_log.read_recordings(args.log, robot)
        return CalibrationData(args.log, text, robot, recordings)
    true = random_robot(robot, np.random.default_rng(args.seed))
    what = "simulated machine with errors of its own"
    return CalibrationData(what, text, robot, _simulated(robot, true, args, out), true)


def _simulated(
    robot: SingularityDescription,
    true: SingularityDescription,
    args: argparse.Namespace,
    out: Output,
) -> list[Recording]:
    ratios = spin_ratios(robot.drive.modules)
    ratios = ratios[:1] if args.same_speed else ratios
    machine = SimRobot(true, args.seed, 1.0, errors=args.errors, believed=robot)
    return [
        simulate_run(
            robot,
            machine,
            ratio,
            args.seed * len(ratios) + i,
            i * _RUN_SPACING_S,
            tachometer=args.tachometer,
        )
        for i, ratio in enumerate(out.progress(ratios, "driving squares", len(ratios)))
    ]
