"""Flags of robot programs that join a router with an enrolment code."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from tsd_twin.cli import flags
from tsd_twin.errors import TwinError
from tsd_twin.messages import topics


def default_keys(home: Path | None = None) -> Path:
    """Return the folder of this user's keys, or below another `home`."""
    config = os.environ.get("XDG_CONFIG_HOME")
    if home is None and config:
        return Path(config) / "tsd-twin"
    return (home or Path.home()) / ".config/tsd-twin"


def add_join_flags(made: argparse.ArgumentParser) -> None:
    """Add `--join`, `--code` and `--keys`."""
    text = (
        "join a router: ask tsd-certs --enrol at this address, with --code, for a certificate and "
        "configuration, and run with them; later runs use the files"
    )
    flags.add(made, "--join", text, metavar="URL")
    flags.add(made, "--code", "code that tsd-certs --enrol printed", metavar="CODE")
    text = f"folder for the files of --join; default {default_keys(Path('~'))}"
    flags.add(made, "--keys", text, Path, metavar="FOLDER")


def join(args: argparse.Namespace) -> None:
    """Set `args.zenoh_config` to the configuration that `--join` asks for, if given.

    Raises:
        TwinError: If flags conflict, or the robot may not join.
    """
    if args.join is None:
        if args.code is not None or args.keys is not None:
            raise TwinError("--code and --keys are for --join URL")
        return
    if args.zenoh_config or getattr(args, "count", 1) != 1:
        raise TwinError("--join is for one robot, and makes the file of --zenoh-config")
    if args.id is not None:
        topics.checked(args.id)
    folder: Path = args.keys or default_keys()
    try:
        args.zenoh_config = str(_configuration(args, folder))
    except OSError as error:
        raise TwinError(f"{folder} cannot be used: {error.strerror}") from error


def _configuration(args: argparse.Namespace, folder: Path) -> Path:
    """Return the configuration in a folder, which the robot gets if it has none.

    Raises:
        TwinError: If it is ambiguous, or the robot may not join.
        OSError: If a file cannot be read.
    """
    found = sorted(folder.glob(f"{args.id or '*'}.json5"))
    if len(found) > 1:
        names = ", ".join(file.stem for file in found)
        raise TwinError(f"{folder} has keys of several robots: choose one with --id: {names}")
    if found:
        _say(f"{found[0].stem} has joined already: using {found[0]}")
        return found[0]
    if args.code is None:
        raise TwinError(f"{folder} has no keys yet: add --code, which tsd-certs --enrol prints")
    # Late, because it needs the extra `tls`.
    from tsd_twin.security.enrolment import EnrolmentCode
    from tsd_twin.security.joining import join as ask

    file = ask(args.join, EnrolmentCode.parse(args.code), folder, args.id)
    _say(f"joined as {file.stem}: using {file}")
    return file


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201  Message of the program to its user.
