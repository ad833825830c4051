"""`tsd-mock`: a simulated robot on the bus; nothing on the bus can tell it from a machine."""

from __future__ import annotations

import argparse
import math

import numpy as np

from tsd_twin import description, program, robots
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2
from tsd_twin.messages.service import Description
from tsd_twin.node import RobotNode
from tsd_twin.sim import Board, SimRobot

PARSER = program.parser(
    "tsd-mock",
    "A simulated robot on the bus.",
    [
        "tsd-mock                                   the triple singularity drive",
        "tsd-mock --robot my.toml --id left         a robot of your own, under another id",
        "tsd-mock --listen tcp/127.0.0.1:0          on a free port, which it prints",
        "tsd-mock --noise 1                         with the noise of the description",
        "tsd-mock --plant mujoco                    rigid bodies on a floor, not equations",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    stop = program.stop_event(args)
    text = robots.text(args.robot)
    robot = robots.parse(text, args.robot)
    robot_id = args.id or robot.name
    pose = start_pose(args.at, robot) if args.at else None
    simulated = SimRobot(robot, seed=args.seed, noise=args.noise, pose=pose, plant=args.plant)
    board = Board(robot, simulated)
    with program.node_bus(args) as bus:
        node = RobotNode(
            bus,
            robot_id,
            robot,
            board,
            Description(text, description.urdf(robot, description.parts(robot))),
            pose=pose,
        )
        program.say_ready(f"tsd-mock {robot_id} on {' '.join(bus.endpoints()) or args.connect}")
        node.run(stop)


def start_pose(text: str, robot: robots.Robot) -> SE2:
    """Return the pose that `--at` asks for.

    Raises:
        TwinError: it is no x, y and heading, or the robot has no such pose.
    """
    if robot.kinematics().space is not SE2:
        raise TwinError(f"--at: {robot.name} stays where it is, only its sphere turns")
    try:
        x, y, heading_deg = (float(number) for number in text.split(","))
    except ValueError as error:
        raise TwinError(f"--at: '{text}' is not like 1.5,-1,90: m, m, degrees") from error
    if not all(math.isfinite(number) for number in (x, y, heading_deg)):
        raise TwinError(f"--at: '{text}' has to be finite numbers")
    return SE2(np.array([x, y, math.radians(heading_deg)]))


def main() -> None:
    """Read the flags and run."""
    program.add_robot_flags(PARSER)
    program.add_node_flags(PARSER)
    PARSER.add_argument("--seed", type=int, default=0, help="of the noise; default 0")
    PARSER.add_argument(
        "--noise", type=float, default=0.0, metavar="SCALE", help="times [noise]; default 0"
    )
    PARSER.add_argument(
        "--at",
        metavar="X,Y,DEGREES",
        help="where it stands at the start, m and degrees; default 0,0,0",
    )
    program.add_plant_flag(PARSER)
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
