"""Planar paths by arc length: lines, arcs, splines, functions, polylines and compositions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from tsd_twin.errors import PathError, needs_extra
from tsd_twin.lie import Array, sinc, wrap


@dataclass(frozen=True, slots=True, eq=False)
class PathPoints:
    """Points of a path with direction and curvature; shaped like the arc lengths."""

    xy: Array
    """(..., 2): metres."""
    direction: Array
    """(...): tangent angle, radians; continuous along the path except at corners."""
    curvature: Array
    """(...): d direction / ds, 1/m; left is positive."""
    sharpness: Array
    """(...): d curvature / ds, 1/m^2."""


class Path(Protocol):
    """Planar curve, parameterized by arc length from 0 to `length_m`."""

    @property
    def length_m(self) -> float:
        """Arc length."""
        ...

    @property
    def corners_m(self) -> tuple[float, ...]:
        """Arc lengths of corners, where the direction jumps and the robot must stop."""
        ...

    @property
    def knots_m(self) -> tuple[float, ...]:
        """Arc lengths where the curvature or its derivative jumps, but not the direction."""
        ...

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...); at a corner, the side that follows."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """Circular arc, or a line if the curvature is zero."""

    start_m: tuple[float, float]
    direction_rad: float
    """Direction of the tangent at the start."""
    curvature_per_m: float
    """Left is positive."""
    length_m: float
    corners_m: tuple[float, ...] = ()
    knots_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        numbers = (*self.start_m, self.direction_rad, self.curvature_per_m, self.length_m)
        if not (all(math.isfinite(number) for number in numbers) and self.length_m > 0.0):
            raise PathError(f"a line or arc needs finite numbers and a length above zero: {self}")

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...)."""
        s = np.asarray(s_m, dtype=float)
        half = 0.5 * self.curvature_per_m * s
        # The chord of an arc is rotated by half its angle and shortened by sinc.
        chord, along = s * sinc(half), self.direction_rad + half
        xy = np.stack([chord * np.cos(along), chord * np.sin(along)], axis=-1)
        return PathPoints(
            xy + np.array(self.start_m),
            self.direction_rad + 2.0 * half,
            np.full(s.shape, self.curvature_per_m),
            np.zeros(s.shape),
        )


def line(start_m: Sequence[float], end_m: Sequence[float]) -> Arc:
    """Return the straight line between two points, metres."""
    dx, dy = end_m[0] - start_m[0], end_m[1] - start_m[1]
    return Arc((start_m[0], start_m[1]), math.atan2(dy, dx), 0.0, math.hypot(dx, dy))


def arc(start_m: Sequence[float], direction_rad: float, radius_m: float, angle_rad: float) -> Arc:
    """Return an arc that turns by `angle_rad` (left positive) at a positive `radius_m`."""
    if not radius_m > 0.0:
        raise PathError(f"the radius of an arc must be above zero, not {radius_m}")
    curvature = math.copysign(1.0 / radius_m, angle_rad)
    return Arc((start_m[0], start_m[1]), direction_rad, curvature, radius_m * abs(angle_rad))


_PARTS = 8
"""Intervals between two knots in the arc-length table."""
_UNIT = np.array([0.0, 1.0])
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_BLEND_END = 0.7
"""Shape of a blend: a compromise between maximum curvature and its rate of change."""
_BLEND_MIDDLE = 0.3


