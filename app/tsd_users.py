"""`tsd-users`: manages the user accounts of a dashboard."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path

from tsd_twin.cli import program
from tsd_twin.errors import TwinError
from tsd_twin.security import Role
from tsd_twin.security.router_rules import EVERY_ROBOT, rights_of_flags, show_robots

with program.requires("tsd-users", "dashboard"):
    from tsd_twin.security.users import User, Users


PARSER = program.parser(
    "tsd-users",
    "Names, roles and passwords for the dashboard. Passwords are asked for, or read from standard "
    "input, and kept as argon2 hashes. Start the dashboard again after a change.",
    [
        "tsd-users users.toml --operator alice       add Alice, or give her a new password",
        "tsd-users users.toml --viewer guest         a user who only watches",
        "tsd-users users.toml --viewer eve --may-stop    who watches, and may stop the robot",
        "tsd-users users.toml --operator bob --robots lab1,lab2 --watch lab3",
        "                                            Bob sees no other robot; he watches lab3",
        "tsd-users users.toml --change bob --robots all    and now all, with the same password",
        "tsd-users users.toml --remove guest",
        "tsd-users users.toml                        who there is",
        "tsd-users users.toml --operator alice < password.txt",
        "tsd-dashboard --users users.toml            what the file is for",
    ],
)


def change(args: argparse.Namespace) -> None:
    """Apply the flags to the file and list its users."""
    file: Path = args.file
    users = Users.load(file, may_be_empty=True) if file.exists() else Users({})
    if args.remove:
        users.remove(args.remove)
        users.save(file)
    elif name := args.operator or args.viewer:
        role = Role.OPERATOR if args.operator else Role.VIEWER
        if args.may_stop and role is Role.OPERATOR:
            raise TwinError("an operator may stop anyway: --may-stop is for a viewer")
        rights = rights_of_flags(args.robots, args.watch) or EVERY_ROBOT
        users.put(name, role, password_for(name), may_stop=args.may_stop, rights=rights)
        users.save(file)
    elif args.change:
        users.limit(args.change, rights_of_flags(args.robots, args.watch) or EVERY_ROBOT)
        users.save(file)
    elif args.robots or args.watch:
        raise TwinError("whose robots are these? Add --operator, --viewer or --change NAME")
    elif not file.exists():
        raise TwinError(f"there is no {file} yet: add a user with --operator NAME")
    for name in users.names:
        user = users.user(name)
        print(f"{user.role} {name}" + (", may stop" if user.may_stop else "") + robots_of(user))


def robots_of(user: User) -> str:
    """Return the robots of a user, empty for all."""
    if user.rights == EVERY_ROBOT:
        return ""
    text = f", robots {','.join(show_robots(user.rights.use))}" if user.rights.use else ""
    watched = ",".join(show_robots(user.rights.watch))
    return text + (f", watches {watched}" if watched else "")


def password_for(name: str) -> str:
    """Ask for a new password twice, without echo, or read a line from standard input."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    try:
        password = getpass.getpass(f"new password for {name}: ")
        if getpass.getpass("the same again: ") != password:
            raise TwinError("the two are not the same: nothing was changed")
    except (EOFError, KeyboardInterrupt):
        raise TwinError("no password: nothing was changed") from None
    return password


def main() -> None:
    """Parse the flags and run."""
    PARSER.add_argument("file", type=Path, help="where the users are, or shall be")
    what = PARSER.add_mutually_exclusive_group()
    what.add_argument("--operator", metavar="NAME", help="add a user who sees, drives and stops")
    what.add_argument("--viewer", metavar="NAME", help="add a user who only sees")
    what.add_argument("--change", metavar="NAME", help="change the robots of a user")
    what.add_argument("--remove", metavar="NAME", help="remove a user")
    PARSER.add_argument("--may-stop", action="store_true", help="a viewer may stop the robot, too")
    PARSER.add_argument(
        "--robots", metavar="IDS|all", help="robots of the user, as in lab1,lab2; default all"
    )
    PARSER.add_argument("--watch", metavar="IDS|all", help="robots that the user only watches")
    program.run(PARSER, change)


if __name__ == "__main__":
    main()
