"""Open-loop drives of many simulated robots, and the consistency of their estimates.

Manoeuvres, the control loop's setpoints for them, simulated robots with individual errors, and
squared estimation errors in units of their covariances (NEES).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import exponential_error, heading_region_rad, position_region
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import SENSOR_POSE, Sample
from tsd_twin.robots import OmniDescription, RobotDescription, SingularityDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.sensors.pose import Camera, CameraNoise
from tsd_twin.simulation import SimRobot, Simulation, simulate

TIMES_S = (2.0, 5.0, 20.0)
MOUNTED, CONSTANT = "mounted", "2 cm off"
"""Cameras: mounted with the described accuracy, or off by a constant distance."""
_CONSTANT_M = 0.02
_POINT_M = 1e-9

# Manoeuvres.


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Twists over time, for any robot on a floor."""

    name: str
    twist: Callable[[float], Sequence[float]]
    """Maps seconds since the start to vx, vy, omega; m/s and rad/s."""
    drive_speeds: Sequence[float] = ()
    """Speeds of continuously spinning wheels, relative to the default, for `_SPEED_S` each."""


_SPEED_S = 2.0


def _wander(t_s: float) -> tuple[float, float, float]:
    start = min(1.0, t_s)
    return (
        0.6 * start,
        0.3 * start * math.sin(t_s),
        0.5 * start * math.cos(0.7 * t_s),
    )


def _to_and_fro(t_s: float) -> tuple[float, float, float]:
    return (0.5 if t_s % 4.0 < 2.0 else -0.5, 0.0, 0.0)


def _turn_and_translate(t_s: float) -> tuple[float, float, float]:
    """Drive in a constant direction over the floor while turning."""
    heading = 1.5 * t_s
    return (0.5 * math.cos(heading), -0.5 * math.sin(heading), 1.5)


def _figure_eight(t_s: float) -> tuple[float, float, float]:
    return (0.5, 0.0, 0.8 if (0.8 * t_s) % (4.0 * math.pi) < 2.0 * math.pi else -0.8)


def _stops(t_s: float) -> tuple[float, float, float]:
    drives = float(t_s % 4.0 < 3.0)
    return (0.8 * drives, 0.0, drives * math.sin(t_s))


def _reversals(t_s: float) -> tuple[float, float, float]:
    sign = 1.0 if t_s % 1.0 < 0.5 else -1.0
    return (0.35 * sign, 0.35 * sign, 0.5 * sign)


_FAST_MPS = 10.0


def _at_the_cap(t_s: float) -> tuple[float, float, float]:
    """Drive at full speed, in another direction every two seconds."""
    angle = 2.4 * math.floor(t_s / 2.0)
    return (_FAST_MPS * math.cos(angle), _FAST_MPS * math.sin(angle), 0.0)


MANOEUVRES: tuple[Manoeuvre, ...] = (
    Manoeuvre("straight 0.5 m/s", lambda _t_s: (0.5, 0.0, 0.0)),
    Manoeuvre("straight 1 m/s", lambda _t_s: (1.0, 0.0, 0.0)),
    Manoeuvre("circle", lambda _t_s: (0.5, 0.0, 0.5)),
    Manoeuvre("wander", _wander),
    Manoeuvre("to and fro", _to_and_fro),
    Manoeuvre("turn and translate", _turn_and_translate),
    Manoeuvre("figure eight", _figure_eight),
    Manoeuvre("stops", _stops),
    Manoeuvre("reversals", _reversals),
    Manoeuvre("creep 0.02 m/s", lambda _t_s: (0.02, 0.0, 0.0)),
    Manoeuvre("at the cap", _at_the_cap),
    Manoeuvre("drive speeds", lambda _t_s: (0.5, 0.0, 0.0), (1.0, 2.0, 1.5, 3.0)),
    Manoeuvre("standing", lambda _t_s: (0.0, 0.0, 0.0)),
)
BY_NAME = {manoeuvre.name: manoeuvre for manoeuvre in MANOEUVRES}


class _Recorder(SimRobot):
    """Ideal robot that records its setpoints."""

    def __init__(self, robot: RobotDescription) -> None:
        super().__init__(robot)
        self.setpoints: list[Array] = []

    def write(self, setpoint: Array, now_s: float) -> None:
        """Record and apply a setpoint (n,)."""
        self.setpoints.append(setpoint.copy())
        super().write(setpoint, now_s)