class Curve:
    """Twice continuously differentiable planar curve xy(u), by arc length.

    `polynomials` is a two-valued scipy spline from the first to the last of `breaks`, in any
    parameter. If not `smooth`, the derivative of the curvature jumps at the breaks.

    Raises:
        PathError: If the curve has zero speed somewhere, so its direction is undefined.
    """

    corners_m: tuple[float, ...] = ()

    def __init__(self, polynomials: Any, breaks: Array, *, smooth: bool = True) -> None:
        self._by_order = [polynomials] + [polynomials.derivative(n) for n in (1, 2, 3)]
        cuts: list[Array] = [
            np.linspace(a, b, _PARTS + 1)[:-1] for a, b in itertools.pairwise(breaks)
        ]
        self._u: Array = np.concatenate([*cuts, breaks[-1:]])
        velocity = self._derivative(1, self._u)
        if not np.isfinite(velocity).all() or np.hypot(*velocity.T).min() <= 0.0:
            raise PathError("a path must not stand still: are two of its points the same?")
        self._s = np.concatenate([[0.0], np.cumsum(self._lengths(self._u[:-1], self._u[1:]))])
        self.knots_m: tuple[float, ...] = ()
        if not smooth:
            self.knots_m = tuple(self._s[_PARTS:-1:_PARTS].tolist())
        self._direction = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))

    @property
    def length_m(self) -> float:
        """Arc length."""
        return float(self._s[-1])

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...)."""
        u, row = self._parameter(np.asarray(s_m, dtype=float))
        xy, first, second, third = (self._derivative(n, u) for n in range(4))
        (dx, dy), (ddx, ddy) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
        squared = dx * dx + dy * dy
        speed = np.sqrt(squared)
        bend = dx * ddy - dy * ddx
        bend_rate = dx * third[..., 1] - dy * third[..., 0]
        curvature = bend / (squared * speed)
        slowing = 3.0 * bend * (dx * ddx + dy * ddy) / squared
        near = self._direction[row]
        return PathPoints(
            xy,
            near + wrap(np.arctan2(dy, dx) - near),
            curvature,
            (bend_rate - slowing) / (squared * squared),
        )

    def _derivative(self, order: int, u: Array) -> Array:
        return np.asarray(self._by_order[order](u), dtype=float)

    def _lengths(self, start: Array, end: Array) -> Array:
        """Return the arc lengths between parameters, by eight-node Gauss-Legendre quadrature."""
        half = 0.5 * (end - start)
        u = (start + half)[..., None] + half[..., None] * _NODES
        first = self._derivative(1, u)
        return half * (np.hypot(first[..., 0], first[..., 1]) @ _WEIGHTS)

    def _parameter(self, s: Array) -> tuple[Array, Any]:
        """Return parameters at arc lengths, and their rows in the table, by Newton's method."""
        s = np.clip(s, 0.0, self._s[-1])
        row = np.clip(np.searchsorted(self._s, s, side="right") - 1, 0, len(self._s) - 2)
        start, end = self._u[row], self._u[row + 1]
        u = start + (end - start) * (s - self._s[row]) / (self._s[row + 1] - self._s[row])
        for _ in range(4):
            first = self._derivative(1, u)
            error = self._s[row] + self._lengths(start, u) - s
            u = np.clip(u - error / np.hypot(first[..., 0], first[..., 1]), start, end)
        return u, row


def scipy_splines() -> Any:
    """Import `scipy.interpolate`: it takes a quarter of a second, and only bends need it.

    Raises:
        MissingExtraError: If the extra `paths` is not installed.
    """
    with needs_extra("A curved path", "paths"):
        return import_module("scipy.interpolate")


