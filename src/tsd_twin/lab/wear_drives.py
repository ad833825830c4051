"""Drives of simulated robots whose parts wear, each with its shadow twin."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.client.sync import RobotClient
from tsd_twin.client.virtual import SimulationLink
from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lab import manoeuvres as lab_manoeuvres
from tsd_twin.lab.manoeuvres import TwistAt
from tsd_twin.lab.robot_health import Health
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.robots import OmniDescription, RobotDescription, SingularityDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.sensors.pose import Camera
from tsd_twin.shadow import Drift, ShadowTwin
from tsd_twin.simulation import BATTERY, DegradedRobot, Wear


def _arc(random: np.random.Generator) -> TwistAt:
    """Drive an arc with constant twist, at 80 % of the top speed."""
    angle, side = random.uniform(0.0, 2.0 * np.pi), random.choice([-1.0, 1.0])
    vx, vy = 0.8 * math.cos(angle), 0.8 * math.sin(angle)
    return lambda _: (vx, vy, 0.6 * side)


def _line(random: np.random.Generator) -> TwistAt:
    """Drive straight at a constant speed of at least half the top speed."""
    angle, speed = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.5, 1.0)
    twist = (speed * math.cos(angle), speed * math.sin(angle), 0.0)
    return lambda _: twist


MANOEUVRES = lab_manoeuvres.MANOEUVRES | {"arc": _arc, "line": _line}
STAND, MIXED = "stand", "mixed"
_TURN_S = 30.0
"""Duration of each manoeuvre if they are mixed."""


@dataclass(frozen=True, slots=True)
class WearScenario:
    """Simulated robot with its shadow twin."""

    robot: str
    plant: str
    errors: float
    seed: int
    manoeuvre: str
    seconds: float
    camera: bool = False
    wear: str = ""
    """Wear as in `tsd-mock --wear`, or "" for a healthy robot."""
    wear_s: float = 0.0
    """Time at which the wear begins."""
    gyro: bool = False

    def description(self) -> RobotDescription:
        """Return the description of the robot.

        Raises:
            TwinError: If the robot cannot have a gyro.
        """
        robot = robots.load_robot(self.robot)
        if not self.gyro or any(joint.name == "gyro" for joint in robot.sensors):
            return robot
        if not isinstance(robot, SingularityDescription | OmniDescription):
            raise TwinError(f"--gyro: {robot.name} does not drive over a floor")
        return msgspec.structs.replace(robot, gyro=Gyro())

    @property
    def worn_part(self) -> str:
        """Name of the worn part, or "" for a healthy robot."""
        return self.wear.partition("=")[0]

    @property
    def kind(self) -> str:
        """Kind of the worn part and amount of wear, such as `wheel -5%`, or "" if healthy."""
        part, _, size = self.wear.partition("=")
        if part in ("", BATTERY):
            return f"{part} {size}".strip()
        joints = {joint.name: joint.kind for joint in self.description().kinematics().joints}
        return f"{'servo' if joints[part] is JointKind.POSITION else 'wheel'} {size}"


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a case."""

    case: WearScenario
    named: list[tuple[float, Drift]]
    """Named parts; times since the wear began, or since the start."""
    compared_s: float
    processor_share: float
    """CPU time of the twin relative to the compared time."""

    @property
    def found_s(self) -> float:
        """Time until the worn part was named, or infinite."""
        return min(
            (t_s for t_s, drift in self.named if self._is_right(t_s, drift)), default=math.inf
        )

    @property
    def wrong(self) -> list[tuple[float, Drift]]:
        """Named parts that are healthy."""
        return [
            (t_s, drift)
            for t_s, drift in self.named
            if drift.part and not self._is_right(t_s, drift)
        ]

    def _is_right(self, t_s: float, drift: Drift) -> bool:
        return t_s >= 0.0 and self.case.worn_part == drift.part


def _twists(case: WearScenario, robot: RobotDescription) -> TwistAt:
    """Return the twist as a function of time, within the limits of the robot."""
    random = np.random.default_rng([case.seed, 5])
    made = {name: make(random) for name, make in MANOEUVRES.items()}
    scale = robot.kinematics().twist_scale_m
    top, turn = robot.limits.speed_mps / scale, robot.limits.turn_rate_rad_per_s
    names = [*made, STAND]

    def twist(t_s: float) -> tuple[float, float, float]:
        name = names[int(t_s / _TURN_S) % len(names)] if case.manoeuvre == MIXED else case.manoeuvre
        if name == STAND:
            return (0.0, 0.0, 0.0)
        x, y, z = made[name](t_s)
        return (top * x, top * y, turn * z / 3.0)

    return twist


def drive(case: WearScenario) -> Result:
    """Drive a robot with its twin."""
    robot = case.description()
    simulated = DegradedRobot(
        robot, seed=case.seed, noise=1.0, plant=case.plant, errors=case.errors
    )
    link = SimulationLink(robot, simulated, None)
    client = RobotClient(link, "lab")
    camera = Camera(robot.pose_sensor.camera_noise(), np.random.default_rng([case.seed, 7]))
    health, spent_s = Health(ShadowTwin(robot)), 0.0
    twist_at = _twists(case, robot)
    with client, client.control() as control:
        control.arm()
        begin_s = client.time_s
        worn = not case.wear
        for now_s in control.driving(lambda now_s: twist_at(now_s - begin_s), frame=BASE):
            t_s = now_s - begin_s
            if t_s >= case.seconds:
                break
            if not worn and t_s >= case.wear_s:
                simulated.wear(Wear.parse(case.wear, robot))
                worn = True
            pose = simulated.truth(now_s).pose
            if case.camera and isinstance(pose, SE2):
                for frame in camera.capture(now_s, pose):
                    seen = PoseStamped.planar(SE2(frame.pose), round(1e9 * frame.taken_s))
                    link.send_pose(encode_pose(seen))
            state = link.state()
            at_s = time.process_time()
            health.feed(state)
            health.look(t_s)
            spent_s += time.process_time() - at_s
    named = [(t_s - case.wear_s, drift) for t_s, drift in health.named]
    return Result(case, named, health.compared_s, spent_s / max(health.compared_s, 1e-9))


def wear_of_seed(wear: str, robot: RobotDescription, seed: int) -> str:
    """Return wear of the seed's joint, if the part is `wheel` or `servo`."""
    part, _, size = wear.partition("=")
    kind = {"wheel": JointKind.VELOCITY, "servo": JointKind.POSITION}.get(part)
    names = [joint.name for joint in robot.kinematics().joints if joint.kind is kind]
    if not names or part in [joint.name for joint in robot.kinematics().joints]:
        return wear
    return f"{names[seed % len(names)]}={size}"
