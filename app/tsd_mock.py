"""`tsd-mock`: a simulated robot on the bus; nothing on the bus can tell it from a machine."""

from __future__ import annotations

import argparse

from tsd_twin import program, robot_program
from tsd_twin.node import RobotIO
from tsd_twin.robots import Robot
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


def joints(robot: Robot, args: argparse.Namespace) -> RobotIO:
    """Return the simulated joints, behind a simulated board."""
    return Board(robot, SimRobot(robot, seed=args.seed, noise=args.noise))


def main() -> None:
    """Read the flags and run."""
    PARSER.add_argument("--seed", type=int, default=0, help="of the noise; default 0")
    PARSER.add_argument(
        "--noise", type=float, default=0.0, metavar="SCALE", help="times [noise]; default 0"
    )
    robot_program.serve(PARSER, joints)


if __name__ == "__main__":
    main()
