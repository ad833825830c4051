"""Paths by arc length, against dense polygons and closed forms, without shared code."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe

from tests.motion.random_paths import SQUARE, by_hand, waypoints
from tsd_twin.errors import PathError
from tsd_twin.lie import Array, wrap
from tsd_twin.motion.paths import (
    CompositePath,
    Curve,
    Path,
    arc,
    function,
    line,
    parabola,
    polyline,
    spline,
)

PATHS = by_hand()
each = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
few = settings(max_examples=30)


def away_from_joints(path: Path, s: Array, by_m: float) -> Array:
    joints = np.array([0.0, *path.corners_m, *path.knots_m, path.length_m])
    return s[np.abs(s[:, None] - joints).min(axis=1) > by_m]


@each
def test_arc_length_is_what_a_fine_polygon_measures(path: Path) -> None:
    s = np.linspace(0.0, path.length_m, 20_001)
    steps = np.hypot(*np.diff(path.at(s).xy, axis=0).T)
    assert steps.sum() == pytest.approx(path.length_m, rel=1e-6)
    # A step around a corner is shorter; there are at most four.
    assert np.sort(steps / np.diff(s))[5] == pytest.approx(1.0, abs=1e-5)


@each
def test_directions_and_curvatures_are_slopes(path: Path) -> None:
    h = 1e-5
    s = away_from_joints(path, np.linspace(0.0, path.length_m, 501), 2 * h)
    here, before, after = (path.at(s + d) for d in (0.0, -h, h))
    tangent = (after.xy - before.xy) / (2 * h)
    np.testing.assert_allclose(
        tangent, np.stack([np.cos(here.direction), np.sin(here.direction)], -1), atol=1e-6
    )
    np.testing.assert_allclose(
        (after.direction - before.direction) / (2 * h), here.curvature, rtol=1e-4, atol=1e-5
    )
    np.testing.assert_allclose(
        (after.curvature - before.curvature) / (2 * h), here.sharpness, rtol=1e-3, atol=1e-3
    )


@each
def test_only_corners_break_the_direction_and_only_knots_the_curvature(path: Path) -> None:
    s = np.linspace(0.0, path.length_m, 20_001)
    points = path.at(s)
    jumps = s[1:][np.abs(np.diff(points.direction)) > 0.1]
    assert len(jumps) == len(path.corners_m)
    np.testing.assert_allclose(jumps, path.corners_m, atol=1e-3)
    bends = s[1:][np.abs(np.diff(points.curvature)) > 0.2]
    joints = np.array([*path.corners_m, *path.knots_m, np.inf])
    assert all(np.abs(joints - bend).min() < 1e-3 for bend in bends)


def test_lengths_in_closed_form() -> None:
    assert line([1, 1], [4, 5]).length_m == 5.0
    assert arc([0, 0], 1.0, 2.0, -1.5).length_m == 3.0
    assert parabola(1.0, 0.0, 0.0, -1.0, 1.0).length_m == pytest.approx(
        np.sqrt(5.0) + np.arcsinh(2.0) / 2.0, rel=1e-12
    )
    # One wave of the sine: an elliptic integral.
    whole = 4.0 * np.sqrt(2.0) * ellipe(0.5)
    assert function(np.sin, 0.0, 2.0 * np.pi).length_m == pytest.approx(whole, rel=1e-8)


@given(a=st.floats(-2, 2), b=st.floats(-2, 2), c=st.floats(-2, 2), x=st.floats(-2, 1.9))
@few
def test_a_parabola_is_its_equation_and_so_is_any_function(
    a: float, b: float, c: float, x: float
) -> None:
    def f(x: Array) -> Array:
        return a * x**2 + b * x + c

    for path in (parabola(a, b, c, x, 2.0), function(f, x, 2.0, samples=51)):
        s = np.linspace(0.0, path.length_m, 50)
        points = path.at(s)
        np.testing.assert_allclose(points.xy[:, 1], f(points.xy[:, 0]), atol=1e-9)
        np.testing.assert_allclose(points.xy[[0, -1], 0], [x, 2.0], atol=1e-9)
        slope = 2 * a * points.xy[:, 0] + b
        np.testing.assert_allclose(np.tan(points.direction), slope, atol=1e-6)
        np.testing.assert_allclose(points.curvature, 2 * a / (1 + slope**2) ** 1.5, atol=1e-6)


@given(start=st.tuples(*[st.floats(-3, 3)] * 3), radius=st.floats(0.1, 5), angle=st.floats(0.1, 9))
@few
def test_an_arc_keeps_its_distance_from_its_centre(
    start: tuple[float, float, float], radius: float, angle: float
) -> None:
    for sign in (1.0, -1.0):
        path = arc(start[:2], start[2], radius, sign * angle)
        to_left = np.array([-np.sin(start[2]), np.cos(start[2])])
        centre = np.array(start[:2]) + sign * radius * to_left
        points = path.at(np.linspace(0.0, path.length_m, 20))
        np.testing.assert_allclose(np.hypot(*(points.xy - centre).T), radius, rtol=1e-12)
        assert points.direction[-1] - points.direction[0] == pytest.approx(sign * angle)


@given(points=waypoints())
@few
def test_splines_and_polylines_pass_through_their_points(points: Array) -> None:
    legs = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    np.testing.assert_allclose(polyline(points).at(legs).xy, points, atol=1e-9)
    smooth = spline(points)
    dense = smooth.at(np.linspace(0.0, smooth.length_m, 20_001)).xy
    for point in points:
        assert np.hypot(*(dense - point).T).min() < 1e-3


@given(points=waypoints(), cut=st.floats(0.02, 0.5))
@few
def test_rounded_corners_are_smooth_and_as_close_as_is_said(points: Array, cut: float) -> None:
    sharp, rounded = polyline(points), polyline(points, cut)
    assert rounded.corners_m == ()
    assert rounded.length_m <= sharp.length_m + 1e-9
    s = np.linspace(0.0, rounded.length_m, 20_001)
    there = rounded.at(s)
    step = s[1]
    bends = np.abs(there.curvature).max()
    # Legs that turn by less than a millionth are one line.
    assert np.abs(np.diff(there.direction)).max() <= bends * step * 1.01 + 1e-6
    np.testing.assert_allclose(there.xy[[0, -1]], points[[0, -1]], atol=1e-9)
    legs = np.diff(points, axis=0)
    lengths = np.hypot(*legs.T)
    turns = wrap(np.diff(np.arctan2(legs[:, 1], legs[:, 0])))
    for i, turn in enumerate(turns):
        used = min(cut, 0.5 * lengths[i], 0.5 * lengths[i + 1])
        nearest = np.hypot(*(there.xy - points[i + 1]).T).min()
        # The blend is a quintic with control points at 1, 0.7 and 0.3 of the cut from the corner.
        deviation_m = used * (1.0 + 5.0 * 0.7 + 10.0 * 0.3) / 16.0 * np.sin(0.5 * abs(turn))
        assert nearest <= deviation_m + 2 * step


def test_a_closed_spline_closes_smoothly_and_turns_once() -> None:
    path = PATHS["closed"]
    ends = path.at(np.array([0.0, path.length_m]))
    np.testing.assert_allclose(ends.xy[0], ends.xy[1], atol=1e-12)
    assert ends.direction[1] - ends.direction[0] == pytest.approx(2 * np.pi, abs=1e-9)
    assert ends.curvature[0] == pytest.approx(ends.curvature[1], rel=1e-9)


def test_the_sharp_square_has_its_three_corners() -> None:
    path = polyline(SQUARE)
    assert path.corners_m == (1.0, 2.0, 3.0)
    after = path.at(np.array(path.corners_m)).direction
    np.testing.assert_allclose(after, [np.pi / 2, np.pi, 3 * np.pi / 2], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: line([1, 1], [1, 1]), "length above zero"),
        (lambda: line([1, np.nan], [1, 1]), "finite"),
        (lambda: arc([0, 0], 0.0, 0.0, 1.0), "radius"),
        (lambda: polyline([[0, 0]]), "two points"),
        (lambda: polyline([[0, 0], [0, 0], [1, 0]]), "each another"),
        (lambda: polyline([[0, 0], [1, 0]], -1.0), "polyline"),
        (lambda: spline([[0, 0], [1, 0]]), "three points"),
        (lambda: spline([[0, 0], [1, 0], [1, 0]]), "another place"),
        (lambda: function(np.sqrt, -1.0, 1.0), "finite"),
        (lambda: parabola(1, 0, 0, 1.0, 1.0), "two different ends"),
        (lambda: CompositePath([]), "a path or more"),
        (lambda: CompositePath([line([0, 0], [1, 0]), line([2, 0], [3, 0])]), "part 2 starts at"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_what_nobody_can_follow_is_refused_in_a_sentence(make: object, text: str) -> None:
    with pytest.raises(PathError, match=text):
        make()  # type: ignore[operator]


def test_a_curve_is_evaluated_in_any_shape() -> None:
    path = PATHS["spline"]
    assert isinstance(path, Curve)
    s = np.linspace(0.0, path.length_m, 12)
    flat, folded = path.at(s), path.at(s.reshape(3, 4))
    np.testing.assert_array_equal(folded.xy.reshape(12, 2), flat.xy)
    np.testing.assert_array_equal(folded.curvature.reshape(12), flat.curvature)
    assert path.at(np.array(0.5)).direction.shape == ()
