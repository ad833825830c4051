"""Drives of sound and faulty robots on the independent plants, as a shadow twin receives them.

A fault changes the plant: its motors, servos or geometry. The estimate, with its camera, is the
project's, as on a robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from research.open_loop import PERIOD_S, Manoeuvre, nanoseconds, recorded_setpoints
from tests.independent.drive import plant_of
from tsd_twin import robots
from tsd_twin.client.virtual import PERIOD_S as _PERIOD_S
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import SENSOR_POSE, Sample
from tsd_twin.sensors.pose import Camera, CameraNoise

assert PERIOD_S == _PERIOD_S
EVERY = 2
"""Periods between two published states."""
LOSS, SLOW, SLIP_RAD, TWISTED_RAD = 0.05, 0.30, math.radians(0.5), math.radians(8.0)
SCALES = (1.0, 0.6, 3.0)
"""Stiffness of wheel loops relative to the described one."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Kind of fault of a robot, and its manoeuvre."""

    robot: str
    kind: str = ""
    """wheel, radius, servo, zero, mount, or "" for a sound robot; two are joined by `+`."""
    begin_s: float = 0.0
    """Start time; 0 from the start."""
    drive: str = "wander"
    intermittent: bool = False
    """1.5 s in 4."""
    integral: bool = True
    """Whether the loops of measured wheels have an integral part."""
    camera: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Messages for the twin of a robot."""

    robot: str
    fault: Fault
    parts: tuple[str, ...]
    """Names of the faulty joints."""
    names: list[str]
    stamps_s: np.ndarray
    joints: np.ndarray
    setpoints: np.ndarray
    poses: np.ndarray
    """Planar poses (n, 3), or orientations (n, 4) of a sphere."""
    twists: np.ndarray

    def messages(self) -> Iterator[tuple[int, JointState, JointState, Odometry]]:
        zero = np.zeros((3, 3))
        rows = zip(self.stamps_s, self.joints, self.setpoints, self.poses, self.twists, strict=True)
        for t_s, joints, setpoint, pose, twist in rows:
            stamp_ns = nanoseconds(t_s)
            yield (
                stamp_ns,
                JointState(self.names, joints, joints, stamp_ns),
                JointState(self.names, setpoint, setpoint, stamp_ns),
                Odometry.of(
                    SE2(pose.copy()) if len(pose) == 3 else SO3(pose.copy()),
                    *(twist, zero, zero, stamp_ns),
                ),
            )


def manoeuvre(drive: str, seed: int, robot: Any) -> Manoeuvre:
    """Return random twists, each held for a while, as by a gentle or an aggressive operator."""
    random = np.random.default_rng([seed, 21])
    top, turn = robot.limits.speed_mps, min(robot.limits.turn_rate_rad_per_s, 1.5)
    times, twists, t_s = [], [], 0.0
    while t_s < 4000.0:
        angle = random.uniform(0.0, 2.0 * np.pi)
        speed = top if drive == "stick" else random.uniform(0.35, 0.8) * top
        rate = random.choice([-1.0, 1.0]) if drive == "stick" else random.uniform(-0.7, 0.7)
        times.append(t_s)
        twists.append((speed * math.cos(angle), speed * math.sin(angle), turn * rate))
        t_s += random.uniform(0.4, 1.0) if drive == "stick" else random.uniform(1.5, 3.0)

    def twist(t_s: float) -> Sequence[float]:
        if drive == "stops" and t_s % 6.0 > 4.0:
            return (0.0, 0.0, 0.0)
        return twists[int(np.searchsorted(times, t_s, side="right")) - 1]

    return Manoeuvre(f"{drive} {seed}", twist)


def record(fault: Fault, count: int, seed: int, seconds: float) -> list[Recorded]:
    """Drive `count` robots alike, each with a different faulty part, from consecutive seeds."""
    robot: Any = robots.load_robot(fault.robot)
    plant = plant_of(robot, count, seed, None)
    kinematics = robot.kinematics()
    names = [joint.name for joint in kinematics.joints]
    faults = _Faults(plant, fault, names, seed)
    setpoints, start = recorded_setpoints(robot, manoeuvre(fault.drive, seed, robot), seconds)
    estimators = [StateEstimator(robot) for _ in range(count)]
    sensor, key = robot.pose_sensor, SENSOR_POSE.key(robot.name)
    mounted = replace(
        CameraNoise(),
        mounting_m=sensor.mounting_m,
        mounting_rad=math.radians(sensor.mounting_deg),
    )
    cameras = [Camera(mounted, np.random.default_rng([seed + i, 22])) for i in range(count)]
    planar = hasattr(plant, "pose")
    marks, kept = SE2.identity(), []
    for i, setpoint in enumerate(setpoints):
        now_s = (i + 1) * PERIOD_S
        if i > 0:
            plant.advance(PERIOD_S)
        measured = plant.measure()
        poses = SE2(plant.pose.copy()) if planar else marks
        if i == start:
            marks = poses
            for estimator in estimators if planar else ():
                estimator.set_pose(SE2.identity())
        truths = marks.inverse() @ poses if planar else marks
        for k, estimator in enumerate(estimators):
            estimator.advance(now_s, measured[k], setpoints[max(i - 1, 0)], PERIOD_S)
            if planar and fault.camera and i >= start:
                heard = [
                    Sample(
                        key,
                        encode_pose(PoseStamped.planar(SE2(f.pose), nanoseconds(f.taken_s))),
                        b"",
                    )
                    for f in cameras[k].capture(now_s, SE2(truths.xy_heading[k]))
                ]
                estimator.pose_sensor.receive(heard, now_s, nanoseconds(now_s))
                estimator.pose_sensor.step(now_s, at_rest=False)
        if i >= start and i % EVERY == 0:
            poses_now = [each.pose.xy_heading if planar else each.pose.wxyz for each in estimators]
            twists = [each.end_twist for each in estimators]
            kept.append(
                (now_s - start * PERIOD_S, measured[:, : len(names)].copy(), poses_now, twists, i)
            )
        faults.advance((i - start) * PERIOD_S)
        plant.command(setpoint)
        faults.command(setpoint)
    times, joints, poses, twists, places = zip(*kept, strict=True)
    shown = np.array(times), np.array(joints), np.array(poses), np.array(twists)
    return [
        Recorded(
            fault.robot, fault, faults.parts[k], names, shown[0],
            shown[1][:, k], setpoints[list(places)], shown[2][:, k], shown[3][:, k],
        )
        for k in range(count)
    ]  # fmt: skip


class _Faults:
    """Breaks parts of a plant's robots."""

    def __init__(self, plant: Any, fault: Fault, names: list[str], seed: int) -> None:
        self._plant, self._fault = plant, fault
        random = np.random.default_rng([seed, 23])
        self._gimballed = hasattr(plant, "modules")
        wheels = [
            i for i, name in enumerate(names) if not self._gimballed or name.endswith("wheel")
        ]
        angles = [i for i in range(len(names)) if i not in wheels]
        kinds = fault.kind.split("+") if fault.kind else []
        self._sign = random.choice([-1.0, 1.0], plant.robots)
        self._broken: list[list[tuple[str, int]]] = []
        for k in range(plant.robots):
            pools = [angles if kind in ("servo", "zero") else wheels for kind in kinds]
            chosen: list[int] = []
            for pool in pools:
                free = [each for each in pool if each not in chosen]
                chosen.append(
                    free[(seed + k) % len(free)] if not chosen else int(random.choice(free))
                )
            self._broken.append(list(zip(kinds, chosen, strict=True)))
        self.parts = [tuple(names[i] for _, i in broken) for broken in self._broken]
        self._on = False
        self._share = np.ones((plant.robots, len(names)))
        if self._gimballed:
            plant.top_rate = np.broadcast_to(plant.top_rate, plant.angles.shape).copy()
        else:
            wheel_loop = plant.wheels
            wheel_loop.integral_per_s *= float(fault.integral)
            if fault.integral or fault.kind:
                scale = np.array(SCALES)[np.arange(plant.robots) % len(SCALES)]
                wheel_loop.gain = wheel_loop.gain * scale[:, None]

    def advance(self, t_s: float) -> None:
        fault = self._fault
        on = bool(fault.kind) and t_s >= fault.begin_s
        if fault.intermittent:
            on = on and (t_s - fault.begin_s) % 4.0 < 1.5
        if on is not self._on:
            self._on = on
            for k, broken in enumerate(self._broken):
                for kind, i in broken:
                    self._break(k, kind, i, 1.0 if on else -1.0)

    def command(self, setpoint: np.ndarray) -> None:
        if not self._gimballed:
            self._plant.wheels.goal = setpoint * self._share

    def _break(self, k: int, kind: str, i: int, by: float) -> None:
        plant = self._plant
        module, axis = (i // 3, i % 3) if self._gimballed else (i, 2)
        size = self._sign[k]
        if kind == "wheel" and self._gimballed:
            plant.spin_share[k, module] *= (1.0 - LOSS) ** by
        elif kind == "wheel":
            self._share[k, i] *= (1.0 - LOSS) ** by
        elif kind == "radius":
            plant.radius_m[k, module] *= (1.0 - LOSS) ** by
        elif kind == "servo":
            plant.top_rate[k, module, axis] *= (1.0 - SLOW) ** by
        elif kind == "zero":
            plant.slip_horn(k, module, axis, by * size * SLIP_RAD)
        elif kind == "mount" and self._gimballed:
            c, s = math.cos(by * size * TWISTED_RAD), math.sin(by * size * TWISTED_RAD)
            tangent, outward = plant.tangent[k, module].copy(), plant.outward[k, module].copy()
            plant.tangent[k, module] = c * tangent + s * outward
            plant.outward[k, module] = c * outward - s * tangent
        elif kind == "mount":
            plant.heading[k, module] += by * size * TWISTED_RAD
        else:
            raise AssertionError(kind)


Recorder = Callable[[Fault, int, int, float], list[Recorded]]
