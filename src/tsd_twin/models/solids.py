"""Building blocks of the drawings: solids and outlines in millimetres, parts and materials."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType

from tsd_twin.errors import MeshError
from tsd_twin.models.links import Link
from tsd_twin.robots.description import Body

if TYPE_CHECKING:
    import trimesh  # Takes 0.5 s; import only where a robot is drawn, which few programs do.

Span: TypeAlias = tuple[float, float]
"""Lower and upper bound along an axis."""
Point: TypeAlias = tuple[float, float, float]

_FROM_Z = {"x": (0.0, 90.0, 0.0), "y": (-90.0, 0.0, 0.0), "z": (0.0, 0.0, 0.0)}
"""Rotations in degrees, about X, then Y, then Z, from Z to the named axis."""
_ORIGIN = (0.0, 0.0, 0.0)
_BLUNT = 0.1
"""Flatter corners are dropped, because offsetting creates many."""


def sides(radius: float) -> int:
    """Return the number of sides of a circle for an accuracy of about 0.2 mm."""
    return max(8, 4 * math.ceil(1.2 * math.sqrt(abs(radius))))


def circle(radius: float, at: tuple[float, float] = (0.0, 0.0)) -> CrossSection:
    """Draw a circle about `at`."""
    return CrossSection.circle(radius, sides(radius)).translate(at)


def rectangle(x: Span, y: Span, corner: float = 0.0) -> CrossSection:
    """Draw a rectangle with rounded corners."""
    plain = CrossSection.square((x[1] - x[0] - 2.0 * corner, y[1] - y[0] - 2.0 * corner))
    plain = plain.translate((x[0] + corner, y[0] + corner))
    return grown(plain, corner) if corner else plain


def polygon(points: Sequence[tuple[float, float]]) -> CrossSection:
    """Draw an outline through `points`, counter-clockwise."""
    return CrossSection([np.array(points, dtype=np.float64)])


def grown(outline: CrossSection, by: float) -> CrossSection:
    """Offset `outline` outward, or inward if negative; new corners are round."""
    return outline.offset(by, JoinType.Round, 2.0, sides(by)).simplify(_BLUNT)


def softened(outline: CrossSection, corner: float) -> CrossSection:
    """Round all corners of `outline`; parts narrower than two `corner` disappear."""
    return grown(grown(grown(outline, -corner), 2.0 * corner), -corner)


def strip_reach(outline: CrossSection, direction_deg: float, width: float) -> float:
    """Return the distance up to which a straight strip from the origin is within `outline`."""
    strip = rectangle((0.0, 1e4), (-0.5 * width, 0.5 * width))
    pieces: list[Any] = (outline.rotate(-direction_deg) ^ strip).decompose()
    return min((piece.bounds()[0], piece.bounds()[2]) for piece in pieces)[1]


def slab(outline: CrossSection, z: Span) -> Manifold:
    """Extrude `outline` between two heights."""
    return outline.extrude(z[1] - z[0]).translate((0.0, 0.0, z[0]))


def standing(outline: CrossSection, y: Span) -> Manifold:
    """Extrude an `outline` in X and Z along Y."""
    return slab(outline, (-y[1], -y[0])).rotate((90.0, 0.0, 0.0))


def sideways(outline: CrossSection, x: Span) -> Manifold:
    """Extrude an `outline` in Y and Z along X."""
    return slab(outline, x).rotate((90.0, 0.0, 90.0))


def box(x: Span, y: Span, z: Span) -> Manifold:
    """Draw a box between bounds."""
    return Manifold.cube((x[1] - x[0], y[1] - y[0], z[1] - z[0])).translate((x[0], y[0], z[0]))


def rod(
    radius: float,
    along: Span,
    axis: str = "z",
    at: Point = _ORIGIN,
    *,
    tip: float | None = None,
    corners: int = 0,
) -> Manifold:
    """Draw a cylinder about `axis` through `at`; a cone with `tip`, a prism with `corners`."""
    end = radius if tip is None else tip
    solid = Manifold.cylinder(along[1] - along[0], radius, end, corners or sides(radius))
    return solid.translate((0.0, 0.0, along[0])).rotate(_FROM_Z[axis]).translate(at)


def tube(inner: float, outer: float, along: Span, axis: str = "z") -> Manifold:
    """Draw a hollow cylinder about `axis`."""
    return slab(circle(outer) - circle(inner), along).rotate(_FROM_Z[axis])


def wire(points: Sequence[Point], radius: float) -> Manifold:
    """Draw a round wire through `points`."""
    balls = [Manifold.sphere(radius, 4).translate(point) for point in points]
    return union(Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(balls))


def union(solids: Iterable[Manifold]) -> Manifold:
    """Combine all `solids`, which need not be connected."""
    return Manifold.batch_boolean(list(solids), OpType.Add)


def around(solid: Manifold, count: int, start_deg: float = 0.0) -> Manifold:
    """Return `count` copies of `solid`, evenly spaced about Z."""
    return union(solid.rotate((0.0, 0.0, start_deg + 360.0 * i / count)) for i in range(count))


def gaps_deg(directions_deg: Sequence[float]) -> list[tuple[float, float]]:
    """Return sorted directions from 0 to 360 degrees, each with the angle to the next."""
    turned = sorted(a % 360.0 for a in directions_deg)
    return [(a, b - a) for a, b in zip(turned, [*turned[1:], turned[0] + 360.0], strict=True)]


def halfway_deg(directions_deg: Sequence[float]) -> tuple[float, ...]:
    """Return the directions midway between neighbours, one after each of `directions_deg`."""
    return tuple(a + 0.5 * gap for a, gap in gaps_deg(directions_deg))


Parts: TypeAlias = dict[Link, tuple["Part", ...]]
"""Parts of each kind of link, the chassis first."""
_GRID_M = 1e-6
"""Rounding of vertices, which makes files independent of the processor."""


@dataclass(frozen=True, slots=True)
class Material:
    """Colour and density of a part."""

    rgba: tuple[float, float, float, float]
    """Red, green, blue (sRGB) and opacity, 0 to 1."""
    metallic: float
    roughness: float
    density_kg_per_m3: float


class Drawing(NamedTuple):
    """Solid of a single material in the frame of its link, before conversion to a mesh."""

    name: str
    solid: Manifold
    """Millimetres, in the frame of the link."""
    material: Material


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Closed solid of a single material, possibly in several pieces."""

    name: str
    link: Link
    """Kind of link that the part belongs to."""
    mesh: trimesh.Trimesh
    """Metres, in the frame of the link; watertight."""
    material: Material

    def __post_init__(self) -> None:
        """Check the mesh.

        Raises:
            MeshError: If the mesh is empty or not a closed solid.
        """
        if not self.mesh.is_volume or self.mesh.volume <= 0.0:
            raise MeshError(
                f"{self.link}_{self.name} is not a closed solid: it has holes or no volume"
            )

    @property
    def file(self) -> str:
        """Name of the mesh file."""
        return f"{self.link}_{self.name}.stl"


