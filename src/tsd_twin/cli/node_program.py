"""Common parts of the programs that run a robot node; they differ in the hardware interface."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext

from tsd_twin import models, robots
from tsd_twin.bus import Bus
from tsd_twin.cli import program
from tsd_twin.hardware.robot_io import RobotIO
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.robots import RobotDescription

Flags = argparse.Namespace
Pose = SE2 | SO3
Companion = AbstractContextManager[object]


def serve(
    made: argparse.ArgumentParser,
    joints: Callable[[RobotDescription, Flags], RobotIO],
    pose: Callable[[RobotDescription, Flags], Pose | None] | None = None,
    companion: Callable[[Bus, str, RobotDescription, Flags], Companion] | None = None,
) -> None:
    """Add the flags of a node to the parser `made`, parse them, and run the node until a signal.

    `joints` opens the hardware interface, `pose` returns the initial pose, and `companion` starts a
    companion service on the same bus.
    """
    program.add_robot_flags(made)
    program.add_node_flags(made)

    def body(args: Flags) -> None:
        stop = program.stop_event(args)
        text = robots.read_description(args.robot)
        robot = robots.parse_description(text, args.robot)
        robot_id = args.id or robot.name
        shown = Description(text, models.robot_urdf(robot))
        # After any error from here on, the joints are closed, and so left at rest.
        with program.node_bus(args) as bus, closing(joints(robot, args)) as io:
            start = pose(robot, args) if pose else None
            node = RobotNode(bus, robot_id, robot, io, shown, pose=start)
            service = companion(bus, robot_id, robot, args) if companion else nullcontext()
            with service:
                program.say_ready(
                    f"{made.prog} {robot_id} on {' '.join(bus.endpoints()) or args.connect}"
                )
                node.run(stop)

    program.run(made, body)
