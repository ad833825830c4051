"""Paths for tests: given and random ones."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from tsd_twin.lie import Array
from tsd_twin.motion.paths import (
    CompositePath,
    Path,
    arc,
    function,
    line,
    parabola,
    polyline,
    spline,
)

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])


def by_hand() -> dict[str, Path]:
    """One of each kind."""
    to_left = arc([1.0, 0.0], 0.0, 0.3, np.pi)
    end = to_left.at(np.array(to_left.length_m))
    return {
        "line": line([1.0, -2.0], [0.0, 0.5]),
        "arc": arc([0.5, 0.5], 2.0, 0.4, -5.0),
        "parabola": parabola(1.0, 0.2, 0.1, -1.0, 1.0),
        "sine": function(np.sin, 0.0, 6.0),
        "backwards": function(lambda x: 0.3 * np.cos(2.0 * x), 2.0, -2.0),
        "spline": spline([[0, 0], [1, 0.5], [1.5, -0.5], [3, 0]]),
        "closed": spline([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]]),
        "square": polyline(SQUARE),
        "rounded": polyline(SQUARE, cut_m=0.2),
        "chain": CompositePath([line([0, 0], [1, 0]), to_left, line(end.xy.tolist(), [0.0, 0.6])]),
    }


@st.composite
def waypoints(draw: st.DrawFn) -> Array:
    """Three to six points, each 0.2 m to 2 m from the last, that do not turn back sharply."""
    direction, points = draw(st.floats(-3.0, 3.0)), [np.zeros(2)]
    for _ in range(draw(st.integers(2, 5))):
        step = draw(st.floats(0.2, 2.0))
        points.append(points[-1] + step * np.array([np.cos(direction), np.sin(direction)]))
        direction += draw(st.floats(-2.0, 2.0))
    return np.array(points)
