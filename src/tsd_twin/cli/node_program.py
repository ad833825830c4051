"""Common parts of the programs that run robot nodes; they differ in the hardware interface."""

from __future__ import annotations

import argparse
import copy
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from pathlib import Path

from tsd_twin import models, robots
from tsd_twin.bus import Bus, dialling_config
from tsd_twin.cli import joining, program, robot_flags
from tsd_twin.errors import TwinError
from tsd_twin.hardware.robot_io import RobotIO
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages import topics
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.node.authority import Authority
from tsd_twin.robots import RobotDescription

Flags = argparse.Namespace
Pose = SE2 | SO3
Companion = AbstractContextManager[object]
_SPACING_M, _IN_A_ROW = 2.0, 5
"""Start positions of several robots, so that none stands in another."""


def serve(
    made: argparse.ArgumentParser,
    joints: Callable[[RobotDescription, Flags], RobotIO],
    pose: Callable[[RobotDescription, Flags], Pose | None] | None = None,
    companion: Callable[[Bus, str, RobotDescription, Flags], Companion] | None = None,
) -> None:
    """Add the flags of a node to the parser `made`, parse them, and run nodes until a signal.

    `joints` opens the hardware interface, `pose` returns the initial pose, and `companion` starts a
    companion service on the same bus. With a flag `--count`, that many robots run, each with its
    own id, session and thread.
    """
    robot_flags.add_robot_flags(made)
    program.add_node_flags(made)
    joining.add_join_flags(made)

    def body(args: Flags) -> None:
        stop = program.stop_event(args)
        joining.join(args)
        text = robots.read_description(args.robot)
        robot = robots.parse_description(text, args.robot)
        shown = Description(text, models.robot_urdf(robot))
        with ExitStack() as stack:
            nodes: list[RobotNode] = []
            first: Bus | None = None
            for own in _flags_of_robots(args, robot):
                bus = _open_bus(own, first, stop)
                if bus is None:
                    return
                stack.enter_context(bus)
                first = first or bus
                robot_id = program.node_id(own, robot.name)
                # After any error from here on, the joints are closed, and so left at rest.
                io = stack.enter_context(closing(joints(robot, own)))
                start = pose(robot, own) if pose else None
                node = RobotNode(
                    bus, robot_id, robot, io, shown, pose=start, authority=authority(own, robot_id)
                )
                nodes.append(node)
                service = companion(bus, robot_id, robot, own) if companion else nullcontext()
                stack.enter_context(service)
                where = " ".join(first.endpoints()) or own.zenoh_config or own.connect
                if len(nodes) == getattr(args, "count", 1):
                    program.say_ready(f"{made.prog} {robot_id} on {where}")
            _run(nodes, stop)

    program.run(made, body)


def authority(args: Flags, robot_id: str) -> Authority | None:
    """Return the check of signatures that the flags of a robot ask for, or None."""
    file = program.operators_file(args)
    if file is None:
        return None
    # Late, because it needs the extra `tls`.
    from tsd_twin.security.operator_list import OperatorFile
    from tsd_twin.security.robot_authority import RobotAuthority

    return RobotAuthority(robot_id, OperatorFile(file))


def _flags_of_robots(args: Flags, robot: RobotDescription) -> list[Flags]:
    """Return the flags of each robot: with `--count`, different ids, seeds and positions.

    Raises:
        TwinError: If an id is invalid, or a flag is for one robot only.
    """
    count = getattr(args, "count", 1)
    if count == 1:
        return [args]
    if args.at is not None:
        raise TwinError("--at is for one robot: those of --count stand 2 m apart")
    planar = robot.kinematics().pose_type is SE2
    every: list[Flags] = []
    for number in range(count):
        own = copy.copy(args)
        own.id = topics.checked(f"{args.id or robot.name}{number + 1}")
        own.seed = args.seed + number
        row, column = divmod(number, _IN_A_ROW)
        own.at = f"{_SPACING_M * row},{_SPACING_M * column},0" if planar else None
        if args.zenoh_config:
            own.zenoh_config = str(Path(args.zenoh_config) / f"{own.id}.json5")
        every.append(own)
    return every


def _open_bus(args: Flags, first: Bus | None, stop: threading.Event) -> Bus | None:
    """Open the bus of a robot; without a configuration, the others dial the first one."""
    if first is None or args.zenoh_config:
        return program.node_bus(args, stop)
    return Bus(dialling_config(first.endpoints()[:1]))


def _run(nodes: list[RobotNode], stop: threading.Event) -> None:
    """Run nodes until `stop` is set, or one fails; then all end."""
    if len(nodes) == 1:
        nodes[0].run(stop)
        return
    failures: list[BaseException] = []

    def run(node: RobotNode) -> None:
        try:
            node.run(stop)
        except BaseException as error:  # Handed over to the main thread.
            failures.append(error)
            stop.set()

    threads = [threading.Thread(target=run, args=(node,)) for node in nodes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
