"""Implementations by robot kind: a table in each layer, and kinds from other packages.

Each layer lists only its own implementations. Kinds that are not shipped come from the entry-point
group `tsd_twin.kinds`; see `docs/own_kind.md`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from typing import Any, Generic, TypeVar

from tsd_twin.errors import TwinError

GROUP = "tsd_twin.kinds"
"""Entry-point group: the name is the value of `drive.kind`, the object a `RobotKind`."""

ValueT = TypeVar("ValueT")


class KindError(TwinError):
    """An installed package provides a robot kind that cannot be used."""


@dataclass(frozen=True, slots=True)
class RobotKind:
    """Kind of robot from another package; only the description is required.

    Functions are called with the description of the robot, except `model`. Import their
    dependencies inside them, so that a client loads neither meshes nor the dashboard.
    """

    description: type[Any]
    """Subclass of `RobotDescription`; the tag of its `drive` table is the name of the kind."""
    odometry: Callable[[Any], Any] | None = None
    """Returns a `WheelOdometry` and whether it is the better estimate, or None. Default: joint
    odometry only."""
    plants: Mapping[str, Callable[..., Any]] = field(default_factory=dict[str, Callable[..., Any]])
    """Simulation factories by plant name, called as `simulate`. Default: no simulation."""
    model: Callable[[], Any] | None = None
    """Returns a `RobotModel` for all robots of the kind. Default: a box."""
    view: Callable[[Any], Any] | None = None
    """Returns the `ActuatorTelemetry` for the page panel. Default: a list of joints."""


_LOADED: dict[type[Any], RobotKind] = {}
"""Kinds imported by `load_kind`, by description class."""


class KindTable(Generic[ValueT]):
    """Implementations in a layer by description class."""

    def __init__(
        self,
        shipped: Mapping[type[Any], ValueT],
        part: Callable[[RobotKind], ValueT | None],
        default: ValueT,
    ) -> None:
        """List the shipped kinds.

        `part` selects the implementation of a kind from another package. If it returns None,
        `default` is used.
        """
        self.shipped: Mapping[type[Any], ValueT] = dict(shipped)
        """Implementations of the shipped kinds."""
        self._part = part
        self._default = default

    def of(self, description: object) -> ValueT:
        """Return the implementation for the class of a robot `description`."""
        cls = type(description)
        if cls in self.shipped:
            return self.shipped[cls]
        kind = _LOADED.get(cls)
        found = None if kind is None else self._part(kind)
        return self._default if found is None else found


@cache
def entry_points() -> Mapping[str, metadata.EntryPoint]:
    """Return the entry points of kinds in installed packages, by kind.

    Raises:
        KindError: If two packages provide the same kind.
    """
    found: dict[str, metadata.EntryPoint] = {}
    for point in metadata.entry_points(group=GROUP):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise KindError(
                f"two packages offer the kind of robot '{point.name}': {_package(other)} and "
                f"{_package(point)}; uninstall one of them"
            )
    return found


@cache
def load_kind(name: str) -> RobotKind:
    """Import the kind `name` from an installed package.

    Raises:
        KindError: If the package cannot be imported or does not provide a `RobotKind`.
        KeyError: If no package provides it.
    """
    point = entry_points()[name]
    try:
        kind = point.load()
    except Exception as error:  # Any error of the other package.
        raise KindError(
            f"the kind of robot '{name}' of the package {_package(point)} cannot be loaded: "
            f"{type(error).__name__}: {error}"
        ) from error
    if not isinstance(kind, RobotKind):
        raise KindError(f"{point.value} of the package {_package(point)} is not a RobotKind")
    _LOADED[kind.description] = kind
    return kind


def _package(point: metadata.EntryPoint) -> str:
    return "unknown" if point.dist is None else point.dist.name
