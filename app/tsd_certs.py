"""`tsd-certs`: keys, certificates and access rules for a robot on a network."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from tsd_twin import security
from tsd_twin.bus import client_config, from_file, node_config
from tsd_twin.cli import flags, program
from tsd_twin.security import AUTHORITY, ROBOT, Role

with program.requires("tsd-certs", "tls"):
    from tsd_twin.security.certificates import KeyFolder, provision


SOON = timedelta(days=30)

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
    "Keys, certificates and access rules for a robot on a network. Run it again to add names: "
    "what is there stays good.",
    [
        "tsd-certs keys --robot-host robot.local --robot-host 192.168.1.7 --operator alice",
        "tsd-certs keys --operator bob --viewer guest     two more, for the same robot",
        "tsd-certs keys                                   who there is, and until when",
        "rm keys/guest.*; tsd-certs keys                  a robot without guest",
    ],
)


def make(args: argparse.Namespace) -> None:
    """Create missing files, and print which files to copy to which machine."""
    now = datetime.now(UTC)
    folder = KeyFolder(args.folder)
    identities = [security.client(name, role) for role in ROLES for name in getattr(args, role)]
    provision(
        folder,
        now,
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(client_config([endpoint]).json5),
        hosts=args.robot_host,
        identities=identities,
        days=args.days,
        listen=args.listen,
    )
    for identity in folder.identities():
        from_file(str(folder.settings_file(identity.name)))
    from_file(str(folder.settings_file(ROBOT)))
    print("\n".join(report(folder, now)))


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


def term(folder: KeyFolder, name: str, now: datetime) -> str:
    """Return the expiry of a certificate, with a remedy if it is near."""
    end = folder.end_of(name)
    text = f", until {end:%F}"
    if end - now < SOON:
        text += f": to renew it, remove {name}.pem and name {name} again"
    return text


def copying(folder: KeyFolder, name: str, command: str) -> list[str]:
    """Return the files to copy to a machine, and the command to run there."""
    settings = folder.settings_file(name)
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
    for role, text in ROLES.items():
        flags.add(PARSER, f"--{role}", text, metavar="NAME", repeated=True)
    text = "how long new certificates are good"
    flags.add(PARSER, "--days", text, flags.whole(1, 3_650), 365)
    text = f"where the robot listens; default {security.LISTEN}"
    flags.add(PARSER, "--listen", text, metavar="ENDPOINT")
    program.run(PARSER, make)


if __name__ == "__main__":
    main()
