"""The look of one description of a robot, in the forms that the scene needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import manifold3d
import numpy as np
import numpy.typing as npt

from tsd_twin.dashboard.palette import Rgb
from tsd_twin.dashboard.poses import Skeleton
from tsd_twin.description import Hinge, Link, Part, glb, parts, tree
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import Robot

_MANIFOLD: Any = manifold3d.Manifold  # Its stubs leave the shapes of arrays open.
_OUTLINE: Any = manifold3d.CrossSection

BODY: Link = "chassis"
"""The kind of link that stands still in the base frame; all others move."""
_TINT = 0.6
"""Share of the colour in a part that is tinted with it."""


class Surface(NamedTuple):
    """A mesh of triangles."""

    vertices: npt.NDArray[np.float32]
    """(n, 3): metres."""
    faces: npt.NDArray[np.uint32]
    """(m, 3)."""

    @classmethod
    def of(cls, solid: Any) -> Surface:
        """Return the surface of a Manifold, as copies: a view would keep the solid alive."""
        mesh = solid.to_mesh()
        return cls(
            np.array(mesh.vert_properties[:, :3], np.float32), np.array(mesh.tri_verts, np.uint32)
        )


class Shape:
    """Parts of a robot, as meshes for viewers; made once for all robots of a description."""

    def __init__(self, robot: Robot) -> None:
        self.drive = robot.kinematics()
        self.skeleton = Skeleton(tree(robot), self.drive)
        self._parts = parts(robot)
        self.glbs: dict[Link, bytes] = {kind: glb(drawn) for kind, drawn in self._parts.items()}
        """A binary glTF for each kind of link, metres, in the frame of the link."""
        self._poses = self.skeleton.poses(
            SE2.identity(), SO3.identity(), np.zeros(len(self.drive.joints))
        )

    @property
    def moving(self) -> tuple[Link, ...]:
        """The kinds of links that move in the base frame."""
        return tuple(kind for kind in self._parts if kind != BODY)

    def count(self, kind: Link) -> int:
        """Return how many links of a kind one robot has."""
        return len(self._poses[kind].wxyz)

    def tinted(self, kind: Link, colour: Rgb) -> bytes:
        """Return the binary glTF of a kind of link, all its parts tinted."""
        return glb(_tinted(self._parts[kind], colour))

    @property
    def tilts(self) -> bool:
        """Whether joints are told which angle to have, as gimbals are; wheels only turn."""
        return any(limbs.hinge is Hinge.ANGLE for limbs in self.skeleton.tree.limbs)

    @property
    def ball_radius_m(self) -> float | None:
        """Radius of the ball that it turns in place; None: it drives over a floor."""
        for limbs in self.skeleton.tree.limbs:
            if limbs.hinge is Hinge.BALL and limbs.hull is not None:
                return limbs.hull.radius_m
        return None

    @cached_property
    def hull(self) -> Surface:
        """The convex hull of all parts, joints at zero; origin on the floor below `base_link`."""
        points = [
            SO3(wxyz).rotate(np.asarray(part.mesh.vertices)) + position
            for kind, drawn in self._parts.items()
            for wxyz, position in zip(*self._poses[kind], strict=True)
            for part in drawn
        ]
        return Surface.of(_MANIFOLD.hull_points(np.concatenate(points)))

    @cached_property
    def footprint(self) -> Array:
        """(n, 2): outline of the hull seen from above, counter-clockwise, metres."""
        seen = self.hull.vertices[:, :2].astype(np.float64)
        return np.asarray(_OUTLINE.hull_points(seen).to_polygons()[0])

    @cached_property
    def height_m(self) -> float:
        """Height above the floor."""
        return float(self.hull.vertices[:, 2].max())

    @cached_property
    def reach_m(self) -> float:
        """How far the robot reaches from its middle, in the plane."""
        return float(np.hypot(*self.footprint.T).max())


def _tinted(drawn: Iterable[Part], colour: Rgb) -> list[Part]:
    tint = np.array(colour) / 255.0
    mixed = [(1.0 - _TINT) * np.array(part.rgba[:3]) + _TINT * tint for part in drawn]
    return [
        replace(part, rgba=(float(r), float(g), float(b), 1.0))
        for part, (r, g, b) in zip(drawn, mixed, strict=True)
    ]
