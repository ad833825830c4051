"""`tsd-mock`: robot node with a simulated robot; same bus interface as a real one."""

from __future__ import annotations

import argparse
import contextlib
import math
import threading
from typing import Self

import numpy as np

from tsd_twin import robots
from tsd_twin.bus import Bus
from tsd_twin.cli import flags, node_program, program, robot_flags
from tsd_twin.cli.node_program import Companion
from tsd_twin.errors import TwinError
from tsd_twin.hardware.robot_io import RobotIO
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.robots import RobotDescription, SingularityDescription, description_of_kind
from tsd_twin.sensors.pose import Camera, CameraNoise
from tsd_twin.simulation import BoardModel, DegradedRobot, StuckJoint, Wear
from tsd_twin.simulation.wear import USUAL_LEAN_DEG

MOST_ROBOTS = 64
_LOOK_S = 0.01
"""Polling period of the camera for poses of the simulated robot."""

PARSER = program.parser(
    "tsd-mock",
    "A simulated robot on the bus.",
    [
        "tsd-mock                                   the triple singularity drive",
        "tsd-mock --robot my.toml --id left         a robot of your own, under another id",
        "tsd-mock --listen tcp/127.0.0.1:0          on a free port, which it prints",
        "tsd-mock --noise 1                         with the noise of the description",
        "tsd-mock --jam module2_alpha@3             with a gimbal that sticks at 3 degrees",
        "tsd-mock --wear module2_wheel=-5%@20       with a wheel that loses speed after 20 s",
        "tsd-mock --noise 1 --errors 1              and all that is wrong with a built robot",
        "tsd-mock --robot my.toml --machine built.toml      a machine that has been calibrated",
        "tsd-mock --noise 1 --camera                and a camera above the floor, which it fuses",
        "tsd-mock --plant mujoco                    rigid bodies on a floor, not equations",
        "tsd-mock --id lab --count 20               twenty robots, lab1 to lab20",
        "tsd-mock --join https://lab.example:7448 --code 7K3M-9Q2X-HT4W-0B8N      joins a router",
    ],
)


class OverheadCamera:
    """Simulated camera: publishes the true pose on `sensor/pose`, with delay and noise.

    It uses only the bus, like the computer of a real camera. Use it as a context manager.
    """

    def __init__(self, bus: Bus, robot_id: str, seed: int | None = 0) -> None:
        self._camera = Camera(CameraNoise(), np.random.default_rng(seed))
        self._truths = bus.subscriber(topics.TRUTH.key(robot_id), 8)
        topic = topics.SENSOR_POSE
        self._poses = bus.publisher(topic.key(robot_id), topic.qos, topic.type)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._truths.close()
        self._poses.close()

    def _run(self) -> None:
        start_ns = None
        while not self._stop.wait(_LOOK_S):
            for sample in self._truths.take_samples():
                truth = decode_odometry(sample.payload)
                start_ns = truth.stamp_ns if start_ns is None else start_ns
                now_s = (truth.stamp_ns - start_ns) * 1e-9
                for frame in self._camera.capture(now_s, SE2(truth.xy_heading)):
                    stamp_ns = start_ns + round(frame.taken_s * 1e9)
                    message = PoseStamped.planar(SE2(frame.pose), stamp_ns)
                    self._poses.put(encode_pose(message))


def joints(robot: RobotDescription, args: argparse.Namespace) -> RobotIO:
    """Return simulated joints behind a simulated board."""
    pose = pose_at(robot, args)
    jams = [StuckJoint.parse(text, robot) for text in args.jam]
    wear = [Wear.parse(text, robot) for text in args.wear]
    machine, believed = robot, None
    if args.machine:
        believed = description_of_kind(robot, SingularityDescription)
        machine = robots.load_robot(args.machine)
    simulated = DegradedRobot(
        machine,
        wear,
        jams=jams,
        seed=args.seed,
        noise=args.noise,
        pose=pose,
        plant=args.plant,
        errors=args.errors,
        believed=believed,
    )
    return BoardModel(robot, simulated)


def pose_at(robot: RobotDescription, args: argparse.Namespace) -> SE2 | None:
    """Return the start pose from `--at`, if given."""
    return start_pose(args.at, robot) if args.at else None


def start_pose(text: str, robot: RobotDescription) -> SE2:
    """Parse the start pose of `--at`."""
    if robot.kinematics().pose_type is not SE2:
        raise TwinError(f"--at: {robot.name} stays where it is, only its sphere turns")
    try:
        x, y, heading_deg = (float(number) for number in text.split(","))
    except ValueError as error:
        raise TwinError(f"--at: '{text}' is not like 1.5,-1,90: m, m, degrees") from error
    if not all(math.isfinite(number) for number in (x, y, heading_deg)):
        raise TwinError(f"--at: '{text}' has to be finite numbers")
    return SE2(np.array([x, y, math.radians(heading_deg)]))


def companion(
    bus: Bus, robot_id: str, robot: RobotDescription, args: argparse.Namespace
) -> Companion:
    """Return the simulated camera of `--camera`."""
    if not args.camera:
        return contextlib.nullcontext()
    if robot.kinematics().pose_type is not SE2:
        raise TwinError(f"--camera: {robot.name} stays where it is, only its sphere turns")
    return OverheadCamera(bus, robot_id, args.seed)


def main() -> None:
    """Parse the flags and run."""
    flags.add(PARSER, "--seed", "of the noise", flags.SEED, 0)
    flags.add(PARSER, "--noise", "times [noise]", flags.SCALE, 0.0, "SCALE")
    robot_flags.add_errors_flag(PARSER)
    text = "description of the simulated machine, if the controller has another: a calibrated one"
    flags.add(PARSER, "--machine", text, metavar="FILE")
    text = "where it stands at the start, m and degrees; default 0,0,0"
    flags.add(PARSER, "--at", text, metavar="X,Y,DEGREES")
    text = f"let a gimbal stick once it leans so far, {USUAL_LEAN_DEG:g} degrees unless given"
    flags.add(PARSER, "--jam", text, metavar="GIMBAL[@DEGREES]", repeated=True)
    text = (
        "let a joint be slower, as in module2_alpha=-30%%, or the battery weaker, as in "
        "battery=-1V, after so many seconds of driving, 0 unless given"
    )
    flags.add(PARSER, "--wear", text, metavar="PART=-SIZE[@SECONDS]", repeated=True)
    text = "a camera above the floor tells the bus where it is: 24 frames/s, 80 ms late"
    PARSER.add_argument("--camera", action="store_true", help=text)
    text = (
        "robots in this process, with ids that end in 1 to N; --zenoh-config is then the folder "
        "with their configurations"
    )
    flags.add(PARSER, "--count", text, flags.whole(1, MOST_ROBOTS), 1, metavar="N")
    robot_flags.add_plant_flag(PARSER)
    node_program.serve(PARSER, joints, pose_at, companion)


if __name__ == "__main__":
    main()
