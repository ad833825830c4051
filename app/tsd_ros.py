"""`tsd-ros`: the robots on the bus as nodes of ROS 2."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import dataclasses
import os
import threading
from functools import partial

from tsd_twin import models
from tsd_twin.bus import Bus, Config, as_client, client_config, from_file
from tsd_twin.cli import flags, node_program, program
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.robots import ExternalDescription, description_of_kind, parse_description

with program.requires("tsd-ros", "ros"):
    from tsd_twin.adapters.ros.adapter import MeshServer, serve_ros
    from tsd_twin.adapters.ros.dds_port import DdsPort, check_ros
    from tsd_twin.adapters.ros.external_robot import (
        ExternalLimits,
        ExternalRobot,
        describe,
        endpoints,
    )
    from tsd_twin.adapters.ros.port import ADAPTER, Endpoints, OpenPort, PortCallbacks
    from tsd_twin.adapters.ros.zenoh_port import ZenohPort
    from tsd_twin.adapters.ros_topics import RosNames


OPERATOR = "ros"
ROUTER = "tcp/127.0.0.1:7447"
"""Default endpoint of rmw_zenohd."""
NODE_ENDPOINT = "tcp/127.0.0.1:7448"
"""Default endpoint of an imported robot's bus, next to the router's port."""
_PATIENCE_S = 3.0
_LAST_DOMAIN = 232

PARSER = program.parser(
    "tsd-ros",
    "Show the robots on the bus to ROS 2 as nodes, and drive them by cmd_vel. Over the protocol of "
    "rmw_zenoh, the default, no ROS has to be installed here. With --import, the other way round: "
    "show and drive a robot that has ROS topics only.",
    [
        "tsd-ros --connect tcp/127.0.0.1:7448     a robot there, and rmw_zenohd at its own port",
        "tsd-ros                                  ROS nodes join the robot's own port 7447",
        "tsd-ros --ros-connect tcp/ros-pc:7447    the router of ROS on another computer",
        "tsd-ros --rmw dds                        a node of the rclpy that is sourced here",
        "tsd-ros --view-only                      nothing can be driven",
        "tsd-ros --import burger                  the robot at /odom and /cmd_vel, for a dashboard "
        f"with --connect {NODE_ENDPOINT}",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    stop = program.stop_event(args)
    if args.imported is not None:
        serve_imported(args, stop)
        return
    options = program.adapter_options(args)
    domain = domain_of(args)
    open_port, where = ports(args, domain)
    meshes = args.mesh_uri or MeshServer(args.mesh_host, args.mesh_port)

    def ready() -> None:
        program.say_ready(f"tsd-ros on {where}, domain {domain}")

    open_bus = partial(program.client_bus, args)
    try:
        serving = serve_ros(
            open_bus, open_port, meshes, stop, ready, require_echo=args.require_echo, **options
        )
        asyncio.run(serving)
    finally:
        if isinstance(meshes, MeshServer):
            meshes.close()


def serve_imported(args: argparse.Namespace, stop: threading.Event) -> None:
    """Run the node of a robot that has only ROS topics until `stop` is set."""
    name = topics.checked(args.imported)
    if args.view_only:
        raise TwinError("--view-only does not go with --import: who does not arm it only looks on")
    limits = ExternalLimits(
        args.import_speed, args.import_turn_rate, args.import_acceleration,
        sideways=args.import_drive == "omni",
    )  # fmt: skip
    describe(name, "", limits)  # Report implausible limits before opening anything.
    domain = domain_of(args)
    open_port, where = ports(args, domain, endpoints(stamped=args.stamped))
    names = RosNames(args.import_namespace.strip("/"), shared=bool(args.import_namespace))

    external = ExternalRobot(
        partial(open_port, names),
        names,
        args.import_timeout,
        stamped=args.stamped,
        description_s=args.import_wait,
    )
    with contextlib.ExitStack() as stack:
        robot_io = stack.enter_context(contextlib.closing(external))
        if (bus := program.node_bus(args, stop)) is None:
            return
        stack.enter_context(bus)
        text = describe(name, robot_io.urdf, limits)
        robot = description_of_kind(parse_description(text, name), ExternalDescription)
        robot_io.configure(robot)
        shown = Description(text, models.robot_urdf(robot))
        node = RobotNode(
            bus, name, robot, robot_io, shown, authority=node_program.authority(args, name)
        )
        program.say_ready(
            f"tsd-ros {name} of {where}, domain {domain}, on {' '.join(bus.endpoints())}"
        )
        node.run(stop)


def domain_of(args: argparse.Namespace) -> int:
    """Return the ROS domain."""
    if args.domain is not None:
        return args.domain
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > _LAST_DOMAIN:
        raise TwinError(f"ROS_DOMAIN_ID is '{text}', not a number from 0 to {_LAST_DOMAIN}")
    return int(text)


def ports(args: argparse.Namespace, domain: int, ends: Endpoints = ADAPTER) -> tuple[OpenPort, str]:
    """Return a function that opens ports, and their endpoint."""
    if args.rmw == "dds":
        check_ros(ends)
        return partial(DdsPort, domain, endpoints=ends), "DDS"
    config = ros_config(args)
    try:
        Bus(config).close()
    except TwinError as error:
        raise TwinError(
            f"no router of ROS at {config.where} ({error}): start rmw_zenohd, or name another "
            "with --ros-connect"
        ) from error

    def open_port(names: RosNames, inputs: PortCallbacks | None) -> ZenohPort:
        return ZenohPort(Bus(config), domain, names, inputs, ends)

    return open_port, config.where


def ros_config(args: argparse.Namespace) -> Config:
    """Return the configuration of a client session to the ROS router, which reaches all nodes."""
    if args.ros_zenoh_config:
        return as_client(from_file(args.ros_zenoh_config), _PATIENCE_S)
    return as_client(client_config([args.ros_connect]), _PATIENCE_S)


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    program.add_signature_flags(PARSER)
    program.add_adapter_flags(PARSER, OPERATOR)
    made = PARSER.add_argument_group("ROS", "docs/ros2.md goes step by step.")
    text = "middleware of ROS; default zenoh; dds is a node of rclpy, of a ROS that is sourced"
    flags.add(made, "--rmw", text, default="zenoh", choices=["zenoh", "dds"])
    text = "where the router of ROS (rmw_zenohd) listens"
    flags.add(made, "--ros-connect", text, default=ROUTER, metavar="ENDPOINT")
    text = "a JSON5 file for that connection, for TLS"
    flags.add(made, "--ros-zenoh-config", text, metavar="FILE")
    text = "domain of ROS; default ROS_DOMAIN_ID, or 0"
    flags.add(made, "--domain", text, flags.whole(0, _LAST_DOMAIN), metavar="ID")
    text = "address that serves meshes for robot_description over HTTP"
    flags.add(made, "--mesh-host", text, default="127.0.0.1", metavar="HOST")
    text = "its port; default 0, a free one"
    flags.add(made, "--mesh-port", text, flags.PORT, 0, "PORT")
    text = "what goes before the names of meshes instead, as package://my_robot/meshes/"
    flags.add(made, "--mesh-uri", text, metavar="URI")
    text = "cmd_vel moves a robot only as TwistStamped with the stamp of the newest odom"
    made.add_argument("--require-echo", action="store_true", help=text)
    _add_import_flags()
    program.run(PARSER, serve)


def _add_import_flags() -> None:
    made = PARSER.add_argument_group(
        "a robot of others",
        "It needs odom, and at best joint_states and robot_description; docs/ros2.md says what "
        "cannot be promised.",
    )
    text = "show the robot of ROS on the bus under this id, and drive it by cmd_vel"
    flags.add(made, "--import", text, metavar="NAME", dest="imported")
    text = "namespace of its topics, as robot1 for /robot1/odom; default none"
    flags.add(made, "--import-namespace", text, default="", metavar="NAME")
    text = "diff, the default, drives forward and turns; omni drives sideways, too"
    flags.add(made, "--import-drive", text, default="diff", choices=["diff", "omni"])
    speed, turn_rate, acceleration, _ = dataclasses.astuple(ExternalLimits())
    for name, text, usual, unit in (
        ("speed", "speed limit", speed, "M/S"),
        ("turn-rate", "limit of the turn rate", turn_rate, "RAD/S"),
        ("acceleration", "how fast its speed is changed", acceleration, "M/S2"),
        ("timeout", "age of odom beyond which it is not driven", 0.5, "S"),
        ("wait", "time to wait for robot_description at the start", 5.0, "S"),
    ):
        flags.add(made, f"--import-{name}", text, flags.POSITIVE, usual, unit)
    text = "drive by TwistStamped instead of Twist"
    made.add_argument("--stamped", action="store_true", help=text)
    text = "where the bus of this robot listens"
    flags.add(made, "--listen", text, default=NODE_ENDPOINT, metavar="ENDPOINT")


if __name__ == "__main__":
    main()