@functools.lru_cache(maxsize=4)
def driven_setpoints(robot_name: str, manoeuvre_name: str, seconds: float) -> tuple[Array, int]:
    """Return the setpoints (p, n) of a run from power-up, and the index at which the robot starts.

    They come from the control loop with all its limits, for commands in the robot frame, and so do
    not depend on measurements.
    """
    robot, manoeuvre = robots.load_robot(robot_name), BY_NAME[manoeuvre_name]
    return recorded_setpoints(robot, manoeuvre, seconds)


def recorded_setpoints(
    robot: RobotDescription, manoeuvre: Manoeuvre, seconds: float
) -> tuple[Array, int]:
    """Return the setpoints (p, n) as `driven_setpoints`, for any robot and manoeuvre."""
    recorder = _Recorder(robot)
    on_floor = isinstance(recorder.truth(0.0).pose, SE2)
    virtual = VirtualRobot(robot, recorder, on_floor=on_floor)
    start = len(recorder.setpoints)
    default_rpm = getattr(robot.drive, "cruise_speed_rpm", 0.0)  # pyright: ignore
    for i in range(round(seconds / PERIOD_S)):
        t_s = i * PERIOD_S
        if manoeuvre.drive_speeds and t_s % _SPEED_S < 0.5 * PERIOD_S:
            speeds = manoeuvre.drive_speeds
            virtual.choose_drive_speed(default_rpm * speeds[round(t_s / _SPEED_S) % len(speeds)])
        virtual.drive(np.array(manoeuvre.twist(t_s)))
    return np.array(recorder.setpoints), start


# Cases.

JOINTS, GYRO, DEAD_WHEELS = "joints", "gyro", "dead wheels"
"""Sensors of the odometry: drive joints only, with a yaw gyro, or tracking wheels with a gyro."""


@dataclass(frozen=True, slots=True)
class Case:
    """Table row: many identical robots with individual errors."""

    robot: str
    manoeuvre: str
    errors: float = 0.0
    odometry: str = ""
    """`JOINTS`, `GYRO` or `DEAD_WHEELS`; "" uses the described sensors."""
    camera: str = ""
    """A camera "mounted" as described, one "2 cm off", or ""."""
    plant: str = "kinematic"
    seeds: int = 40
    first: int = 0
    """Seed of the first robot."""
    times_s: tuple[float, ...] = TIMES_S
    """Times since the start at which estimates are compared with the true poses, seconds."""
    friction: float | None = None
    """Friction of the simulated floor, or None for the described one."""

    @property
    def described(self) -> RobotDescription:
        """Description used by simulator and estimator."""
        robot = robots.load_robot(self.robot).with_errors(self.errors)
        if isinstance(robot, OmniDescription) and self.odometry in (JOINTS, GYRO):
            robot = msgspec.structs.replace(robot, dead_wheels=None)
        if isinstance(robot, SingularityDescription | OmniDescription) and self.odometry:
            gyro = (robot.gyro or Gyro()) if self.odometry == GYRO else None
            robot = msgspec.structs.replace(robot, gyro=gyro)
        if isinstance(robot, SingularityDescription) and self.plant == "kinematic":
            # This plant has no friction, so use a contact point that does not slide.
            floor = msgspec.structs.replace(robot.floor, patch_radius_m=_POINT_M)
            robot = msgspec.structs.replace(robot, floor=floor)
        return robot

    @property
    def sensors(self) -> str:
        """Sensors in addition to the joints, as text."""
        odometry = "" if self.odometry == JOINTS else self.odometry
        camera = f"camera, {self.camera}" if self.camera else ""
        return " + ".join(filter(None, (odometry, camera))) or JOINTS


@dataclass(frozen=True, slots=True, eq=False)
class Consistency:
    """Result of a case."""

    case: Case
    nees: Array
    """(times, seeds): squared error in units of the covariance, expected 3."""
    inside: Array
    """(times, seeds): whether the position was inside the drawn region."""
    within: Array
    """(times, seeds): whether the heading was inside the drawn wedge."""

    @property
    def means(self) -> Array:
        """(times,): mean squared errors."""
        return self.nees.mean(axis=-1)

    @property
    def coverage(self) -> Array:
        """(times,): fraction of the robots inside the drawn region."""
        return self.inside.mean(axis=-1)

    @property
    def heading_coverage(self) -> Array:
        """(times,): fraction of the robots whose heading is inside the drawn wedge."""
        return self.within.mean(axis=-1)


# Drives.


@dataclass(frozen=True, slots=True)
class Drive:
    """Simulated drive shared by robots with different sensors."""

    cases: tuple[Case, ...]
    """Cases, which differ in gyro and camera only."""
    first: int
    """Seed of the first robot."""
    batch: tuple[int, ...]
    """Batch shape: `()` is a single robot, which has the seed `first`."""


