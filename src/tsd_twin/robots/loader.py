"""Reading robot descriptions: shipped ones by name, anybody's own by path."""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin.errors import RobotFileError
from tsd_twin.robots.robot import Robot


def names() -> list[str]:
    """Return the names of the shipped robots, sorted."""
    files = resources.files(__package__).iterdir()
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
        return resources.files(__package__).joinpath(f"{name_or_path}.toml").read_text("utf-8")
    try:
        return Path(name_or_path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise RobotFileError(name_or_path, f"cannot be read: {problem}") from error


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
        robot = msgspec.toml.decode(toml, type=Robot)
    except msgspec.ValidationError as error:
        raise RobotFileError(file, *_explain(str(error))) from error
    except msgspec.DecodeError as error:
        raise RobotFileError(file, f"not valid TOML: {error}") from error
    _check(robot, file)
    return robot


def _check(robot: Robot, file: str) -> None:
    """Raise for what no single value can show."""
    for path, number in _numbers(msgspec.to_builtins(robot)):
        if not math.isfinite(number):
            raise RobotFileError(file, f"{path}: {number} is not a finite number")
    motor, modules = robot.motor, robot.drive.modules
    rows = len(motor.signal)
    if any(b <= a for a, b in zip(motor.signal, motor.signal[1:], strict=False)):
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
        if any(b < a for a, b in zip(column, column[1:], strict=False)):
            raise RobotFileError(file, f"motor.speed_rpm[{i}] must not fall as the signal rises")
        if not motor.start_speed_rpm <= robot.drive.cruise_speed_rpm <= column[-1]:
            raise RobotFileError(
                file,
                f"drive.cruise_speed_rpm is {robot.drive.cruise_speed_rpm:g}, "
                f"motor {i + 1} turns from {motor.start_speed_rpm:g} to {column[-1]:g}",
                "between motor.start_speed_rpm and the last speed of every motor",
            )
    limits = robot.limits
    if limits.max_command_age_s > limits.max_command_age_ceiling_s:
        raise RobotFileError(
            file, "limits.max_command_age_s is above limits.max_command_age_ceiling_s"
        )


def _numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Walk all numbers below `value`, with the path of each."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, dict):
        for key, item in typing.cast("dict[str, Any]", value).items():
            yield from _numbers(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for i, item in enumerate(typing.cast("list[Any]", value)):
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
    return f"{path or 'the file'}: {plain}", ""


def _keys(path: str) -> list[str]:
    """Return the keys that are valid in the table at `path`."""
    table: Any = Robot
    for part in filter(None, path.split(".")):
        hints = typing.get_type_hints(table)
        table = hints.get(re.sub(r"\[.*", "", part), Robot)
        if isinstance(table, types.UnionType):
            table = typing.get_args(table)[0]
    return [f.encode_name for f in msgspec.structs.fields(table)]


def _closest(word: str, valid: list[str]) -> str:
    near = difflib.get_close_matches(word, valid, n=1)
    return f", did you mean '{near[0]}'?" if near else ""
