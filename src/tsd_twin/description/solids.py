"""Building blocks of the drawings, in millimetres: closed solids and flat outlines."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType

Span: TypeAlias = tuple[float, float]
"""Lower and upper bound along an axis."""
Point: TypeAlias = tuple[float, float, float]

_FROM_Z = {"x": (0.0, 90.0, 0.0), "y": (-90.0, 0.0, 0.0), "z": (0.0, 0.0, 0.0)}
"""Turns in degrees, about X, then Y, then Z, that bring Z to the named axis."""
_ORIGIN = (0.0, 0.0, 0.0)
_BLUNT = 0.1
"""Corners this flat are dropped: offsetting leaves many."""


def sides(radius: float) -> int:
    """Return how many sides a circle is drawn with, so that it is true to about 0.2 mm."""
    return max(8, 4 * math.ceil(1.2 * math.sqrt(abs(radius))))


def circle(radius: float, at: tuple[float, float] = (0.0, 0.0)) -> CrossSection:
    """Return a circle about `at`."""
    return CrossSection.circle(radius, sides(radius)).translate(at)


def rectangle(x: Span, y: Span, corner: float = 0.0) -> CrossSection:
    """Return a rectangle, its corners rounded."""
    plain = CrossSection.square((x[1] - x[0] - 2.0 * corner, y[1] - y[0] - 2.0 * corner))
    plain = plain.translate((x[0] + corner, y[0] + corner))
    return grown(plain, corner) if corner else plain


def polygon(points: Sequence[tuple[float, float]]) -> CrossSection:
    """Return the outline through `points`, counter-clockwise."""
    return CrossSection([np.array(points, dtype=np.float64)])


def grown(outline: CrossSection, by: float) -> CrossSection:
    """Return `outline` grown by a distance, shrunk if negative; new corners are round."""
    return outline.offset(by, JoinType.Round, 2.0, sides(by)).simplify(_BLUNT)


def softened(outline: CrossSection, corner: float) -> CrossSection:
    """Return `outline` with all corners rounded; what is narrower than two `corner` is gone."""
    return grown(grown(grown(outline, -corner), 2.0 * corner), -corner)


def slab(outline: CrossSection, z: Span) -> Manifold:
    """Return `outline` raised between two heights."""
    return outline.extrude(z[1] - z[0]).translate((0.0, 0.0, z[0]))


def standing(outline: CrossSection, y: Span) -> Manifold:
    """Return an `outline` drawn in X and Z, as thick as `y`."""
    return slab(outline, (-y[1], -y[0])).rotate((90.0, 0.0, 0.0))


def sideways(outline: CrossSection, x: Span) -> Manifold:
    """Return an `outline` drawn in Y and Z, as thick as `x`."""
    return slab(outline, x).rotate((90.0, 0.0, 90.0))


def box(x: Span, y: Span, z: Span) -> Manifold:
    """Return the box between bounds."""
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
    """Return a cylinder about `axis` through `at`, a cone with `tip`, a prism with `corners`."""
    end = radius if tip is None else tip
    solid = Manifold.cylinder(along[1] - along[0], radius, end, corners or sides(radius))
    return solid.translate((0.0, 0.0, along[0])).rotate(_FROM_Z[axis]).translate(at)


def tube(inner: float, outer: float, along: Span, axis: str = "z") -> Manifold:
    """Return a hollow cylinder about `axis`."""
    return slab(circle(outer) - circle(inner), along).rotate(_FROM_Z[axis])


def wire(points: Sequence[Point], radius: float) -> Manifold:
    """Return a round wire through `points`."""
    balls = [Manifold.sphere(radius, 4).translate(point) for point in points]
    return union(Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(balls))


def union(solids: Iterable[Manifold]) -> Manifold:
    """Return all `solids` as one, which need not hang together."""
    return Manifold.batch_boolean(list(solids), OpType.Add)


def around(solid: Manifold, count: int, start_deg: float = 0.0) -> Manifold:
    """Return `count` copies of `solid`, evenly spaced about Z."""
    return union(solid.rotate((0.0, 0.0, start_deg + 360.0 * i / count)) for i in range(count))
