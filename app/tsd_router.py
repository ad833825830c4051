"""`tsd-router`: router that robots and operators dial, with TLS and rights per robot."""

from __future__ import annotations

import argparse

from tsd_twin.bus import Bus, router_file
from tsd_twin.cli import program

PARSER = program.parser(
    "tsd-router",
    "A router for robots and operators that dial out to it. It passes messages by the rights in "
    "its configuration, which tsd-certs makes and zenohd reads, too. Restart it after a change.",
    [
        "tsd-certs keys --router-host lab.example --robot lab1 --operator alice --robots lab1",
        "tsd-router keys/router.json5",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Route until SIGINT or SIGTERM."""
    stop = program.stop_event(args)
    # A process that drives or serves pages must not share this session: rules do not apply to it.
    with Bus(router_file(args.config)) as bus:
        program.say_ready(f"tsd-router on {' '.join(bus.endpoints())}")
        stop.wait()


def main() -> None:
    """Parse the flags and run."""
    PARSER.add_argument("config", metavar="FILE", help="JSON5 file of the router")
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
