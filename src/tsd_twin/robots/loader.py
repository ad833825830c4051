"""Loads robot descriptions by name (shipped) or path, and creates variants.

Errors name the key and the remedy.
"""

from __future__ import annotations

import difflib
import math
import re
import typing
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from tsd_twin.errors import RobotFileError, needs_extra
from tsd_twin.robots.description import Problem, RobotDescription, Table
from tsd_twin.robots.kinds import DESCRIPTIONS, Knob, kind_of
from tsd_twin.robots.plausibility import range_problems
from tsd_twin.robots.singularity import SingularityDescription

_PACKAGE = "tsd_twin.robots"
LONGEST = 16_384
"""Maximum number of characters of a description; shipped ones have fewer than 3,000. Descriptions
also arrive over the bus, and a crafted longer one can occupy a TOML parser for a minute."""

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
                "no such robot" + _closest(name_or_path, robot_names()),
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
        needed, given = (
            next(tag for tag, table in DESCRIPTIONS.items() if table is each)
            for each in (kind, type(robot))
        )
        raise RobotFileError(robot.name, f"drive.kind is {given}", f"{needed} is needed here")
    return robot


def parse_description(toml: str, file: str) -> RobotDescription:
    """Parse the robot of a TOML text; `file` is its name in error messages.

    Raises:
        RobotFileError: As in `load_robot`.
    """
    if len(toml) > LONGEST:
        raise RobotFileError(file, f"{len(toml)} characters are too many", f"at most {LONGEST}")
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
    try:
        robot = msgspec.convert(tables, kind)
    except msgspec.ValidationError as error:
        raise RobotFileError(file, *_explain(str(error), kind)) from error
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
        raise RobotFileError(file, problem, _valid_kinds())
    kind = drive["kind"]
    if not isinstance(kind, str) or kind not in DESCRIPTIONS:
        problem = f"drive.kind: invalid value {kind!r}" + _closest(str(kind), list(DESCRIPTIONS))
        raise RobotFileError(file, problem, _valid_kinds())
    return DESCRIPTIONS[kind]


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


def _explain(message: str, kind: type[RobotDescription]) -> Problem:
    """Convert a message of msgspec to a sentence and a list of valid values."""
    found = re.fullmatch(r"(?P<what>.*?)(?: - at `\$(?P<path>.*)`)?", message, re.DOTALL)
    what, path = (found["what"], (found["path"] or "").lstrip(".")) if found else (message, "")
    unknown = re.search(r"unknown field `(.+)`", what)
    missing = re.search(r"missing required field `(.+)`", what)
    table = f"[{path}]" if path else "the top level"
    if unknown:
        keys = _keys(path, kind)
        return (
            f"unknown key '{unknown[1]}' in {table}{_closest(unknown[1], keys)}",
            f"valid here: {', '.join(keys)}",
        )
    if missing:
        keys = _keys(path, kind)
        return f"key '{missing[1]}' is missing in {table}", f"valid here: {', '.join(keys)}"
    plain = what[0].lower() + what[1:].replace("`", "")
    return f"{path or 'the file'}: {plain}", ""


def _keys(path: str, kind: type[RobotDescription]) -> list[str]:
    """Return the valid keys of the table at `path` for this kind."""
    table: Any = kind
    for part in filter(None, path.split(".")):
        table = _table(typing.get_type_hints(table).get(re.sub(r"\[.*", "", part)))
    tag = table.__struct_config__.tag_field
    return [*filter(None, [tag]), *(f.encode_name for f in msgspec.structs.fields(table))]


def _table(hint: Any) -> Any:
    """Return the table class in a type hint, possibly inside a list or an optional."""
    if isinstance(hint, type) and issubclass(hint, Table):
        return hint
    inside = (_table(part) for part in typing.get_args(hint))
    return next((table for table in inside if table is not None), None)


def _valid_kinds() -> str:
    return "kinds are " + ", ".join(DESCRIPTIONS)


