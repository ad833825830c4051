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
from tsd_twin.messages import topics
from tsd_twin.security import Role

with program.requires("tsd-foxglove", "foxglove"):
    from tsd_twin.adapters.foxglove.gateway import FOXGLOVE_ORIGIN, Access
    from tsd_twin.adapters.foxglove.sdk import load_sdk
    from tsd_twin.adapters.foxglove.sources import serve_live, serve_recording
    from tsd_twin.security.certificates import create_file
    from tsd_twin.security.users import refuse_public
    from tsd_twin.security.web_access import certificate_host_names, server_tls_context


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
    """Run until SIGINT or SIGTERM.

    Raises:
        TwinError: If a package, file or port cannot be used.
    """
    load_sdk()
    stop = program.stop_event(args)
    access = access_of(args)
    access.check(args.host)

    def ready(port: int) -> None:
        scheme = "ws" if access.tls is None else "wss"
        host = f"[{args.host}]" if ":" in args.host else args.host
        program.say_ready(f"tsd-foxglove on {scheme}://{host}:{port}")

    address = (args.host, args.port)
    if args.recording is not None:
        asyncio.run(serve_recording(args.recording, address, access, stop, ready))
        return
    identity = program.certificate(args)
    name = identity.name if identity is not None else topics.checked(args.operator)
    asyncio.run(
        serve_live(
            partial(program.client_bus, args),
            address,
            access,
            stop,
            ready,
            operator=name,
            may_drive=not args.view_only and (identity is None or identity.role is Role.OPERATOR),
            only=[topics.checked(robot) for robot in args.robot],
        )
    )


def access_of(args: argparse.Namespace) -> Access:
    """Return the access settings from the flags.

    Raises:
        TwinError: If a flag requires another, or a file cannot be used.
    """
    if (args.tls_cert is None) != (args.tls_key is None):
        raise TwinError("--tls-cert and --tls-key go together: name both, or neither")
    names, tls = list(args.allow_host), None
    if args.tls_cert is not None:
        tls = server_tls_context(args.tls_cert, args.tls_key)
        names += certificate_host_names(args.tls_cert)
    token = None if args.token_file is None else token_of(args.token_file)
    return Access(token, tls, names, (FOXGLOVE_ORIGIN, *args.allow_origin))


def token_of(file: Path) -> str:
    """Return the token in a file; create the file if it is missing.

    Raises:
        TwinError: If the file cannot be used, is readable by others, or its token is too short.
    """
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
    PARSER.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; default 127.0.0.1"
    )
    PARSER.add_argument(
        "--port", type=flags.PORT, default=PORT, help=f"default {PORT}; 0 is a free one"
    )
    program.add_adapter_flags(PARSER, OPERATOR)
    PARSER.add_argument(
        "--recording",
        type=Path,
        metavar="FILE",
        help="a recording of tsd-record instead of live robots",
    )
    made = PARSER.add_argument_group("access", "docs/foxglove.md goes step by step.")
    made.add_argument(
        "--allow-origin",
        action="append",
        default=[],
        metavar="ORIGIN",
        help=f"a site whose pages may connect, beside {FOXGLOVE_ORIGIN}; may be repeated",
    )
    made.add_argument(
        "--allow-host",
        type=flags.host_name,
        action="append",
        default=[],
        metavar="NAME[:PORT]",
        help="a name that clients know it by, beside those in the certificate; may be repeated",
    )
    made.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="the secret that clients have to bring; made if there is none",
    )
    made.add_argument("--tls-cert", type=Path, metavar="FILE", help="certificate chain in PEM")
    made.add_argument("--tls-key", type=Path, metavar="FILE", help="its private key")
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
