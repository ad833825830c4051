"""Loads robot descriptions by name (shipped) or path.

Errors name the key and the remedy.
"""

from __future__ import annotations

import difflib
import math
import typing
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SE2
from tsd_twin.robots.description import PACKAGE_NAME, RobotDescription
from tsd_twin.robots.kinds import description_class, kind_names, kind_of
from tsd_twin.robots.plausibility import range_problems
from tsd_twin.robots.singularity import SingularityDescription
from tsd_twin.tables import closest, value_problem

_PACKAGE = "tsd_twin.robots"
MAX_FILE_CHARS = 16_384
"""Maximum number of characters of a description; shipped ones have fewer than 3,000. Descriptions
also arrive over the bus, and a crafted longer one can occupy a TOML parser for a minute."""

_RENAMED_KEYS = {("noise", "spin_share"): "speed_scale_sigma"}
"""Keys of version 0.1 and before, by table; still read, also from old recordings."""

RobotT = TypeVar("RobotT", bound=RobotDescription)


def robot_names() -> list[str]:
    """Return the names of the shipped robots, sorted."""
    files = resources.files(_PACKAGE).iterdir()
    return sorted(Path(f.name).stem for f in files if f.name.endswith(".toml"))


def read_description(name_or_path: str) -> str:
    """Return the TOML text of a shipped robot or of a file.

    Raises:
        RobotFileError: If no such robot or file exists; the message lists the shipped robots.
    """
    if "/" not in name_or_path and not name_or_path.endswith(".toml"):
        if name_or_path not in robot_names():
            raise RobotFileError(
                name_or_path,
                "no such robot" + closest(name_or_path, robot_names()),
                f"shipped are {', '.join(robot_names())}; your own is given by its path, "
                f"my_robot.toml",
            )
        return resources.files(_PACKAGE).joinpath(f"{name_or_path}.toml").read_text("utf-8")
    try:
        return Path(name_or_path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise RobotFileError(
            name_or_path, f"cannot be read: {problem}", f"shipped are {', '.join(robot_names())}"
        ) from error


def load_robot(name_or_path: str) -> RobotDescription:
    """Load a shipped robot by name, or a TOML file by path.

    Raises:
        RobotFileError: If the file is missing, misspelt or impossible; the message names file and
            key.
    """
    return parse_description(read_description(name_or_path), name_or_path)


def description_of_kind(robot: RobotDescription, kind: type[RobotT]) -> RobotT:
    """Return `robot` typed as a `kind`, for callers that support only that kind.

    Raises:
        RobotFileError: If the robot is of another kind; the message names the required one.
    """
    if not isinstance(robot, kind):
        raise RobotFileError(
            robot.name, f"drive.kind is {kind_of(robot)}", f"{kind_of(kind)} is needed here"
        )
    return robot


def parse_description(toml: str, file: str) -> RobotDescription:
    """Parse the robot of a TOML text; `file` is its name in error messages.

    Raises:
        RobotFileError: As in `load_robot`.
    """
    if len(toml) > MAX_FILE_CHARS:
        raise RobotFileError(
            file, f"{len(toml)} characters are too many", f"at most {MAX_FILE_CHARS}"
        )
    try:
        tables: Any = msgspec.toml.decode(toml)
    except RecursionError as error:
        raise RobotFileError(file, "tables or lists are nested too deeply") from error
    # Python raises a plain ValueError for integers with thousands of digits.
    except (msgspec.DecodeError, ValueError) as error:
        raise RobotFileError(file, f"not valid TOML: {error}") from error
    return description_of_tables(tables, file)


def description_of_tables(tables: Any, file: str) -> RobotDescription:
    """Convert the tables of a TOML text to a robot.

    Raises:
        RobotFileError: As in `load_robot`.
    """
    kind = _kind(tables, file)
    tables = _with_current_keys(tables)
    try:
        robot = msgspec.convert(tables, kind)
    except msgspec.ValidationError as error:
        problem = value_problem(tables, kind, "") or (str(error), "")
        raise RobotFileError(file, *problem) from error
    except RecursionError as error:
        raise RobotFileError(file, "tables or lists are nested too deeply") from error
    _check(robot, file)
    return robot


def _kind(tables: Any, file: str) -> type[RobotDescription]:
    """Return the description class of a file; parsing reports other errors."""
    table = tables.get("drive")
    if not isinstance(table, dict):
        return SingularityDescription
    drive = typing.cast("dict[str, Any]", table)
    keys = list(drive)
    if "kind" not in keys:
        near = difflib.get_close_matches("kind", keys, n=1)
        problem = (
            f"unknown key '{near[0]}' in [drive], did you mean 'kind'?"
            if near
            else "key 'kind' is missing in [drive]"
        )
        raise RobotFileError(file, problem, f"kinds are {', '.join(kind_names())}")
    package = tables.get("package", "")
    named = package if isinstance(package, str) and PACKAGE_NAME.fullmatch(package) else ""
    return description_class(str(drive["kind"]), file, named)


def _with_current_keys(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables with renamed keys replaced; a table with both keys keeps both, an error."""
    for (name, old), new in _RENAMED_KEYS.items():
        table = tables.get(name)
        if isinstance(table, dict) and old in table and new not in table:
            values = typing.cast("dict[str, Any]", table)
            tables = tables | {name: {new if key == old else key: values[key] for key in values}}
    return tables


def _check(robot: RobotDescription, file: str) -> None:
    """Check the rules between values, and raise for a violation."""
    numbers = list(_numbers(msgspec.to_builtins(robot)))
    for path, number in numbers:
        if not math.isfinite(number):
            raise RobotFileError(file, f"{path}: {number} is not a finite number")
    for problem, valid in range_problems(numbers):
        raise RobotFileError(file, problem, valid)
    limits = robot.limits
    if limits.max_command_age_s > limits.max_command_age_ceiling_s:
        raise RobotFileError(
            file, "limits.max_command_age_s is above limits.max_command_age_ceiling_s"
        )
    if robot.sensor_tables and (robot.driven_by_ros or robot.kinematics().pose_type is not SE2):
        raise RobotFileError(file, "[[sensors]] are for robots that a node drives on a floor")
    for problem, valid in robot.problems():
        raise RobotFileError(file, problem, valid)


def _numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers below `value`, each with its path."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, dict):
        for key, item in typing.cast("dict[str, Any]", value).items():
            yield from _numbers(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(typing.cast("Sequence[Any]", value)):
            yield from _numbers(item, f"{path}[{i}]")
