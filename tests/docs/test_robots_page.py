"""docs/robots.md has every key of a description, its default, and errors as they are."""

from __future__ import annotations

import json
import typing
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from tests.docs.pages import page, quoted, section, tables
from tsd_twin import robots
from tsd_twin.errors import RobotFileError
from tsd_twin.robots.robot import Robot, Table

PAGE = page("robots.md")
TSD = robots.text("tsd")


def tables_of_a_description() -> Iterator[tuple[str, type[Table]]]:
    """Walk all tables, the robot itself first."""
    yield "## The robot", Robot
    for name, kind in typing.get_type_hints(Robot).items():
        if isinstance(kind, type) and issubclass(kind, Table):
            yield f"## `[{name}]`", kind


def default(field: msgspec.structs.FieldInfo) -> str:
    value: Any = field.default
    if field.default_factory is not msgspec.NODEFAULT:
        value = field.default_factory()
    if value is msgspec.NODEFAULT:
        return "required"
    if isinstance(value, Table):
        return "all defaults"
    return "none" if value is None else f"`{json.dumps(value)}`"


@pytest.mark.parametrize(("heading", "kind"), list(tables_of_a_description()))
def test_every_key_is_explained_with_its_default(heading: str, kind: type[Table]) -> None:
    (rows,) = tables(section(PAGE, heading))
    shown = {quoted(row[0])[0]: row[2] for row in rows}
    tag = kind.__struct_config__.tag_field
    expected = {tag: "required"} if tag else {}
    expected |= {field.name: default(field) for field in msgspec.structs.fields(kind)}
    assert shown == expected
    assert all(row[3] for row in rows), "a key without a meaning"


@pytest.mark.parametrize("row", tables(section(PAGE, "## What errors look like"))[0])
def test_the_errors_are_those_that_are_raised(row: list[str]) -> None:
    old, new = quoted(row[0])
    assert TSD.count(old) == 1
    with pytest.raises(RobotFileError) as caught:
        robots.parse(TSD.replace(old, new), "my.toml")
    assert str(caught.value) == quoted(row[1])[0]
