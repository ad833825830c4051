"""Solids: orientation of the parts, and roundness of circles."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.models.solids import (
    around,
    box,
    circle,
    polygon,
    rod,
    sides,
    sideways,
    softened,
    standing,
)


@given(radius=st.floats(1.0, 500.0))
def test_circles_are_true_to_a_fifth_of_a_millimetre(radius: float) -> None:
    assert radius * (1.0 - math.cos(math.pi / sides(radius))) < 0.25
    assert math.pi * radius**2 - circle(radius).area() < 0.6 * 2.0 * math.pi * radius


@pytest.mark.parametrize(("axis", "index"), [("x", 0), ("y", 1), ("z", 2)])
def test_rods_run_along_their_axis_from_low_to_high(axis: str, index: int) -> None:
    at = [10.0, 20.0, 30.0]
    bounds = rod(1.0, (-2.0, 5.0), axis, (10.0, 20.0, 30.0), tip=0.5).bounding_box()
    assert bounds[index] == pytest.approx(at[index] - 2.0)
    assert bounds[index + 3] == pytest.approx(at[index] + 5.0)
    across = (index + 1) % 3
    assert bounds[across + 3] - bounds[across] == pytest.approx(2.0, rel=0.1)


def test_the_tip_of_a_rod_is_at_its_high_end() -> None:
    for axis, index in (("x", 0), ("y", 1), ("z", 2)):
        offset, normal = 4.0, [0.0, 0.0, 0.0]
        normal[index] = 1.0
        end = rod(1.0, (0.0, 5.0), axis, tip=0.1).trim_by_plane(normal, offset).bounding_box()
        assert end[(index + 1) % 3 + 3] < 0.4


def test_outlines_stand_up_the_right_way() -> None:
    """An outline with its mass at one corner, so that no mirror image passes."""
    corner = polygon([(1.0, 2.0), (3.0, 2.0), (1.0, 6.0)])
    upright = standing(corner, (10.0, 11.0))
    assert upright.bounding_box() == pytest.approx((1.0, 10.0, 2.0, 3.0, 11.0, 6.0))
    assert upright.trim_by_plane((1.0, 0.0, 0.0), 2.0).bounding_box()[5] == pytest.approx(4.0)
    turned = sideways(corner, (10.0, 11.0))
    assert turned.bounding_box() == pytest.approx((10.0, 1.0, 2.0, 11.0, 3.0, 6.0))
    assert turned.trim_by_plane((0.0, 1.0, 0.0), 2.0).bounding_box()[5] == pytest.approx(4.0)


def test_copies_go_around_counter_clockwise() -> None:
    three = around(box((1.0, 2.0), (-0.1, 0.1), (0.0, 1.0)), 3, 90.0).decompose()
    centres = [piece.to_mesh().vert_properties.mean(axis=0) for piece in three]
    angles = sorted(math.degrees(math.atan2(y, x)) % 360.0 for x, y, _ in centres)
    assert angles == pytest.approx([90.0, 210.0, 330.0], abs=1e-3)


def test_softening_removes_what_is_narrow_and_keeps_what_is_wide() -> None:
    wide = polygon([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)])
    spike = polygon([(99.0, 49.0), (150.0, 49.0), (150.0, 51.0), (99.0, 51.0)])
    soft = softened(wide + spike, 10.0)
    assert soft.bounds() == pytest.approx((0.0, 0.0, 100.0, 100.0), abs=0.2)
    rounding = (4.0 - math.pi) * 10.0**2
    assert soft.area() == pytest.approx(1e4 - rounding, rel=2e-3)
