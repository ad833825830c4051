"""Editing of description files: writes calibrated values, keeps comments and everything else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from tsd_twin import robots
from tsd_twin.errors import RobotFileError
from tsd_twin.robots import SingularityDescription

TomlTables = Mapping[str, Mapping[str, Any]]
"""Keys and values by table."""


def write_description(file: str, used: str, tables: TomlTables) -> None:
    """Set keys in the description `file` and keep its comments; a new file starts from `used`.

    The file is replaced as a whole or not at all.

    Raises:
        RobotFileError: the file is not a valid description of this kind, before or after the
            change, or cannot be written.
    """
    path = Path(file)
    if path.suffix != ".toml":
        raise RobotFileError(file, "is no place for a description", "a name that ends in .toml")
    text = edit_description(robots.read_description(file) if path.exists() else used, file, tables)
    beside = path.with_name(f".{path.name}.new")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        raise RobotFileError(file, f"cannot be written: {error.strerror}") from error


def edit_description(text: str, file: str, tables: TomlTables) -> str:
    """Return the TOML text of a description with changed values.

    Raises:
        RobotFileError: as in `write_description`.
    """
    robots.description_of_kind(robots.parse_description(text, file), SingularityDescription)
    try:
        document: Any = tomlkit.parse(text)
        for name, values in tables.items():
            if name not in document:
                document.add(tomlkit.nl())
                document.add(name, tomlkit.table())
            for key, value in values.items():
                document[name][key] = value
        changed = tomlkit.dumps(document)
    except TOMLKitError as error:
        raise RobotFileError(file, f"cannot be edited: {error}") from error
    robots.parse_description(changed, file)
    return changed
