"""`tsd-dashboard`: the page from which robots on the bus are seen and driven."""

from __future__ import annotations

import argparse
import asyncio
import logging

from tsd_twin import program
from tsd_twin.dashboard import dashboard
from tsd_twin.dashboard.gateway import ANYBODY
from tsd_twin.dashboard.heap import return_large_blocks

_LOG = logging.getLogger(__name__)
_PATIENCE_S = 3.0
PORT = 8080

PARSER = program.parser(
    "tsd-dashboard",
    "See and drive the robots on the bus from a browser.",
    [
        "tsd-dashboard                                    robots of this machine",
        "tsd-dashboard --connect tcp/127.0.0.1:7448       another robot; may be repeated",
        "tsd-dashboard --port 0                           on any free port, which it prints",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    return_large_blocks()
    stop = program.stop_event(args)

    def ready(port: int) -> None:
        program.say_ready(f"http://{args.host}:{port}/")

    with program.client_bus(args) as bus:
        if args.zenoh_config and not bus.wait_for_peer(_PATIENCE_S):
            _LOG.warning("no robot lets us in yet: it is off, or refuses the certificate")
        owner = program.certificate(args) or ANYBODY
        asyncio.run(dashboard.run(bus, args.host, args.port, stop, ready, owner))


def main() -> None:
    """Read the flags and run."""
    program.add_client_flags(PARSER)
    PARSER.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; default 127.0.0.1"
    )
    PARSER.add_argument("--port", type=int, default=PORT, help=f"default {PORT}; 0 is a free one")
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
