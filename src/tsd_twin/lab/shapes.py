"""Paths by name, and paths through given points, for the command line."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tsd_twin.errors import PathError
from tsd_twin.motion.arc import arc, line
from tsd_twin.motion.chain import polyline
from tsd_twin.motion.curve import function, parabola, spline
from tsd_twin.motion.path import Path

_RIGHT = np.array([[0.0, 0.0], [0.7, 0.5], [1.4, 0.0], [0.7, -0.5], [0.0, 0.0]])
_EIGHT = np.concatenate([_RIGHT, _RIGHT[1:] * [-1.0, 1.0]])
SHAPES: dict[str, Callable[[float], Path]] = {
    "square": lambda cut_m: polyline([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], cut_m),
    "line": lambda _: line([0.0, 0.0], [2.0, 0.0]),
    "circle": lambda _: arc([0.0, 0.0], 0.0, 0.5, 2.0 * math.pi),
    "parabola": lambda _: parabola(1.0, 0.0, 0.0, -1.0, 1.0),
    "sine": lambda _: function(lambda x: 0.3 * np.sin(2.0 * math.pi * x / 1.5), 0.0, 3.0),
    "eight": lambda _: spline(_EIGHT),
}
"""Each takes how far before its corners it leaves the legs, if it has corners."""


def shape(name: str, cut_m: float = 0.0) -> Path:
    """Return a path by its name.

    Raises:
        PathError: there is none of that name.
    """
    if name not in SHAPES:
        raise PathError(f"there is no path '{name}': {', '.join(SHAPES)}")
    return SHAPES[name](cut_m)


def through(points: Sequence[str], cut_m: float = 0.0, *, smooth: bool = False) -> Path:
    """Return the way through points written as `x,y`, metres: straight legs, or a spline.

    Raises:
        PathError: a point cannot be read, or there are too few.
    """
    numbers: list[list[float]] = []
    for point in points:
        try:
            x, y = (float(part) for part in point.split(","))
        except ValueError:
            raise PathError(f"a point is two numbers, x,y in metres, not '{point}'") from None
        numbers.append([x, y])
    return spline(numbers) if smooth else polyline(numbers, cut_m)
