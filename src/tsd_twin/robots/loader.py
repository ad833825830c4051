"""Reading robot descriptions: shipped ones by name, anybody's own by path."""

from __future__ import annotations

import difflib
import itertools
import math
import re
import types
import typing
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin.errors import RobotFileError
from tsd_twin.robots.robot import DriveGeometry, Robot

_PACKAGE = "tsd_twin.robots"


def names() -> list[str]:
    """Return the names of the shipped robots, sorted."""
    files = resources.files(_PACKAGE).iterdir()
    return sorted(Path(f.name).stem for f in files if f.name.endswith(".toml"))


def text(name_or_path: str) -> str:
    """Return the TOML text of a shipped robot or of a file.

    Raises:
        RobotFileError: no such robot or file; the message lists the shipped ones.
    """
    if "/" not in name_or_path and not name_or_path.endswith(".toml"):
        if name_or_path not in names():
            raise RobotFileError(
                name_or_path,
                "no such robot" + _closest(name_or_path, names()),
                f"shipped are {', '.join(names())}; your own is given by its path, my_robot.toml",
            )
        return resources.files(_PACKAGE).joinpath(f"{name_or_path}.toml").read_text("utf-8")
    try:
        return Path(name_or_path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise RobotFileError(
            name_or_path, f"cannot be read: {problem}", f"shipped are {', '.join(names())}"
        ) from error


def load(name_or_path: str) -> Robot:
    """Return a shipped robot by name, or the robot of a TOML file by path.

    Raises:
        RobotFileError: the file is missing, misspelt or impossible; the message names file and key.
    """
    return parse(text(name_or_path), name_or_path)


def parse(toml: str, file: str) -> Robot:
    """Return the robot of a TOML text; `file` is what errors call it.

    Raises:
        RobotFileError: as in `load`.
    """
    try:
        tables: Any = msgspec.toml.decode(toml)
        robot = msgspec.convert(tables, Robot)
    except msgspec.ValidationError as error:
        raise RobotFileError(file, *_explain(str(error))) from error
    except msgspec.DecodeError as error:
        raise RobotFileError(file, f"not valid TOML: {error}") from error
    if "kind" not in tables["drive"]:
        # As long as there is one kind only, msgspec takes that one to be meant.
        raise RobotFileError(file, "key 'kind' is missing in [drive]", _valid_kinds())
    _check(robot, file)
    _check_motor(robot, file)
    return robot


def _check(robot: Robot, file: str) -> None:
    """Raise for what no single value can show."""
    for path, number in _numbers(msgspec.to_builtins(robot)):
        if not math.isfinite(number):
            raise RobotFileError(file, f"{path}: {number} is not a finite number")
    azimuths = [azimuth % 360.0 for azimuth in robot.drive.azimuths_deg]
    if len(set(azimuths)) < len(azimuths):
        raise RobotFileError(
            file, "drive.azimuths_deg has the same direction twice", "one direction for each pivot"
        )
    limits = robot.limits
    if limits.max_command_age_s > limits.max_command_age_ceiling_s:
        raise RobotFileError(
            file, "limits.max_command_age_s is above limits.max_command_age_ceiling_s"
        )


def _check_motor(robot: Robot, file: str) -> None:
    """Raise when the calibration table has no curve with an inverse for each wheel."""
    motor, modules = robot.motor, robot.drive.modules
    rows = len(motor.signal)
    if any(b <= a for a, b in itertools.pairwise(motor.signal)):
        raise RobotFileError(file, "motor.signal must rise from row to row")
    if len(motor.speed_rpm) != modules:
        raise RobotFileError(
            file,
            f"motor.speed_rpm has {len(motor.speed_rpm)} lists, the drive has {modules} wheels",
            "one list for each of drive.azimuths_deg",
        )
    for i, column in enumerate(motor.speed_rpm):
        if len(column) != rows:
            raise RobotFileError(
                file,
                f"motor.speed_rpm[{i}] has {len(column)} speeds for {rows} signals",
                "one speed for each of motor.signal",
            )
        if any(b < a for a, b in itertools.pairwise(column)):
            raise RobotFileError(file, f"motor.speed_rpm[{i}] must not fall as the signal rises")
        if column[0] > 0.0:
            raise RobotFileError(
                file,
                f"motor.speed_rpm[{i}] starts at {column[0]:g}",
                "0: the lowest signal is zero throttle",
            )
        if not motor.start_speed_rpm <= robot.drive.cruise_speed_rpm <= column[-1]:
            raise RobotFileError(
                file,
                f"drive.cruise_speed_rpm is {robot.drive.cruise_speed_rpm:g}, "
                f"motor {i + 1} turns from {motor.start_speed_rpm:g} to {column[-1]:g}",
                "between motor.start_speed_rpm and the last speed of every motor",
            )


def _numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Walk all numbers below `value`, with the path of each."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, dict):
        for key, item in typing.cast("dict[str, Any]", value).items():
            yield from _numbers(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(typing.cast("Sequence[Any]", value)):
            yield from _numbers(item, f"{path}[{i}]")


def _explain(message: str) -> tuple[str, str]:
    """Turn a message of msgspec into a sentence, and into what would be valid."""
    found = re.fullmatch(r"(?P<what>.*?)(?: - at `\$(?P<path>.*)`)?", message, re.DOTALL)
    what, path = (found["what"], (found["path"] or "").lstrip(".")) if found else (message, "")
    unknown = re.search(r"unknown field `(.+)`", what)
    missing = re.search(r"missing required field `(.+)`", what)
    table = f"[{path}]" if path else "the top level"
    if unknown:
        keys = _keys(path)
        return (
            f"unknown key '{unknown[1]}' in {table}{_closest(unknown[1], keys)}",
            f"valid here: {', '.join(keys)}",
        )
    if missing:
        return f"key '{missing[1]}' is missing in {table}", f"valid here: {', '.join(_keys(path))}"
    plain = what[0].lower() + what[1:].replace("`", "")
    return f"{path or 'the file'}: {plain}", _valid_kinds() if path == "drive.kind" else ""


def _keys(path: str) -> list[str]:
    """Return the keys that are valid in the table at `path`."""
    table: Any = Robot
    for part in filter(None, path.split(".")):
        hints = typing.get_type_hints(table)
        table = hints.get(re.sub(r"\[.*", "", part), Robot)
        if isinstance(table, types.UnionType):
            table = typing.get_args(table)[0]
    tag = table.__struct_config__.tag_field
    return [*filter(None, [tag]), *(f.encode_name for f in msgspec.structs.fields(table))]


def _valid_kinds() -> str:
    tables: tuple[Any, ...] = typing.get_args(DriveGeometry) or (DriveGeometry,)
    return "kinds are " + ", ".join(table.__struct_config__.tag for table in tables)


def _closest(word: str, valid: list[str]) -> str:
    near = difflib.get_close_matches(word, valid, n=1)
    return f", did you mean '{near[0]}'?" if near else ""
