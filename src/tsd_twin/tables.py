"""Tables of a robot description: number types, base class, and problems of their values."""

from __future__ import annotations

import difflib
import typing
from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import Meta

Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]
Share: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Colour: TypeAlias = tuple[Share, Share, Share, Share]
"""Red, green, blue (sRGB) and opacity."""
Name: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
"""Names used in bus keys; the pattern ends in a strict anchor, as `$` accepts a trailing
newline."""
Problem: TypeAlias = tuple[str, str]
"""Problem of a description, and its remedy or ""."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Table of the file: unknown keys are errors, values are read-only."""


def value_problem(value: Any, hint: Any, path: str) -> Problem | None:
    """Return the first problem of `value` with its type, deepest first, or None."""
    problem: Problem | None = None
    table = _table_class(hint)
    if table is not None and isinstance(value, dict):
        problem = table_problem(typing.cast("dict[str, Any]", value), table, path)
    elif isinstance(value, list):
        items = enumerate(typing.cast("list[Any]", value))
        found = (value_problem(one, _item_hint(hint, i), f"{path}[{i}]") for i, one in items)
        problem = next(filter(None, found), None)
    if problem is not None or hint is None:
        return problem
    try:
        msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        text = str(error)
        return f"{path or 'the file'}: {text[0].lower()}{text[1:].replace('`', '')}", ""
    return None


def table_problem(values: dict[str, Any], table: type[Table], path: str) -> Problem | None:
    """Return the first unknown, missing or impossible key of a table, or None."""
    fields = {field.encode_name: field for field in msgspec.structs.fields(table)}
    tag = table.__struct_config__.tag_field
    keys = [*filter(None, [tag]), *fields]
    place, valid = f"[{path}]" if path else "the top level", f"valid here: {', '.join(keys)}"
    for key in values:
        if key not in keys:
            return f"unknown key '{key}' in {place}{closest(key, keys)}", valid
    for key, field in fields.items():
        if key in values:
            below = f"{path}.{key}" if path else key
            problem = value_problem(values[key], field.type, below)
            if problem:
                return problem
        elif field.required:
            return f"key '{key}' is missing in {place}", valid
    return None


def _table_class(hint: Any) -> type[Table] | None:
    """Return the table class of a type hint, also of an optional one."""
    if isinstance(hint, type):
        return hint if issubclass(hint, Table) else None
    if typing.get_origin(hint) in (list, tuple):
        return None
    inside = (_table_class(part) for part in typing.get_args(hint))
    return next((table for table in inside if table is not None), None)


def _item_hint(hint: Any, index: int) -> Any:
    """Return the type of an item of a list or tuple, also of an optional one; None if neither."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is list:
        return parts[0]
    if origin is tuple:
        return parts[min(index, len(parts) - 1)]
    inside = (_item_hint(part, index) for part in parts)
    return next((each for each in inside if each is not None), None)


def closest(word: str, valid: list[str]) -> str:
    """Return a question that suggests the valid word that was meant, or ""."""
    near = difflib.get_close_matches(word, valid, n=1)
    return f", did you mean '{near[0]}'?" if near else ""
