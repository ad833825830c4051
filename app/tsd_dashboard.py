"""`tsd-dashboard`: web dashboard that shows and drives the robots on the bus."""

from __future__ import annotations

import argparse
import asyncio
import logging
from functools import partial
from pathlib import Path

from tsd_twin.bus import DEFAULT_ENDPOINT
from tsd_twin.cli import flags, program
from tsd_twin.cli.malloc import tune_malloc
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.security import Role

with program.requires("tsd-dashboard", "dashboard"):
    from tsd_twin.dashboard import app
    from tsd_twin.dashboard.gateway.auth import AccessSettings
    from tsd_twin.dashboard.gateway.connection_limits import allow_many_files
    from tsd_twin.dashboard.sessions.principal import DEFAULT_IDENTITY
    from tsd_twin.security.users import Users


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
        scheme = "http" if rules.tls is None else "https"
        program.say_ready(f"{program.url(scheme, args.host, port)}/")

    if (opened := program.client_bus_when_reachable(args, stop)) is None:
        return
    with opened as bus:
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
                open_pictures=partial(program.client_bus, args),
            )
        )


def rules_of(args: argparse.Namespace) -> AccessSettings:
    """Return the access settings from the flags."""
    context, names = program.tls(args)
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


def add_access_flags() -> None:
    """Add the flags for access from other machines."""
    made = PARSER.add_argument_group("for other machines", "docs/access.md goes step by step.")
    flags.add(made, "--users", "who may log in; tsd-users makes it", Path, metavar="FILE")
    program.add_tls_flags(made, "browsers")
    text = "let in only what a proxy passes on that speaks TLS; default: one on this machine"
    flags.add(made, "--behind-proxy", text, metavar="ADDRESS", nargs="?", const="127.0.0.1")


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    program.add_host_flags(PARSER, PORT, "of the page; ")
    program.add_viewport_flags(PARSER)
    text = "a robot that comes first in the menu, the first one is shown"
    flags.add(PARSER, "--first", text, metavar="ID", repeated=True)
    text = "folder of recordings that pages may show"
    flags.add(PARSER, "--record-dir", text, Path, metavar="FOLDER")
    add_access_flags()
    program.run(PARSER, serve)


if __name__ == "__main__":
    main()