def drives(cases: Sequence[Case]) -> list[Drive]:
    """Return the drives needed for some cases; the simulation does not depend on the sensors."""
    groups: dict[Case, list[Case]] = {}
    for case in cases:
        own = case.odometry if case.odometry not in (JOINTS, GYRO) else JOINTS
        groups.setdefault(replace(case, odometry=own, camera=""), []).append(case)
    found: list[Drive] = []
    for shared, group in groups.items():
        if shared.plant == "kinematic":
            found.append(Drive(tuple(group), shared.first, (shared.seeds,)))
        else:  # Rigid bodies are simulated one robot at a time.
            seeds = range(shared.first, shared.first + shared.seeds)
            found.extend(Drive(tuple(group), seed, ()) for seed in seeds)
    return found


def run_case(case: Case) -> Consistency:
    """Drive all robots of a case, and compare their estimates with the true poses."""
    made = drives([case])
    return collected([case], made, [drive(each) for each in made])[0]


def collected(
    cases: Sequence[Case], made: Sequence[Drive], results: Sequence[Sequence[tuple[Array, ...]]]
) -> list[Consistency]:
    """Return the results of all cases, in their order, from the results of the drives."""
    parts: dict[Case, list[tuple[Array, ...]]] = {case: [] for case in cases}
    for driven, by_case in zip(made, results, strict=True):
        for case, part in zip(driven.cases, by_case, strict=True):
            parts[case].append(part)
    return [
        Consistency(
            case, *(np.concatenate(part, axis=-1) for part in zip(*parts[case], strict=True))
        )
        for case in cases
    ]


def _simulated(driven: Drive, robot: RobotDescription) -> Simulation:
    """Return the simulated robots of a drive."""
    plant, friction = driven.cases[0].plant, driven.cases[0].friction
    if friction is not None and isinstance(robot, SingularityDescription):
        floor = msgspec.structs.replace(robot.floor, friction=friction)
        robot = msgspec.structs.replace(robot, floor=floor)
    elif friction is not None and isinstance(robot, OmniDescription):
        slippery = msgspec.structs.replace(robot.drive, friction=friction)
        robot = msgspec.structs.replace(robot, drive=slippery)
    return simulate(robot, driven.batch, seed=driven.first, noise=1.0, errors=1.0, plant=plant)


def drive(
    driven: Drive, make: Callable[[Drive, RobotDescription], Simulation] = _simulated
) -> list[tuple[Array, ...]]:
    """Drive, and return the arrays (times, robots) of `_compared` for each case.

    `make` returns the robots; their poses are `SE2`.
    """
    case = next((case for case in driven.cases if case.odometry == GYRO), driven.cases[0])
    robot = case.described
    simulation = make(driven, robot)
    setpoints, start = driven_setpoints(case.robot, case.manoeuvre, case.times_s[-1])
    count = len(np.atleast_2d(simulation.joints))
    fleets = [_Fleet(case, count, driven.first) for case in driven.cases]
    unmeasured = unmeasured_joints(robot)
    marks = SE2.identity()
    ends = {start + round(t_s / PERIOD_S) for t_s in case.times_s}
    for i in range(max(ends) + 1):
        now_s = (i + 1) * PERIOD_S
        if i > 0:
            simulation.advance(PERIOD_S)
        measured = np.atleast_2d(simulation.measure())
        measured[:, unmeasured] = np.nan
        poses = SE2(np.atleast_2d(simulation.pose.xy_heading))
        if i == start:
            marks = poses
        truths = marks.inverse() @ poses
        for fleet in fleets:
            fleet.advance(now_s, measured, setpoints[max(i - 1, 0)])
            if i == start:
                fleet.start()
            elif i > start:
                fleet.watch(truths, now_s)
            if i in ends:
                fleet.compare(truths)
        if i < len(setpoints):
            simulation.command(setpoints[i])
    return [fleet.results for fleet in fleets]


