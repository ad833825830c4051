"""Variants of shipped robots with changed parameters, for the Student tab."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import msgspec
import tomlkit

from tsd_twin.dashboard.sessions.kinds import TunableParameter, view_of
from tsd_twin.dashboard.wire.student import StudentKnob
from tsd_twin.errors import RobotFileError
from tsd_twin.robots import RobotDescription, load_robot, read_description, robot_names
from tsd_twin.robots.loader import description_of_tables


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


def knobs_of(robot: RobotDescription) -> dict[str, StudentKnob]:
    """Return a robot's tunable parameters by key."""
    tables = msgspec.to_builtins(robot)
    knobs: dict[str, StudentKnob] = {}
    for knob in view_of(robot).knobs:
        for key, label in _places(knob, tables):
            value = float(value_at(tables, key))
            knobs[key] = StudentKnob(
                key, label, knob.unit, value, value, knob.least, knob.most, knob.step
            )
    return knobs


def variant(base: str, changes: Mapping[str, float]) -> RobotDescription:
    """Return the robot `base` with changed parameters.

    Raises:
        RobotFileError: If there is no such robot or parameter, or the robot would be impossible.
    """
    robot = base_robot(base)
    _check_changes(robot, changes)
    tables = msgspec.to_builtins(robot)
    for key, value in changes.items():
        set_value(tables, key, value)
    return description_of_tables(tables, base)


def variant_toml(base: str, changes: Mapping[str, float]) -> str:
    """Return a variant as TOML accepted by `--robot`, with the comments of the shipped file.

    Raises:
        RobotFileError: As in `variant`.
    """
    robot = variant(base, changes)
    before = knobs_of(base_robot(base))
    document: Any = tomlkit.parse(read_description(base))
    document["name"] = f"my-{robot.name}"
    document["title"] = f"{robot.title}, changed"
    for key, value in changes.items():
        set_value(document, key, float(value))
    notes = [f"{key} is {value:g}, was {before[key].value:g}" for key, value in changes.items()]
    document["assumptions"] = [*robot.assumptions, *(f"changed: {note}" for note in notes)]
    if "assumptions" in document and len(document["assumptions"]) > 1:
        document["assumptions"].multiline(multiline=True)
    return tomlkit.dumps(document)


def _check_changes(robot: RobotDescription, changes: Mapping[str, float]) -> None:
    """Refuse unknown parameters, and values outside their ranges."""
    knobs = knobs_of(robot)
    for key, value in changes.items():
        if key not in knobs:
            raise RobotFileError(robot.name, f"{key} is no knob", f"knobs are {', '.join(knobs)}")
        knob = knobs[key]
        # False for NaN.
        if not knob.least <= value <= knob.most:
            raise RobotFileError(
                robot.name, f"{key} is {value:g}", f"from {knob.least:g} to {knob.most:g}"
            )


def _places(knob: TunableParameter, tables: Any) -> Iterator[tuple[str, str]]:
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
