"""`tsd-link`: emulator of a bad network link between a dashboard and a robot."""

from __future__ import annotations

import argparse

from tsd_twin.bus import DEFAULT_ENDPOINT
from tsd_twin.cli import flags, program
from tsd_twin.link_emulation import PROFILES, LinkEmulator, LinkSpec

PARSER = program.parser(
    "tsd-link",
    "A bad link between a dashboard and a robot.",
    [
        "tsd-link --link delay=150ms,jitter=30ms,loss=2%    a far robot",
        "tsd-link --link transatlantic                      from another continent",
        "tsd-link --link satellite,loss=5%                  through a satellite, in rain",
        "tsd-link --link stall=2s@10s                       a link that hangs every 10 s",
        "tsd-link --link bandwidth=1Mbit                    a thin one",
        "tsd-link --link loss=5%,reorder=5% --target udp/127.0.0.1:7447",
    ],
)


def simulate(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    stop = program.stop_event(args)
    spec = LinkSpec.parse(args.link)
    listen = args.listen or f"{args.target.partition('/')[0]}/127.0.0.1:0"
    with LinkEmulator(spec, listen, args.target) as link:
        program.say_ready(f"tsd-link {spec} to {args.target} on {link.endpoint}")
        stop.wait()


def main() -> None:
    """Parse the flags and run."""
    text = (
        f"a profile ({', '.join(PROFILES)}), and what is bad about it: delay, jitter, wander, "
        "loss, reorder, stall, bandwidth, seed; see the examples"
    )
    flags.add(PARSER, "--link", text, metavar="SPEC", required=True)
    text = "where the robot listens, tcp or udp"
    flags.add(PARSER, "--target", text, default=DEFAULT_ENDPOINT, metavar="ENDPOINT")
    text = "where the dashboard connects to; default a free port of this machine"
    flags.add(PARSER, "--listen", text, metavar="ENDPOINT")
    program.run(PARSER, simulate)


if __name__ == "__main__":
    main()
