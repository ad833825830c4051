"""`tsd-ros`: the robots on the bus as nodes of ROS 2."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import threading
from functools import partial

from tsd_twin import models
from tsd_twin.bus import Bus, Config, as_client, client_config, from_file
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.robots import ExternalDescription, description_of_kind, parse_description
from tsd_twin.security import Role

with program.requires("tsd-ros", "ros"):
    from tsd_twin.adapters.ros.adapter import MeshServer, serve_ros
    from tsd_twin.adapters.ros.dds_port import DdsPort, check_ros
    from tsd_twin.adapters.ros.external_robot import (
        ExternalLimits,
        ExternalRobot,
        describe,
        endpoints,
    )
    from tsd_twin.adapters.ros.port import ADAPTER, Endpoints, OpenPort, PortCallbacks, RosPort
    from tsd_twin.adapters.ros.zenoh_port import ZenohPort
    from tsd_twin.adapters.ros_messages import RosNames


OPERATOR = "ros"
ROUTER = "tcp/127.0.0.1:7447"
"""Default endpoint of rmw_zenohd."""
NODE_ENDPOINT = "tcp/127.0.0.1:7448"
"""Default endpoint of an imported robot's bus, next to the router's port."""
_PATIENCE_S = 3.0
_USUAL = ExternalLimits()
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
    """Run until SIGINT or SIGTERM.

    Raises:
        TwinError: If a file, an endpoint or a port cannot be used.
    """
    stop = program.stop_event(args)
    if args.imported is not None:
        serve_imported(args, stop)
        return
    identity = program.certificate(args)
    name = identity.name if identity is not None else topics.checked(args.operator)
    may_drive = not args.view_only and (identity is None or identity.role is Role.OPERATOR)
    only = [topics.checked(robot) for robot in args.robot]
    domain = domain_of(args)
    open_port, where = ports(args, domain)
    meshes = args.mesh_uri or MeshServer(args.mesh_host, args.mesh_port)

    def ready() -> None:
        program.say_ready(f"tsd-ros on {where}, domain {domain}")

    open_bus = partial(program.client_bus, args)
    try:
        asyncio.run(
            serve_ros(
                open_bus,
                open_port,
                meshes,
                stop,
                ready,
                operator=name,
                may_drive=may_drive,
                require_echo=args.require_echo,
                only=only,
            )
        )
    finally:
        if isinstance(meshes, MeshServer):
            meshes.close()


def serve_imported(args: argparse.Namespace, stop: threading.Event) -> None:
    """Run the node of a robot that has only ROS topics until `stop` is set.

    Raises:
        TwinError: If a file, an endpoint or a port cannot be used, or a limit is implausible.
    """
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

    def opened(robot: ExternalRobot) -> RosPort:
        return open_port(names, robot)

    with (
        contextlib.closing(
            ExternalRobot(
                opened,
                names,
                args.import_timeout,
                stamped=args.stamped,
                description_s=args.import_wait,
            )
        ) as robot_io,
        program.node_bus(args) as bus,
    ):
        text = describe(name, robot_io.urdf, limits)
        robot = description_of_kind(parse_description(text, name), ExternalDescription)
        robot_io.configure(robot)
        shown = Description(text, models.robot_urdf(robot))
        node = RobotNode(bus, name, robot, robot_io, shown)
        program.say_ready(
            f"tsd-ros {name} of {where}, domain {domain}, on {' '.join(bus.endpoints())}"
        )
        node.run(stop)


def domain_of(args: argparse.Namespace) -> int:
    """Return the ROS domain.

    Raises:
        TwinError: If ROS_DOMAIN_ID is invalid.
    """
    if args.domain is not None:
        return args.domain
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > _LAST_DOMAIN:
        raise TwinError(f"ROS_DOMAIN_ID is '{text}', not a number from 0 to {_LAST_DOMAIN}")
    return int(text)


def ports(args: argparse.Namespace, domain: int, ends: Endpoints = ADAPTER) -> tuple[OpenPort, str]:
    """Return a function that opens ports, and their endpoint.

    Raises:
        TwinError: If no router answers, or rclpy is missing.
    """
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
    program.add_adapter_flags(PARSER, OPERATOR)
    made = PARSER.add_argument_group("ROS", "docs/ros2.md goes step by step.")
    made.add_argument(
        "--rmw",
        choices=["zenoh", "dds"],
        default="zenoh",
        help="middleware of ROS; default zenoh; dds is a node of rclpy, of a ROS that is sourced",
    )
    made.add_argument(
        "--ros-connect",
        default=ROUTER,
        metavar="ENDPOINT",
        help=f"where the router of ROS (rmw_zenohd) listens; default {ROUTER}",
    )
    made.add_argument(
        "--ros-zenoh-config", metavar="FILE", help="a JSON5 file for that connection, for TLS"
    )
    made.add_argument(
        "--domain",
        type=flags.whole(0, _LAST_DOMAIN),
        metavar="ID",
        help="domain of ROS; default ROS_DOMAIN_ID, or 0",
    )
    made.add_argument(
        "--mesh-host",
        default="127.0.0.1",
        metavar="HOST",
        help="address that serves meshes for robot_description over HTTP; default 127.0.0.1",
    )
    made.add_argument(
        "--mesh-port",
        type=flags.PORT,
        default=0,
        metavar="PORT",
        help="its port; default 0, a free one",
    )
    made.add_argument(
        "--mesh-uri",
        metavar="URI",
        help="what goes before the names of meshes instead, as package://my_robot/meshes/",
    )
    made.add_argument(
        "--require-echo",
        action="store_true",
        help="cmd_vel moves a robot only as TwistStamped with the stamp of the newest odom",
    )
    _add_import_flags()
    program.run(PARSER, serve)


def _add_import_flags() -> None:
    made = PARSER.add_argument_group(
        "a robot of others",
        "It needs odom, and at best joint_states and robot_description; docs/ros2.md says what "
        "cannot be promised.",
    )
    made.add_argument(
        "--import",
        dest="imported",
        metavar="NAME",
        help="show the robot of ROS on the bus under this id, and drive it by cmd_vel",
    )
    made.add_argument(
        "--import-namespace",
        default="",
        metavar="NAME",
        help="namespace of its topics, as robot1 for /robot1/odom; default none",
    )
    made.add_argument(
        "--import-drive",
        choices=["diff", "omni"],
        default="diff",
        help="diff, the default, drives forward and turns; omni drives sideways, too",
    )
    made.add_argument(
        "--import-speed",
        type=flags.POSITIVE,
        default=_USUAL.speed_mps,
        metavar="M/S",
        help=f"speed limit; default {_USUAL.speed_mps:g}",
    )
    made.add_argument(
        "--import-turn-rate",
        type=flags.POSITIVE,
        default=_USUAL.turn_rate_rad_per_s,
        metavar="RAD/S",
        help=f"limit of the turn rate; default {_USUAL.turn_rate_rad_per_s:g}",
    )
    made.add_argument(
        "--import-acceleration",
        type=flags.POSITIVE,
        default=_USUAL.acceleration_mps2,
        metavar="M/S2",
        help=f"how fast its speed is changed; default {_USUAL.acceleration_mps2:g}",
    )
    made.add_argument(
        "--import-timeout",
        type=flags.POSITIVE,
        default=0.5,
        metavar="S",
        help="age of odom beyond which it is not driven; default 0.5",
    )
    made.add_argument(
        "--import-wait",
        type=flags.POSITIVE,
        default=5.0,
        metavar="S",
        help="time to wait for robot_description at the start; default 5",
    )
    made.add_argument(
        "--stamped", action="store_true", help="drive by TwistStamped instead of Twist"
    )
    made.add_argument(
        "--listen",
        default=NODE_ENDPOINT,
        metavar="ENDPOINT",
        help=f"where the bus of this robot listens; default {NODE_ENDPOINT}",
    )


if __name__ == "__main__":
    main()