def _mesh(solid: Manifold) -> trimesh.Trimesh:
    """Convert a drawing to metres, rounded, in an order that depends only on the shape.

    Corners that rounding merges remain separate, so that touching sheets are not welded.
    """
    import trimesh

    drawn: Any = solid.to_mesh()
    # Adding zero turns minus zero into zero.
    grid = np.round(1e-3 * np.asarray(drawn.vert_properties, np.float64) / _GRID_M) + 0.0
    order = np.lexsort(grid.T[::-1])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    faces = place[np.asarray(drawn.tri_verts, np.int64)]
    first = np.argmin(faces, axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return trimesh.Trimesh(grid[order] * _GRID_M, faces[np.lexsort(faces.T[::-1])], process=False)


def drawn(link: Link, drawings: Iterable[Drawing]) -> tuple[Part, ...]:
    """Convert the drawings of a kind of link to parts, dropping empty ones.

    Raises:
        MeshError: If a drawing is not a closed solid.
    """
    return tuple(
        Part(one.name, link, _mesh(one.solid), one.material)
        for one in drawings
        if not one.solid.is_empty()
    )


STEEL = Material((0.62, 0.64, 0.67, 1.0), 0.85, 0.34, 7800.0)
COPPER = Material((0.80, 0.42, 0.22, 1.0), 0.75, 0.4, 8900.0)
ANODISED = Material((0.20, 0.22, 0.26, 1.0), 0.6, 0.38, 2700.0)
BLACK = Material((0.115, 0.12, 0.135, 1.0), 0.1, 0.5, 1300.0)
RUBBER = Material((0.11, 0.11, 0.12, 1.0), 0.0, 0.85, 1200.0)
WHITE = Material((0.93, 0.93, 0.92, 1.0), 0.0, 0.55, 1050.0)
BOARD = Material((0.01, 0.33, 0.42, 1.0), 0.1, 0.5, 1850.0)
SHRINK = Material((0.10, 0.20, 0.62, 1.0), 0.0, 0.4, 1900.0)
YELLOW = Material((0.98, 0.74, 0.05, 1.0), 0.0, 0.5, 1100.0)
RED = Material((0.80, 0.06, 0.06, 1.0), 0.0, 0.5, 1300.0)
BLUE = Material((0.08, 0.32, 0.80, 1.0), 0.0, 0.5, 1300.0)


def acrylic_material(body: Body) -> Material:
    """Return the material of decks and ribs."""
    return Material(body.acrylic_rgba, 0.0, 0.12, 1180.0)


def frame_material(body: Body) -> Material:
    """Return the aluminium of the gimbal frames."""
    return Material(body.frame_rgba, 0.8, 0.36, 2700.0)


def shell_material(body: Body) -> Material:
    """Return the plastic of the wheels."""
    return Material(body.wheel_rgba, 0.0, 0.45, 1200.0)


def front_material(body: Body) -> Material:
    """Return the material of the arrow."""
    return Material(body.front_rgba, 0.0, 0.5, 1200.0)
