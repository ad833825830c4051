"""`tsd-foxglove`: the robots on the bus, or a recording, for Foxglove."""

from __future__ import annotations

import argparse
import asyncio
import logging
import secrets
from functools import partial
from pathlib import Path

from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError

with program.requires("tsd-foxglove", "foxglove"):
    from tsd_twin.adapters.foxglove.gateway import FOXGLOVE_ORIGIN, Access
    from tsd_twin.adapters.foxglove.sdk import load_sdk
    from tsd_twin.adapters.foxglove.sources import serve_live, serve_recording
    from tsd_twin.security.certificates import create_file
    from tsd_twin.security.users import refuse_public


_LOG = logging.getLogger(__name__)
PORT = 8765
OPERATOR = "foxglove"
SHORTEST_TOKEN = 24
"""Minimum length of a token, which makes guessing infeasible."""

PARSER = program.parser(
    "tsd-foxglove",
    "Show the robots on the bus in Foxglove, with the topics and types of ROS 2, and drive them "
    "by cmd_vel.",
    [
        "tsd-foxglove                                     then open ws://127.0.0.1:8765",
        "tsd-foxglove --connect tcp/127.0.0.1:7448        another robot; may be repeated",
        "tsd-foxglove --view-only                         nothing can be driven",
        "tsd-foxglove --recording run.mcap                a recording, with playback controls",
        "tsd-foxglove --host 0.0.0.0 --token-file token --tls-cert it.pem --tls-key it.key",
        "                                                 for other machines",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    load_sdk()
    stop = program.stop_event(args)
    access = access_of(args)
    access.check(args.host)

    def ready(port: int) -> None:
        scheme = "ws" if access.tls is None else "wss"
        program.say_ready(f"tsd-foxglove on {program.url(scheme, args.host, port)}")

    address = (args.host, args.port)
    if args.recording is not None:
        asyncio.run(serve_recording(args.recording, address, access, stop, ready))
        return
    options = program.adapter_options(args)
    open_bus = partial(program.client_bus, args)
    asyncio.run(serve_live(open_bus, address, access, stop, ready, **options))


def access_of(args: argparse.Namespace) -> Access:
    """Return the access settings from the flags."""
    tls, names = program.tls(args)
    token = None if args.token_file is None else token_of(args.token_file)
    return Access(token, tls, names, (FOXGLOVE_ORIGIN, *args.allow_origin))


def token_of(file: Path) -> str:
    """Return the token in a file; create the file if it is missing."""
    try:
        if not file.exists():
            create_file(file, f"{secrets.token_urlsafe(32)}\n".encode())
        refuse_public(file)
        token = file.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise TwinError(f"{file} cannot be used as a token file: {error}") from error
    if len(token) < SHORTEST_TOKEN or not token.isprintable() or " " in token:
        raise TwinError(f"{file} needs one line with a token of {SHORTEST_TOKEN} or more letters")
    return token


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    program.add_host_flags(PARSER, PORT)
    program.add_adapter_flags(PARSER, OPERATOR)
    text = "a recording of tsd-record instead of live robots"
    flags.add(PARSER, "--recording", text, Path, metavar="FILE")
    made = PARSER.add_argument_group("access", "docs/foxglove.md goes step by step.")
    text = f"a site whose pages may connect, beside {FOXGLOVE_ORIGIN}"
    flags.add(made, "--allow-origin", text, metavar="ORIGIN", repeated=True)
    text = "the secret that clients have to bring; made if there is none"
    flags.add(made, "--token-file", text, Path, metavar="FILE")
    program.add_tls_flags(made, "clients")
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
