"""`tsd-mock`: a simulated robot on the bus; nothing on the bus can tell it from a machine."""

from __future__ import annotations

import argparse

from tsd_twin import description, program, robots
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
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    stop = program.stop_event(args)
    text = robots.text(args.robot)
    robot = robots.parse(text, args.robot)
    robot_id = args.id or robot.name
    board = Board(robot, SimRobot(robot, seed=args.seed, noise=args.noise))
    with program.node_bus(args) as bus:
        node = RobotNode(
            bus,
            robot_id,
            robot,
            board,
            Description(text, description.urdf(robot, description.parts(robot))),
        )
        program.say_ready(f"tsd-mock {robot_id} on {' '.join(bus.endpoints()) or args.connect}")
        node.run(stop)


def main() -> None:
    """Read the flags and run."""
    program.add_robot_flags(PARSER)
    program.add_node_flags(PARSER)
    PARSER.add_argument("--seed", type=int, default=0, help="of the noise; default 0")
    PARSER.add_argument(
        "--noise", type=float, default=0.0, metavar="SCALE", help="times [noise]; default 0"
    )
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
