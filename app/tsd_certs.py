"""`tsd-certs`: keys, certificates and access rules for a robot, or a router with many."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from urllib.parse import urlsplit

from tsd_twin import security
from tsd_twin.bus import client_config, dialling_config, from_file, node_config, router_file
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError
from tsd_twin.security import AUTHORITY, ROBOT, ROUTER, BusIdentity, Role
from tsd_twin.security.router_rules import RobotRights, rights_of_flags, show_robots

with program.requires("tsd-certs", "tls"):
    from tsd_twin.security.authority_server import AuthorityServer, Request, boot_time_s
    from tsd_twin.security.certificates import PublicKey
    from tsd_twin.security.enrolment import (
        JOIN_PATH,
        PORT,
        VALID_S,
        EnrolmentCode,
        Enrolments,
        Joined,
    )
    from tsd_twin.security.key_folder import KeyFolder, provision
    from tsd_twin.security.operator_keys import provision_operators
    from tsd_twin.security.operator_list import OPERATORS
    from tsd_twin.security.renewal import PORT as RENEWAL_PORT
    from tsd_twin.security.renewal import Renewals
    from tsd_twin.security.router_keys import (
        LASTING_DAYS,
        RENEWED_DAYS,
        default_days,
        enrol_robot,
        provision_router,
        read_rights,
        renewal_url,
        robot_identity,
    )


SOON, OVERDUE = timedelta(days=30), timedelta(days=7)
_RENEWAL_CHECK_S = 60.0

ROLES = {
    Role.OPERATOR: "an operator, who sees, drives and stops",
    Role.VIEWER: "a viewer, who sees and stops",
    Role.SENSOR: "a camera or the like, which tells robots where they are",
    Role.RECORDER: "a recorder, who reads all that is sent",
}
"""Roles of identities, each with a flag, and the help of it."""
PROGRAMS = {Role.SENSOR: "its program", Role.RECORDER: "tsd-record"}
"""Programs other than the dashboard that use a certificate."""

PARSER = program.parser(
    "tsd-certs",
    "Keys, certificates and access rules for a robot on a network, or for a router that many "
    "robots dial. Run it again to add names: what is there stays good.",
    [
        "tsd-certs keys --robot-host robot.local --robot-host 192.168.1.7 --operator alice",
        "tsd-certs keys --operator bob --viewer guest     two more, for the same robot",
        "tsd-certs keys                                   who there is, and until when",
        "tsd-certs keys --signed                          the robot obeys signed commands only",
        "tsd-certs keys --revoke bob                      and no longer those of Bob",
        "rm keys/guest.*; tsd-certs keys                  a robot without guest",
        "tsd-certs fleet --router-host lab.example --robot lab1 --robot lab2 "
        "--operator alice --robots lab1",
        "                                                 a router; Alice has the first robot only",
        "tsd-certs fleet --operator alice --robots lab1 --watch lab2    and watches the second",
        "tsd-certs fleet --enrol lab1                     prints a code for the first robot, which",
        "                                                 joins with tsd-bridge --join URL --code",
        "tsd-certs fleet --renewal-port 7449              new certificates last 30 days and are",
        "tsd-certs fleet --renew                          renewed at this port while this runs",
    ],
)


def make(args: argparse.Namespace) -> None:
    """Create missing files, and print which files to copy to which machine."""
    now = datetime.now(UTC)
    folder = KeyFolder(args.folder)
    identities = [security.client(name, role) for role in ROLES for name in getattr(args, role)]
    identities += [security.client(name, Role.OPERATOR) for name in args.gateway]
    serves = args.enrol or args.renew or args.renewal_port is not None
    if serves and not (args.router_host or folder.is_of_router):
        raise TwinError("--enrol and --renew are for a router, which --router-host makes")
    if args.renew and args.enrol:
        raise TwinError("--enrol and --renew are two processes: run this twice")
    if args.router_host or args.robot or folder.is_of_router:
        make_router(args, folder, now, identities)
        return
    if args.robots or args.watch:
        raise TwinError("--robots and --watch are for a router, which --router-host makes")
    provision(
        folder,
        now,
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(client_config([endpoint]).json5),
        hosts=args.robot_host,
        identities=identities,
        days=args.days or LASTING_DAYS,
        listen=args.listen,
    )
    signed = args.signed or args.gateway or args.revoke
    if signed or (folder.path / OPERATORS).exists():
        provision_operators(folder, now, rights={}, gateways=args.gateway, revoked=args.revoke)
    for identity in folder.identities():
        from_file(str(folder.settings_file(identity.name)))
    from_file(str(folder.settings_file(ROBOT)))
    print("\n".join(report(folder, now)))


def make_router(
    args: argparse.Namespace, folder: KeyFolder, now: datetime, identities: list[BusIdentity]
) -> None:
    """Create missing files of a router, change its rules, and print what to copy.

    Raises:
        TwinError: If flags conflict or rights are missing.
    """
    if args.robot_host or folder.certificate_file(ROBOT).exists():
        raise TwinError("this is a folder of one robot: --robot and --router-host need another")
    if (args.robots or args.watch) and not identities:
        raise TwinError("whose robots are these? Add --operator NAME, or another role")
    provision_router(
        folder,
        now,
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(dialling_config([endpoint]).json5),
        hosts=args.router_host,
        robots=[robot_identity(name) for name in args.robot],
        identities=identities,
        rights=given_rights(args, identities),
        days=args.days,
        listen=args.listen,
        renewal_port=args.renewal_port,
    )
    provision_operators(
        folder, now, rights=read_rights(folder), gateways=args.gateway, revoked=args.revoke
    )
    for each in (*folder.robots(), *folder.identities()):
        if not has_joined(folder, each.name):
            from_file(str(folder.settings_file(each.name)))
    router_file(str(folder.settings_file(ROUTER)))
    if folder.made or not (args.enrol or args.renew):
        print("\n".join(router_report(folder, now)))
    if args.enrol:
        enrol(args, folder, now)
    if args.renew:
        renew(args, folder, now)


def renew(args: argparse.Namespace, folder: KeyFolder, now: datetime) -> None:
    """Renew certificates until SIGINT or SIGTERM.

    Raises:
        TwinError: If the folder has no address for it, or a file is missing.
    """
    url = renewal_url(folder)
    if url is None:
        raise TwinError("these certificates are not renewed: say --renewal-port once")
    renewals = Renewals(folder, folder.authority(now), args.days or default_days(url))
    stop = program.stop_event(args)
    with AuthorityServer(folder, urlsplit(url).port or 0, renewals.answers) as server:
        program.say_ready(f"tsd-certs renews at {url}")
        while not stop.is_set():
            if renewals.renew_router():
                server.reload()
            stop.wait(_RENEWAL_CHECK_S)


def enrol(args: argparse.Namespace, folder: KeyFolder, now: datetime) -> None:
    """Print a code for each robot, and serve until all have joined or the codes have expired.

    Raises:
        TwinError: If a name is not reserved, a file is missing, or a robot has not joined.
    """
    known = [robot.name for robot in folder.robots()]
    for name in args.enrol:
        if name not in known:
            raise TwinError(f"'{name}' is not a robot of this router: add --robot {name}")
    authority = folder.authority(now)

    days = args.days or default_days(renewal_url(folder))

    def issue(robot: str, key: PublicKey) -> Joined:
        joined = enrol_robot(folder, authority, robot, key, datetime.now(UTC), days)
        print(f"{robot} has got its certificate", flush=True)
        return joined

    stop, enrolments = program.stop_event(args), Enrolments(issue)

    def answer(request: Request) -> bytes:
        return enrolments.answer(request.body, request.network, boot_time_s())

    with AuthorityServer(folder, args.enrol_port, {("POST", JOIN_PATH): answer}) as server:
        where = program.url("https", folder.hosts(ROUTER)[0], server.port)
        for name in dict.fromkeys(args.enrol):
            code = EnrolmentCode.new(authority.certificate)
            enrolments.offer(name, code.key(authority.certificate), boot_time_s())
            print(f"on the computer of {name}, within {VALID_S / 60.0:.0f} minutes:")
            print(f"  tsd-bridge --join {where} --code {code.text}")
        program.say_ready(f"tsd-certs enrols on {where}")
        while enrolments.open_robots(boot_time_s()) and not stop.wait(0.2):
            pass
    if enrolments.missing and not stop.is_set():
        names = ", ".join(enrolments.missing)
        raise TwinError(f"{names} did not join in time: run this again for a new code")


def has_joined(folder: KeyFolder, name: str) -> bool:
    """Return whether a robot has joined with a key that only its own computer has."""
    return not folder.key_file(name).exists()


def given_rights(
    args: argparse.Namespace, identities: Sequence[BusIdentity]
) -> dict[str, RobotRights]:
    """Return the rights that the flags give to the people that they name."""
    rights = rights_of_flags(args.robots, args.watch)
    return {} if rights is None else {person.name: rights for person in identities}


def router_report(folder: KeyFolder, now: datetime) -> list[str]:
    """Return a report on a router: new files, robots, people and their robots."""
    lines = [f"made {shown(folder.made)}" if folder.made else "everything is there already"]
    lines += ["", f"router {', '.join(folder.hosts(ROUTER))}{term(folder, ROUTER, now)}"]
    lines += [
        f"  copy to its machine  {shown(folder.files_of(ROUTER))}",
        f"  and run there        tsd-router {shown([folder.settings_file(ROUTER)])}",
    ]
    for robot in folder.robots():
        lines += ["", f"robot {robot.name}{term(folder, robot.name, now, 'robot')}"]
        lines += copying(folder, robot.name, "tsd-bridge")
    rights = read_rights(folder)
    for person in folder.identities():
        own = rights[person.name]
        text = f", robots {','.join(show_robots(own.use))}" if own.use else ""
        text += f", watches {','.join(show_robots(own.watch))}" if own.watch else ""
        lines += ["", f"{person.role} {person.name}{text}{term(folder, person.name, now)}"]
        lines += copying(folder, person.name, PROGRAMS.get(person.role, "tsd-dashboard"))
    return [
        *lines,
        "",
        "tsd-router takes a new router.json5 within seconds; copy it to its machine.",
        f"Keep {folder.key_file(AUTHORITY)} offline: its holder can issue operator certificates.",
    ]


def report(folder: KeyFolder, now: datetime) -> list[str]:
    """Return a report: new files, identities, and the files to copy to each machine."""
    lines = [f"made {shown(folder.made)}" if folder.made else "everything is there already"]
    lines += ["", f"robot {', '.join(folder.hosts())}{term(folder, ROBOT, now)}"]
    lines += copying(folder, ROBOT, "tsd-mock")
    for person in folder.identities():
        lines += ["", f"{person.role} {person.name}{term(folder, person.name, now)}"]
        lines += copying(folder, person.name, PROGRAMS.get(person.role, "tsd-dashboard"))
    lines += [
        "",
        "A robot obeys the rules it was started with: copy robot.json5 and start it again.",
        f"Keep {folder.key_file(AUTHORITY)} offline: its holder can issue operator certificates.",
    ]
    return lines


def term(folder: KeyFolder, name: str, now: datetime, flag: str = "name") -> str:
    """Return the expiry of a certificate, with a remedy if it is near."""
    end = folder.end_of(name)
    text = f", until {end:%F}"
    if end - now < (OVERDUE if folder.is_of_router and renewal_url(folder) else SOON):
        if has_joined(folder, name):
            return f"{text}: to renew it, say --enrol {name}"
        again = f"say --robot {name}" if flag == "robot" else f"name {name}"
        text += f": to renew it, remove {name}.pem and {again} again"
    return text


def copying(folder: KeyFolder, name: str, command: str) -> list[str]:
    """Return the files to copy to a machine, and the command to run there."""
    settings = folder.settings_file(name)
    if has_joined(folder, name):
        return ["  has its own key, and nothing to copy"]
    return [
        f"  copy to its machine  {shown(folder.files_of(name))}",
        f"  and run there        {command} --zenoh-config {shown([settings])}",
    ]


def shown(files: Sequence[Path]) -> str:
    """Return file names quoted for a shell."""
    return shlex.join(str(file) for file in files)


def main() -> None:
    """Parse the flags and run."""
    PARSER.add_argument("folder", type=Path, help="where the files are, or shall be")
    text = "a name or address of the robot; clients connect to the first"
    flags.add(PARSER, "--robot-host", text, metavar="HOST", repeated=True)
    text = "a name or address of a router; robots and clients dial the first"
    flags.add(PARSER, "--router-host", text, metavar="HOST", repeated=True)
    text = "a robot that dials the router, also one to come"
    flags.add(PARSER, "--robot", text, metavar="ID", repeated=True)
    text = "robots of the people and tools named here, as in lab1,lab2; with --router-host"
    flags.add(PARSER, "--robots", text, metavar="IDS|all")
    text = "robots that they may watch only; with --router-host"
    flags.add(PARSER, "--watch", text, metavar="IDS|all")
    text = "require signed commands: makes a signing key for each operator, and operators.json"
    PARSER.add_argument("--signed", action="store_true", help=f"{text}; default with a router")
    text = "an operator, such as a dashboard, that signs for the users that log in there"
    flags.add(PARSER, "--gateway", text, metavar="NAME", repeated=True)
    text = "an operator whose signing key robots obey no longer, once they have operators.json"
    flags.add(PARSER, "--revoke", text, metavar="NAME", repeated=True)
    text = "print a code with which this robot of the router joins, and serve until it has"
    flags.add(PARSER, "--enrol", text, metavar="ID", repeated=True)
    text = f"port for --enrol; default {PORT}, 0 is a free one"
    flags.add(PARSER, "--enrol-port", text, flags.PORT, PORT, "PORT")
    text = "renew the certificates of the router and its clients, until SIGINT or SIGTERM"
    PARSER.add_argument("--renew", action="store_true", help=text)
    text = f"port of --renew, such as {RENEWAL_PORT}; new certificates are then good for "
    text += f"{RENEWED_DAYS} days"
    flags.add(PARSER, "--renewal-port", text, flags.PORT, metavar="PORT")
    for role, text in ROLES.items():
        flags.add(PARSER, f"--{role}", text, metavar="NAME", repeated=True)
    text = "how long new certificates are good"
    text += f"; default {LASTING_DAYS}, or {RENEWED_DAYS} if they are renewed"
    flags.add(PARSER, "--days", text, flags.whole(1, 3_650))
    text = f"where the robot or router listens; default {security.LISTEN}"
    flags.add(PARSER, "--listen", text, metavar="ENDPOINT")
    program.run(PARSER, make)


if __name__ == "__main__":
    main()
