"""Smooth curves given by a parameter, measured by arc length: splines, parabolas, any f(x)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, CubicSpline, make_interp_spline  # pyright: ignore

from tsd_twin.errors import PathError
from tsd_twin.lie import Array, wrap
from tsd_twin.motion.path import PathPoints

_PARTS = 8
"""Pieces that the span between two knots is cut into for the table of arc lengths."""
_UNIT = np.array([0.0, 1.0])
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_STEEP = 0.7
"""Shape of a blend: a compromise of the tightest bend and of how fast the bend may change."""
_FLAT = 0.3


class Curve:
    """A plane curve xy(u), twice continuously differentiable, by arc length.

    `polynomials` is a spline of scipy's with two values, from the first to the last of `breaks`;
    its parameter needs no meaning. Not `smooth`: the slope of the curvature jumps at the breaks.

    Raises:
        PathError: the curve stands still somewhere, so it has no direction there.
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
        """Return the arc lengths between parameters, by Gauss and Legendre on eight nodes."""
        half = 0.5 * (end - start)
        u = (start + half)[..., None] + half[..., None] * _NODES
        first = self._derivative(1, u)
        return half * (np.hypot(first[..., 0], first[..., 1]) @ _WEIGHTS)

    def _parameter(self, s: Array) -> tuple[Array, Any]:
        """Return the parameters at arc lengths, and their rows in the table, by Newton's rule."""
        s = np.clip(s, 0.0, self._s[-1])
        row = np.clip(np.searchsorted(self._s, s, side="right") - 1, 0, len(self._s) - 2)
        start, end = self._u[row], self._u[row + 1]
        u = start + (end - start) * (s - self._s[row]) / (self._s[row + 1] - self._s[row])
        for _ in range(4):
            first = self._derivative(1, u)
            error = self._s[row] + self._lengths(start, u) - s
            u = np.clip(u - error / np.hypot(first[..., 0], first[..., 1]), start, end)
        return u, row


def spline(points_m: Array | Sequence[Sequence[float]]) -> Curve:
    """Return the cubic spline through `points_m` (n, 2), n above 2, metres; closed if they are."""
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
    return Curve(CubicSpline(knots, points, bc_type=ends), knots, smooth=False)


def function(
    f: Callable[[Array], Array], start_x_m: float, end_x_m: float, samples: int = 401
) -> Curve:
    """Return y = f(x) from one x to the other, by a quintic spline through `samples` of it.

    `f` takes and returns arrays (n,), metres. With steps h, the curvature is off by some h^4.
    """
    t = np.linspace(0.0, 1.0, samples)
    x = start_x_m + (end_x_m - start_x_m) * t
    y = np.broadcast_to(np.asarray(f(x), dtype=float), x.shape)
    if not np.isfinite(y).all() or start_x_m == end_x_m:
        raise PathError(f"f(x) must be finite from {start_x_m} to {end_x_m}, two different places")
    # scipy has no types for it.
    smooth: Any = make_interp_spline(t, np.stack([x, y], axis=-1), k=5)  # pyright: ignore
    return Curve(smooth, t)


def parabola(a_per_m: float, b: float, c_m: float, start_x_m: float, end_x_m: float) -> Curve:
    """Return y = a x^2 + b x + c from one x to the other."""
    x = np.array([start_x_m, 0.5 * (start_x_m + end_x_m), end_x_m])
    # The middle control point of a Bezier curve, so that it passes through the middle.
    points = np.stack([x, (a_per_m * x + b) * x + c_m], axis=-1)
    points[1] = 2.0 * points[1] - 0.5 * (points[0] + points[2])
    if start_x_m == end_x_m or not np.isfinite(points).all():
        raise PathError("a parabola needs finite numbers and two different ends")
    return Curve(_bezier(points), _UNIT)


def blend(start_m: Array, corner_m: Array, end_m: Array) -> Curve:
    """Return the way around a corner: a quintic Bezier curve, straight at its ends."""
    near, far = 1.0 - _STEEP, 1.0 - _FLAT
    into, out = corner_m - start_m, end_m - corner_m
    points = [start_m, start_m + near * into, start_m + far * into]
    points += [end_m - far * out, end_m - near * out, end_m]
    return Curve(_bezier(np.stack(points)), _UNIT)


def _bezier(points: Array) -> Any:
    return BPoly(points[:, None, :], _UNIT)


def deviation_m(cut_m: float, turn_rad: float) -> float:
    """Return how far a blend that leaves the legs `cut_m` before a corner passes from it."""
    middle = (1.0 + 5.0 * _STEEP + 10.0 * _FLAT) / 16.0
    return cut_m * middle * math.sin(0.5 * abs(turn_rad))