def _closest(word: str, valid: list[str]) -> str:
    near = difflib.get_close_matches(word, valid, n=1)
    return f", did you mean '{near[0]}'?" if near else ""


@cache
def _base(name: str) -> RobotDescription:
    return load_robot(name)


def base_robot(name: str) -> RobotDescription:
    """Return a shipped robot as the base for variants.

    Raises:
        RobotFileError: If no robot of this name is shipped. Paths are rejected, because names come
            from pages.
    """
    if name not in robot_names():
        raise RobotFileError(name, "no such robot", f"shipped are {', '.join(robot_names())}")
    return _base(name)


def knobs_of(robot: RobotDescription) -> dict[str, tuple[Knob, str, float]]:
    """Return a robot's tunable parameters by key, each with label and value."""
    tables = msgspec.to_builtins(robot)
    return {
        key: (knob, label, float(value_at(tables, key)))
        for knob in kind_of(robot).knobs
        for key, label in _places(knob, tables)
    }


def variant(base: str, changes: Mapping[str, float]) -> RobotDescription:
    """Return the robot `base` with changed parameters.

    Raises:
        RobotFileError: If there is no such robot or parameter, or the robot would be impossible.
    """
    robot = base_robot(base)
    tables = deepcopy(msgspec.to_builtins(robot))
    for key, value in _check_changes(robot, changes).items():
        set_value(tables, key, value)
    return description_of_tables(tables, base)


def variant_toml(base: str, changes: Mapping[str, float]) -> str:
    """Return a variant as TOML accepted by `--robot`, with the comments of the shipped file.

    Raises:
        RobotFileError: As in `variant`.
    """
    robot = variant(base, changes)
    before = knobs_of(base_robot(base))
    with needs_extra("The file of a changed robot", "dashboard"):
        import tomlkit

    document: Any = tomlkit.parse(read_description(base))
    document["name"] = f"my-{robot.name}"
    document["title"] = f"{robot.title}, changed"
    for key, value in changes.items():
        set_value(document, key, float(value))
    notes = [f"{key} is {value:g}, was {before[key][2]:g}" for key, value in changes.items()]
    document["assumptions"] = [*robot.assumptions, *(f"changed: {note}" for note in notes)]
    if "assumptions" in document and len(document["assumptions"]) > 1:
        document["assumptions"].multiline(multiline=True)
    return tomlkit.dumps(document)


def _check_changes(robot: RobotDescription, changes: Mapping[str, float]) -> Mapping[str, float]:
    """Return `changes` after checking that all are known parameters within their ranges."""
    knobs = knobs_of(robot)
    for key, value in changes.items():
        if key not in knobs:
            raise RobotFileError(robot.name, f"{key} is no knob", f"knobs are {', '.join(knobs)}")
        knob, _, _ = knobs[key]
        # False for NaN.
        if not knob.least <= value <= knob.most:
            raise RobotFileError(
                robot.name, f"{key} is {value:g}", f"from {knob.least:g} to {knob.most:g}"
            )
    return changes


def _places(knob: Knob, tables: Any) -> Iterator[tuple[str, str]]:
    """Yield the key of each number in `tables`, and its label."""
    before, star, after = knob.key.partition("*")
    if not star:
        yield knob.key, knob.label
        return
    for i in range(len(value_at(tables, before.rstrip(".")))):
        yield f"{before}{i}{after}", knob.label.format(i + 1)


def value_at(tables: Any, key: str) -> Any:
    """Return the value at a key; list entries are counted from 0."""
    for part in key.split("."):
        tables = tables[int(part) if isinstance(tables, list) else part]
    return tables


def set_value(tables: Any, key: str, value: float) -> None:
    """Set the number at a key."""
    above, _, last = key.rpartition(".")
    table = value_at(tables, above)
    table[int(last) if isinstance(table, list) else last] = value
