"""Common parts of the programs that run a robot node; they differ in the hardware interface."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from contextlib import AbstractContextManager

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


def _unknown(_robot: RobotDescription, _args: Flags) -> Pose | None:
    return None


def _no_companion(_bus: Bus, _robot_id: str, _robot: RobotDescription, _args: Flags) -> Companion:
    return contextlib.nullcontext()


def serve(
    made: argparse.ArgumentParser,
    joints: Callable[[RobotDescription, Flags], RobotIO],
    pose: Callable[[RobotDescription, Flags], Pose | None] = _unknown,
    companion: Callable[[Bus, str, RobotDescription, Flags], Companion] = _no_companion,
) -> None:
    """Add the flags of a node to the parser `made`, parse them, and run the node until a signal.

    `joints` opens the hardware interface, `pose` returns the initial pose, and `company` starts a
    companion service on the same bus.
    """
    program.add_robot_flags(made)
    program.add_node_flags(made)
    program.run(made, lambda args: _run(made.prog, args, joints, pose, companion))


def _run(
    name: str,
    args: Flags,
    joints: Callable[[RobotDescription, Flags], RobotIO],
    pose: Callable[[RobotDescription, Flags], Pose | None],
    companion: Callable[[Bus, str, RobotDescription, Flags], Companion],
) -> None:
    stop = program.stop_event(args)
    text = robots.read_description(args.robot)
    robot = robots.parse_description(text, args.robot)
    robot_id = args.id or robot.name
    shown = Description(text, models.robot_urdf(robot))
    # After any error from here on, the joints are closed, and so left at rest.
    with program.node_bus(args) as bus, contextlib.closing(joints(robot, args)) as io:
        node = RobotNode(bus, robot_id, robot, io, shown, pose=pose(robot, args))
        with companion(bus, robot_id, robot, args):
            program.say_ready(f"{name} {robot_id} on {' '.join(bus.endpoints()) or args.connect}")
            node.run(stop)
