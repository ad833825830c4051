"""Model of a robot by its kind; a box for kinds without a model."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from tsd_twin.errors import needs_extra
from tsd_twin.models.links import KinematicTree, Link
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)

if TYPE_CHECKING:
    from tsd_twin.models.solids import Parts


class RobotModel(Protocol):
    """Model of a robot kind: a module or an object with these functions.

    Drawing raises a `RobotFileError` if there is no room for the drive, as may an additional
    `check_room(robot)`, and the masses raise one if nothing remains for the chassis.
    """

    def draw(self, robot: Any, /) -> Parts:
        """Draw the parts of each kind of link, in the frame of the link."""
        ...

    def tree(self, robot: Any, /) -> KinematicTree:
        """Return the kinematic tree."""
        ...

    def masses_kg(self, robot: Any, /) -> dict[Link, float]:
        """Return the mass of each kind of link."""
        ...


_MODELS = KindTable[Callable[[], Any]](
    {
        SingularityDescription: partial(import_module, "tsd_twin.models.singularity"),
        OmniDescription: partial(import_module, "tsd_twin.models.omni"),
        SphereDescription: partial(import_module, "tsd_twin.models.sphere"),
        ExternalDescription: partial(import_module, "tsd_twin.models.external"),
    },
    lambda kind: kind.model,
    partial(import_module, "tsd_twin.models.box"),
)
"""Import of the model of each kind at first use, because drawing needs the packages of an extra."""


def _model(robot: RobotDescription) -> RobotModel:
    """Return the model of this kind of robot."""
    with needs_extra(f"A model of {robot.name}", "models"):
        return _MODELS.of(robot)()


def draw_parts(robot: RobotDescription) -> Parts:
    """Draw the parts of each kind of link, in the frame of the link.

    Raises:
        RobotFileError: If there is no room for the drive.
        MeshError: If a drawing is not a closed solid, which is a bug.
    """
    return _model(robot).draw(robot)


def check_room(robot: RobotDescription) -> None:
    """Check that a body can be drawn, a thousand times as fast as drawing it.

    Raises:
        RobotFileError: If there is no room for the drive.
    """
    check = getattr(_model(robot), "check_room", None)  # Other drives always have room.
    if check is not None:
        check(robot)


def kinematic_tree(robot: RobotDescription) -> KinematicTree:
    """Return the kinematic tree of a robot."""
    return _model(robot).tree(robot)


def masses_kg(robot: RobotDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis has the remainder.

    Raises:
        RobotFileError: If nothing remains for the chassis.
    """
    return _model(robot).masses_kg(robot)
