"""docs/robots.md lists every key of a description, its default, and the actual errors."""

from __future__ import annotations

import json
import typing
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from tests.support.markdown_pages import page, quoted, section, tables
from tsd_twin import robots
from tsd_twin.errors import RobotFileError
from tsd_twin.robots import RobotDescription
from tsd_twin.tables import Table

PAGE = page("robots.md")
TSD = robots.read_description("tsd")


def tables_of_a_description() -> Iterator[tuple[str, type[Table], set[str]]]:
    """Yield all tables with their heading, and the keys documented elsewhere."""
    yield "## The robot", RobotDescription, set()
    common = set(RobotDescription.__struct_fields__)
    for name, table in inner(RobotDescription):
        yield f"## `[{name}]`", table, set()
    for kind, robot in robots.DESCRIPTIONS.items():
        yield f"## Kind `{kind}`", robot, common
        for name, table in inner(robot):
            if name not in common:
                yield f"### `[{name}]` of `{kind}`", table, set()


def inner(table: type[Table], path: str = "") -> Iterator[tuple[str, type[Table]]]:
    """Yield the paths and types of nested tables, including those in lists."""
    hints = typing.get_type_hints(table)
    for field in msgspec.structs.fields(table):
        name, hint = field.encode_name, hints[field.name]
        for kind in flat(hint):
            if isinstance(kind, type) and issubclass(kind, Table):
                yield f"{path}{name}", kind
                yield from inner(kind, f"{path}{name}.")


def flat(hint: Any) -> Iterator[Any]:
    yield hint
    for inside in typing.get_args(hint):
        yield from flat(inside)


def default(field: msgspec.structs.FieldInfo) -> str:
    value: Any = field.default
    if field.default_factory is not msgspec.NODEFAULT:
        value = field.default_factory()
    if value is msgspec.NODEFAULT:
        return "required"
    if isinstance(value, Table):
        return "all defaults"
    return "none" if value in (None, msgspec.UNSET) else f"`{json.dumps(value)}`"


@pytest.mark.parametrize(("heading", "kind", "elsewhere"), list(tables_of_a_description()))
def test_every_key_is_explained_with_its_default(
    heading: str, kind: type[Table], elsewhere: set[str]
) -> None:
    (rows,) = tables(section(PAGE, heading))
    shown = {quoted(row[0])[0]: row[2] for row in rows}
    tag = kind.__struct_config__.tag_field
    expected = {tag: "required"} if tag else {}
    fields = msgspec.structs.fields(kind)
    expected |= {f.encode_name: default(f) for f in fields if f.name not in elsewhere}
    assert shown == expected
    assert all(row[3] for row in rows), "a key without a meaning"


@pytest.mark.parametrize("row", tables(section(PAGE, "## What errors look like"))[0])
def test_the_errors_are_those_that_are_raised(row: list[str]) -> None:
    old, new = quoted(row[0])
    assert TSD.count(old) == 1
    with pytest.raises(RobotFileError) as caught:
        robots.parse_description(TSD.replace(old, new), "my.toml")
    assert str(caught.value) == quoted(row[1])[0]
