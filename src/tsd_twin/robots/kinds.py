"""Description classes by robot kind, for shipped kinds and installed packages."""

from __future__ import annotations

import typing
from typing import Any

from tsd_twin import registry
from tsd_twin.errors import RobotFileError
from tsd_twin.robots.description import RobotDescription
from tsd_twin.robots.external import ExternalDescription
from tsd_twin.robots.omni import OmniDescription, SphereDescription
from tsd_twin.robots.singularity import SingularityDescription
from tsd_twin.tables import closest

DESCRIPTIONS: dict[str, type[RobotDescription]] = {
    "singularity": SingularityDescription,
    "omni": OmniDescription,
    "sphere": SphereDescription,
    "imported": ExternalDescription,
}
"""Shipped kinds: maps `drive.kind` to the description class."""


def kind_names() -> list[str]:
    """Return the names of all known kinds: shipped kinds first, then kinds from packages."""
    return [*DESCRIPTIONS, *sorted(set(registry.entry_points()) - set(DESCRIPTIONS))]


def kind_of(robot: RobotDescription | type[RobotDescription]) -> str:
    """Return the kind of a robot or description class, which is the tag of its `drive` table."""
    cls = robot if isinstance(robot, type) else type(robot)
    table: Any = typing.get_type_hints(cls)["drive"]
    return str(table.__struct_config__.tag)


def description_class(kind: str, file: str, package: str = "") -> type[RobotDescription]:
    """Return the description class of a kind; `package` is the package named in the file.

    Raises:
        RobotFileError: If the kind is unknown, or its package cannot be used.
    """
    if kind in DESCRIPTIONS:
        return DESCRIPTIONS[kind]
    try:
        if kind not in registry.entry_points():
            raise _unknown(kind, file, package)
        found = registry.load_kind(kind).description
    except registry.KindError as error:
        raise RobotFileError(file, f"drive.kind: {error}") from error
    if not issubclass(found, RobotDescription):
        raise RobotFileError(file, f"drive.kind: {found!r} is not a RobotDescription")
    if kind_of(found) != kind:
        raise RobotFileError(file, f"drive.kind: {kind!r} has the tag {kind_of(found)!r}")
    return found


def _unknown(kind: str, file: str, package: str) -> RobotFileError:
    missing = (
        f"; the package {package}, which provides it, is not installed"
        if package
        else "; no installed package provides it"
    )
    problem = f"drive.kind: invalid value {kind!r}{closest(kind, kind_names()) or missing}"
    return RobotFileError(file, problem, f"kinds are {', '.join(kind_names())}")