def spline(points_m: Array | Sequence[Sequence[float]]) -> Curve:
    """Return a cubic spline through `points_m` (n, 2), n > 2, metres; periodic if closed."""
    points = np.asarray(points_m, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise PathError(f"a spline needs three points (x, y) or more, not {points.shape}")
    chords = np.hypot(*np.diff(points, axis=0).T)
    if not np.isfinite(points).all() or chords.min() <= 0.0:
        raise PathError(
            "the points of a spline must be finite, each at another place than the last"
        )
    closed = bool(np.allclose(points[0], points[-1], rtol=0.0, atol=1e-9))
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    ends = "periodic" if closed else "natural"
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    return Curve(scipy_splines().CubicSpline(knots, points, bc_type=ends), knots, smooth=False)


def function(
    f: Callable[[Array], Array], start_x_m: float, end_x_m: float, samples: int = 401
) -> Curve:
    """Return y = f(x) between two x, by a quintic spline through `samples` points.

    `f` maps arrays (n,) to arrays (n,), metres. The curvature error is O(h^4) for a step h.
    """
    t = np.linspace(0.0, 1.0, samples)
    x = start_x_m + (end_x_m - start_x_m) * t
    y = np.broadcast_to(np.asarray(f(x), dtype=float), x.shape)
    if not np.isfinite(y).all() or start_x_m == end_x_m:
        raise PathError(f"f(x) must be finite from {start_x_m} to {end_x_m}, two different places")
    return Curve(scipy_splines().make_interp_spline(t, np.stack([x, y], axis=-1), k=5), t)


def parabola(a_per_m: float, b: float, c_m: float, start_x_m: float, end_x_m: float) -> Curve:
    """Return y = a x^2 + b x + c between two x."""
    x = np.array([start_x_m, 0.5 * (start_x_m + end_x_m), end_x_m])
    # Place the middle control point so that the Bezier curve passes through the middle.
    points = np.stack([x, (a_per_m * x + b) * x + c_m], axis=-1)
    points[1] = 2.0 * points[1] - 0.5 * (points[0] + points[2])
    if start_x_m == end_x_m or not np.isfinite(points).all():
        raise PathError("a parabola needs finite numbers and two different ends")
    return Curve(_bezier(points), _UNIT)


def blend(start_m: Array, corner_m: Array, end_m: Array) -> Curve:
    """Round a corner by a quintic Bezier curve with zero curvature at its ends."""
    near, far = 1.0 - _BLEND_END, 1.0 - _BLEND_MIDDLE
    into, out = corner_m - start_m, end_m - corner_m
    points = [start_m, start_m + near * into, start_m + far * into]
    points += [end_m - far * out, end_m - near * out, end_m]
    return Curve(_bezier(np.stack(points)), _UNIT)


def _bezier(points: Array) -> Any:
    return scipy_splines().BPoly(points[:, None, :], _UNIT)


_GAP_M = 1e-6
_CORNER_RAD = 1e-6


class CompositePath:
    """Sequence of paths, each starting at the end of the previous one.

    Raises:
        PathError: If there is a gap or the sequence is empty.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        if not paths:
            raise PathError("a chain needs a path or more")
        self._paths = tuple(paths)
        self._starts = np.concatenate([[0.0], np.cumsum([path.length_m for path in paths])])
        turns = [0.0]
        corners, knots = list(paths[0].corners_m), list(paths[0].knots_m)
        for i, (before, after) in enumerate(itertools.pairwise(paths)):
            end, start = before.at(np.array(before.length_m)), after.at(np.array(0.0))
            if np.abs(end.xy - start.xy).max() > _GAP_M:
                raise PathError(f"part {i + 2} starts at {start.xy}, part {i + 1} ends at {end.xy}")
            step = float(wrap(start.direction - end.direction))
            # Unwrap directions, so that full turns can be counted.
            turns.append(turns[-1] + float(end.direction - start.direction) + step)
            at = float(self._starts[i + 1])
            if abs(step) > _CORNER_RAD:
                corners.append(at)
            else:
                knots.append(at)
            corners += [at + corner for corner in after.corners_m]
            knots += [at + knot for knot in after.knots_m]
        self._turns = tuple(turns)
        self.corners_m: tuple[float, ...] = tuple(corners)
        self.knots_m: tuple[float, ...] = tuple(knots)

    @property
    def length_m(self) -> float:
        """Arc length."""
        return float(self._starts[-1])

    def at(self, s_m: Array) -> PathPoints:
        """Return the points at arc lengths `s_m` (...); at a joint, the side that follows."""
        s = np.asarray(s_m, dtype=float)
        part = np.clip(np.searchsorted(self._starts, s, side="right") - 1, 0, len(self._paths) - 1)
        out = PathPoints(np.empty((*s.shape, 2)), *(np.empty(s.shape) for _ in range(3)))
        for i in np.unique(part):
            here = part == i
            points = self._paths[int(i)].at(s[here] - self._starts[i])
            out.xy[here] = points.xy
            out.direction[here] = points.direction + self._turns[i]
            out.curvature[here] = points.curvature
            out.sharpness[here] = points.sharpness
        return out


def polyline(points_m: Array | Sequence[Sequence[float]], cut_m: float = 0.0) -> CompositePath:
    """Return straight legs through `points_m` (n, 2), n > 1, metres.

    Corners are sharp, so the robot stops there. With `cut_m`, each corner is replaced by a smooth
    curve that starts that far before it, at most half a leg.
    """
    points = np.asarray(points_m, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not cut_m >= 0.0:
        raise PathError(f"a polyline needs two points (x, y) or more, not {points.shape}")
    legs = np.diff(points, axis=0)
    lengths = np.hypot(*legs.T)
    if not np.isfinite(points).all() or lengths.min() <= 0.0:
        raise PathError("the points of a polyline must be finite, each another than the last")
    along = legs / lengths[:, None]
    reach = np.minimum(cut_m, 0.5 * np.minimum(lengths[:-1], lengths[1:]))
    straight = np.abs(wrap(np.diff(np.arctan2(along[:, 1], along[:, 0])))) < _CORNER_RAD
    reach = np.where(straight, 0.0, reach)
    paths: list[Path] = []
    here = points[0]
    for i in range(len(legs)):
        cut = reach[i] if i < len(reach) else 0.0
        end = points[i + 1] - cut * along[i]
        if np.hypot(*(end - here)) > _GAP_M:
            paths.append(line(here.tolist(), end.tolist()))
        here = end
        if cut > 0.0:
            here = points[i + 1] + cut * along[i + 1]
            paths.append(blend(end, points[i + 1], here))
    return CompositePath(paths)
