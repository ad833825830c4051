"""Joining the bus of a robot: flags, session, and who drives."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Generator

from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, as_client, client_config, from_file
from tsd_twin.lab.meeting import only_robot
from tsd_twin.lab.operator import Operator

_PATIENCE_S = 3.0


@contextlib.contextmanager
def joined(args: argparse.Namespace) -> Generator[Operator]:
    """Open the bus that the flags ask for, and find the robot; nobody has control yet.

    Raises:
        TwinError: nobody answers there, or there is no robot, or more than one to choose from.
    """
    with _bus(args) as bus:
        yield Operator(bus, args.id or only_robot(bus), args.operator)


def add_bus_flags(parser: argparse.ArgumentParser) -> None:
    """Add which robot on which bus, who takes control, and whether that is asked."""
    parser.add_argument("--id", help="of the robot on the bus; default: the only one")
    parser.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help=f"where a robot listens, may be repeated; default {DEFAULT_ENDPOINT}",
    )
    parser.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, for TLS and access")
    parser.add_argument("--operator", default="lab", help="who takes control; default lab")
    parser.add_argument("--yes", action="store_true", help="begin at once")


def _bus(args: argparse.Namespace) -> Bus:
    config = (
        from_file(args.zenoh_config)
        if args.zenoh_config
        else client_config(args.connect or [DEFAULT_ENDPOINT])
    )
    # Who sees the robot is at the same robot, and not this one's peer.
    return Bus(as_client(config, _PATIENCE_S))