class _Fleet:
    """Estimators of the robots of a case, with their cameras."""

    def __init__(self, case: Case, count: int, seed: int) -> None:
        robot = case.described
        self._estimators = [StateEstimator(robot) for _ in range(count)]
        self._cameras = _Cameras(case, robot, count, seed)
        self._measured = len(robot.kinematics().joints) + len(robot.sensors)
        self._compared: list[tuple[Array, ...]] = []

    def advance(self, now_s: float, measured: Array, setpoint: Array) -> None:
        """Update with all robots' measurements, (robots, n + s or more), and a setpoint (n,)."""
        for estimator, values in zip(self._estimators, measured, strict=True):
            estimator.advance(now_s, values[: self._measured], setpoint, PERIOD_S)

    def start(self) -> None:
        """Start the estimation at the origin."""
        for estimator in self._estimators:
            estimator.set_pose(SE2.identity())

    def watch(self, truths: SE2, now_s: float) -> None:
        """Let the cameras see the robots at their poses (robots,)."""
        for k, estimator in enumerate(self._estimators):
            self._cameras.watch(k, estimator, SE2(truths.xy_heading[k]), now_s)

    def compare(self, truths: SE2) -> None:
        """Compare the estimates with the true poses (robots,)."""
        self._compared.append(_compared(self._estimators, truths))

    @property
    def results(self) -> tuple[Array, ...]:
        """Results of `_compared`, (times, robots) each."""
        return tuple(np.array(each) for each in zip(*self._compared, strict=True))


def unmeasured_joints(robot: RobotDescription) -> list[int]:
    """Return the indices of the joints that the robot does not measure."""
    if robot.measures_spin:
        return []
    joints = enumerate(robot.kinematics().joints)
    return [i for i, joint in joints if joint.kind is JointKind.VELOCITY]


def encloses(outline: Array, point: Array) -> bool:
    """Return whether a closed `outline` (n, 2) winds around a `point` (2,)."""
    arms = outline - point
    following = np.roll(arms, -1, axis=0)
    crossed = arms[:, 0] * following[:, 1] - arms[:, 1] * following[:, 0]
    turns = np.arctan2(crossed, (arms * following).sum(axis=-1))
    return abs(float(turns.sum())) > np.pi


_LEAST_M = 1e-5
"""Standard deviation added to each component, for singular covariances."""


def _compared(estimators: Sequence[StateEstimator], truths: SE2) -> tuple[Array, ...]:
    """Return each robot's squared error in units of the covariance, and containment.

    Containment in the drawn regions is given for position and heading.
    """
    messages = [estimator.odometry(0) for estimator in estimators]
    estimates = SE2(np.array([each.xy_heading for each in messages]))
    errors = exponential_error(estimates, truths)
    covariances = np.array([each.pose_covariance for each in messages]) + _LEAST_M**2 * np.eye(3)
    away = (truths.xy_heading - estimates.xy_heading)[:, :2]
    inside = [
        encloses(position_region(covariance), point)
        for covariance, point in zip(covariances, away, strict=True)
    ]
    halves = np.array([heading_region_rad(covariance) for covariance in covariances])
    return (
        squared_errors(errors, covariances),
        np.array(inside, dtype=float),
        (np.abs(errors[:, 2]) <= halves).astype(float),
    )


def squared_errors(errors: Array, covariances: Array) -> Array:
    """Return the squared errors (...) in units of their covariances."""
    solved = np.asarray(np.linalg.solve(covariances, errors[..., None]), dtype=float)
    return (errors * solved[..., 0]).sum(axis=-1)


class _Cameras:
    """One camera above each robot of a case, connected as over the bus."""

    def __init__(self, case: Case, robot: RobotDescription, count: int, seed: int) -> None:
        self._key = SENSOR_POSE.key(robot.name)
        noise, sensor = CameraNoise(), robot.pose_sensor
        if case.camera == MOUNTED:
            noise = replace(
                noise,
                mounting_m=sensor.mounting_m,
                mounting_rad=math.radians(sensor.mounting_deg),
            )
        self._cameras = [Camera(noise, np.random.default_rng([seed + i, 3])) for i in range(count)]
        if not case.camera:
            self._cameras = []
        self._off: Array = np.zeros((count, 3))
        if case.camera == CONSTANT:
            directions = np.random.default_rng([seed, 4]).uniform(0.0, 2.0 * np.pi, count)
            self._off[:, 0] = _CONSTANT_M * np.cos(directions)
            self._off[:, 1] = _CONSTANT_M * np.sin(directions)

    def watch(self, i: int, estimator: StateEstimator, true: SE2, now_s: float) -> None:
        """Capture robot `i`, and forward the finished frames."""
        if not self._cameras:
            return
        heard: list[Sample] = []
        for frame in self._cameras[i].capture(now_s, true):
            seen = PoseStamped.planar(SE2(frame.pose + self._off[i]), nanoseconds(frame.taken_s))
            heard.append(Sample(self._key, encode_pose(seen), b""))
        estimator.pose_sensor.receive(heard, now_s, nanoseconds(now_s))
        estimator.pose_sensor.step(now_s, at_rest=False)


def nanoseconds(now_s: float) -> int:
    """Convert a time to its stamp."""
    return round(now_s * 1e9)
