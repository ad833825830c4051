"""`tsd-dashboard`: web dashboard that shows and drives the robots on the bus."""

from __future__ import annotations

import argparse
import asyncio
import logging
from pathlib import Path

from tsd_twin.bus import DEFAULT_ENDPOINT
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.security import Role

with program.requires("tsd-dashboard", "dashboard"):
    from tsd_twin.dashboard import app
    from tsd_twin.dashboard.app import tune_malloc
    from tsd_twin.dashboard.gateway.auth import AccessSettings
    from tsd_twin.dashboard.gateway.connection_limits import allow_many_files
    from tsd_twin.dashboard.sessions.principal import DEFAULT_IDENTITY
    from tsd_twin.security.users import Users
    from tsd_twin.security.web_access import certificate_host_names, server_tls_context


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
        "tsd-dashboard --host 0.0.0.0 --users users.toml --tls-cert it.pem --tls-key it.key",
        "                                                 for other machines, with a login",
        "tsd-dashboard --users users.toml --behind-proxy --allow-host robot.example",
        "                                                 behind nginx on this machine",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Run until SIGINT or SIGTERM."""
    tune_malloc()
    allow_many_files()
    stop = program.stop_event(args)
    rules = rules_of(args)
    rules.check(args.host)
    if rules.users is not None and rules.owner is DEFAULT_IDENTITY:
        _LOG.warning("%s", open_bus(args))

    first = [topics.checked(robot_id) for robot_id in args.first]

    def ready(port: int) -> None:
        program.say_ready(f"{url(args, rules, port)}")

    with program.client_bus(args) as bus:
        if args.zenoh_config and not bus.wait_for_peer(_PATIENCE_S):
            _LOG.warning("no robot lets us in yet: it is off, or refuses the certificate")
        asyncio.run(
            app.run(
                bus,
                args.host,
                args.port,
                stop,
                ready,
                rules,
                first=first,
                recordings=args.record_dir,
                viewport_port=args.viewport_port,
            )
        )


def rules_of(args: argparse.Namespace) -> AccessSettings:
    """Return the access settings from the flags.

    Raises:
        TwinError: If a flag requires another, or a file cannot be used.
    """
    names: list[str] = list(args.allow_host)
    context = None
    if (args.tls_cert is None) != (args.tls_key is None):
        raise TwinError("--tls-cert and --tls-key go together: name both, or neither")
    if args.tls_cert is not None:
        context = server_tls_context(args.tls_cert, args.tls_key)
        names += certificate_host_names(args.tls_cert)
    owner = program.certificate(args) or DEFAULT_IDENTITY
    if owner.role is Role.SENSOR:
        raise TwinError(f"'{owner.name}' is a sensor: a dashboard needs an operator, or a viewer")
    return AccessSettings(
        owner=owner,
        users=None if args.users is None else Users.load(args.users),
        tls=context,
        proxy=args.behind_proxy,
        allowed_hosts=names,
        viewport_origin=args.viewport_origin,
    )


def open_bus(args: argparse.Namespace) -> str:
    """Return a warning that the bus is open to all programs, although the page has a login."""
    where = args.zenoh_config or ", ".join(args.connect or [DEFAULT_ENDPOINT])
    return (
        f"WARNING: --users guards this page only. The bus at {where} has no certificates: any "
        "program that reaches it, of any user of its machine, can drive the robot without a "
        "password. To close it, use tsd-certs and --zenoh-config (docs/network.md)."
    )


def url(args: argparse.Namespace, rules: AccessSettings, port: int) -> str:
    """Return the URL of the page on this machine."""
    scheme = "http" if rules.tls is None else "https"
    host = f"[{args.host}]" if ":" in args.host else args.host
    return f"{scheme}://{host}:{port}/"


def add_access_flags() -> None:
    """Add the flags for access from other machines."""
    made = PARSER.add_argument_group("for other machines", "docs/access.md goes step by step.")
    made.add_argument(
        "--users", type=Path, metavar="FILE", help="who may log in; tsd-users makes it"
    )
    made.add_argument("--tls-cert", type=Path, metavar="FILE", help="certificate chain in PEM")
    made.add_argument("--tls-key", type=Path, metavar="FILE", help="its private key")
    made.add_argument(
        "--allow-host",
        type=flags.host_name,
        action="append",
        default=[],
        metavar="NAME[:PORT]",
        help="a name that browsers know it by, beside those in the certificate; may be repeated",
    )
    made.add_argument(
        "--behind-proxy",
        nargs="?",
        const="127.0.0.1",
        metavar="ADDRESS",
        help="let in only what a proxy passes on that speaks TLS; default: one on this machine",
    )


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    PARSER.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; default 127.0.0.1"
    )
    PARSER.add_argument(
        "--port",
        type=flags.PORT,
        default=PORT,
        help=f"of the page; default {PORT}; 0 is a free one",
    )
    program.add_viewport_flags(PARSER)
    PARSER.add_argument(
        "--first",
        action="append",
        default=[],
        metavar="ID",
        help="a robot that comes first in the menu, the first one is shown; may be repeated",
    )
    PARSER.add_argument(
        "--record-dir",
        type=Path,
        metavar="FOLDER",
        help="folder of recordings that pages may show",
    )
    add_access_flags()
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
