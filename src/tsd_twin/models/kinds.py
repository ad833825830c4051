"""Model of a robot by its kind; a box for kinds that have none."""

from __future__ import annotations

from typing import Any, Protocol

from tsd_twin.models import box, imported, omni, singularity, sphere
from tsd_twin.models.links import KinematicTree
from tsd_twin.models.solids import Link, Parts
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ImportedDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)


class RobotModel(Protocol):
    """Model of one kind of robot: a module or an object with these functions.

    It may also have `check_room(robot)`, which raises a `RobotFileError` if the body has no room
    for the drive.
    """

    def draw(self, robot: Any, /) -> Parts:
        """Return the parts of each kind of link, in the frame of the link."""
        ...

    def tree(self, robot: Any, /) -> KinematicTree:
        """Return the kinematic tree."""
        ...

    def masses_kg(self, robot: Any, /) -> dict[Link, float]:
        """Return the mass of each kind of link."""
        ...


_MODELS = KindTable[RobotModel](
    {
        SingularityDescription: singularity,
        OmniDescription: omni,
        SphereDescription: sphere,
        ImportedDescription: imported,
    },
    lambda kind: None if kind.model is None else kind.model(),
    box,
)


def draw_parts(robot: RobotDescription) -> Parts:
    """Parts of each kind of link, in the frame of the link, drawn to the description.

    Raises:
        RobotFileError: If the body has no room for the drive.
        MeshError: If a drawing is not a closed solid, which is a bug.
    """
    return _MODELS.of(robot).draw(robot)


def check_room(robot: RobotDescription) -> None:
    """Check that a body can be drawn, in a thousandth of the time that drawing it takes.

    Raises:
        RobotFileError: If the body has no room for the drive.
    """
    check = getattr(_MODELS.of(robot), "check_room", None)  # Other drives have room in any case.
    if check is not None:
        check(robot)


def kinematic_tree(robot: RobotDescription) -> KinematicTree:
    """Return how the links of a robot hang on one another."""
    return _MODELS.of(robot).tree(robot)


def masses_kg(robot: RobotDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis weighs what the others leave.

    Raises:
        RobotFileError: If they leave nothing.
    """
    return _MODELS.of(robot).masses_kg(robot)
