"""Group axioms, and agreement with independent matrix formulas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import viser.transforms as vtf
from hypothesis import assume, example, given
from hypothesis import strategies as st

from tests.support.matrices import expm1, se2_hat, se2_matrix, so3_hat, so3_matrix
from tsd_twin.lie import SE2, SO3, Array, sinc, wrap

DENORMAL = 1e-300
"""Below this, floating-point numbers lose digits."""

scales = st.sampled_from([1.0, 1.0, 0.1, 1e-4, 1e-7, 1e-9, 1e-12, 1e-200, 0.0])
"""Scales of angles and lengths; half are so small that a careless formula loses digits."""


@st.composite
def tangents(draw: st.DrawFn, largest: float = 3.0) -> Array:
    numbers = st.floats(-largest, largest, allow_subnormal=False)
    return np.array([draw(numbers) * draw(scales) for _ in range(3)])


@dataclass(frozen=True)
class Group:
    """A group with the matrices of its elements and tangents."""

    cls: type
    matrix: Callable[..., Array]
    hat: Callable[[Array], Array]
    parameters: str
    identity: list[float]


se2 = Group(SE2, se2_matrix, se2_hat, "xy_heading", [0.0, 0.0, 0.0])
so3 = Group(SO3, so3_matrix, so3_hat, "wxyz", [1.0, 0.0, 0.0, 0.0])
every_group = pytest.mark.parametrize("group", [se2, so3], ids=["SE2", "SO3"])


@every_group
@given(t=tangents())
def test_exp_is_the_matrix_exponential(group: Group, t: Array) -> None:
    np.testing.assert_allclose(
        group.matrix(group.cls.exp(t)), np.eye(3) + expm1(group.hat(t)), rtol=0, atol=1e-13
    )


@given(t=tangents())
@example(t=np.array([1.0, -2.0, 3e-9]))
def test_exp_of_se2_keeps_all_digits_of_small_motions(t: Array) -> None:
    """Relative to the motion, even where 1 - cos underflows."""
    motion = expm1(se2_hat(t))[:2, 2]
    length = np.hypot(t[0], t[1])
    np.testing.assert_allclose(
        SE2.exp(t).xy_heading[:2], motion, rtol=0, atol=1e-13 * length + DENORMAL
    )
    # Sideways motion alone, relative to its own size, tests the half-angle term.
    forward = np.array([1.0, 0.0, t[2]])
    sideways = SE2.exp(forward).xy_heading[1]
    assert sideways == pytest.approx(expm1(se2_hat(forward))[1, 2], rel=1e-12, abs=DENORMAL)


@every_group
@given(a=tangents(), b=tangents())
def test_composition_is_the_product_of_matrices(group: Group, a: Array, b: Array) -> None:
    left, right = group.cls.exp(a), group.cls.exp(b)
    np.testing.assert_allclose(
        group.matrix(left @ right), group.matrix(left) @ group.matrix(right), rtol=0, atol=1e-13
    )


@given(a=tangents(), b=tangents())
def test_a_pose_plus_a_tangent_is_the_product_with_its_exponential(a: Array, b: Array) -> None:
    start, moved = SE2(a), SE2(a).plus(b)
    product = se2_matrix(start) @ (np.eye(3) + expm1(se2_hat(b)))
    np.testing.assert_allclose(se2_matrix(moved), product, rtol=0, atol=1e-13)
    # Full turns are kept, and batches match their elements.
    assert moved.xy_heading[2] == a[2] + b[2]
    batch = start.plus(np.stack([b, -b])).xy_heading
    np.testing.assert_array_equal(batch, [moved.xy_heading, start.plus(-b).xy_heading])


@every_group
@given(a=tangents(), b=tangents(), c=tangents())
def test_composition_is_closed_and_associative(group: Group, a: Array, b: Array, c: Array) -> None:
    x, y, z = (group.cls.exp(t) for t in (a, b, c))
    left, right = (x @ y) @ z, x @ (y @ z)
    assert isinstance(left, group.cls)
    parameters = getattr(left, group.parameters)
    np.testing.assert_allclose(parameters, getattr(right, group.parameters), rtol=0, atol=1e-13)
    matrix = group.matrix(left)[:2, :2] if group is se2 else group.matrix(left)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(len(matrix)), rtol=0, atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-14)


@every_group
@given(t=tangents())
def test_identity_is_neutral_and_inverse_undoes(group: Group, t: Array) -> None:
    x, identity = group.cls.exp(t), group.cls.identity()
    parameters = getattr(x, group.parameters)
    for same in (x @ identity, identity @ x):
        np.testing.assert_allclose(getattr(same, group.parameters), parameters, rtol=1e-15, atol=0)
    for none in (x @ x.inverse(), x.inverse() @ x):
        np.testing.assert_allclose(
            getattr(none, group.parameters), group.identity, rtol=0, atol=1e-14
        )


@every_group
@given(t=tangents(largest=1.8))
def test_log_undoes_exp_within_half_a_turn(group: Group, t: Array) -> None:
    """Rotation vectors of at most 1.8 on each axis are shorter than pi."""
    back = group.cls.exp(t).log()
    np.testing.assert_allclose(back, t, rtol=0, atol=1e-13 * np.linalg.norm(t) + DENORMAL)


hairs = st.sampled_from([1e-3, 1e-6, 1e-9, 1e-12])
"""Margin below half a turn."""


@given(direction=tangents(), hair=hairs)
def test_log_of_a_rotation_is_right_up_to_half_a_turn(direction: Array, hair: float) -> None:
    length = np.linalg.norm(direction)
    assume(length > 1e-3)
    t = direction / length * (np.pi - hair)
    np.testing.assert_allclose(SO3.exp(t).log(), t, rtol=0, atol=1e-13)


@given(t=tangents(), hair=hairs, short_of=st.sampled_from([-np.pi, np.pi]))
def test_log_of_a_pose_is_right_around_half_a_turn(t: Array, hair: float, short_of: float) -> None:
    for t[2] in (short_of - hair, short_of, short_of + hair):
        np.testing.assert_allclose(SE2.exp(t).log(), t, rtol=0, atol=1e-13)


@given(t=tangents(largest=20.0))
def test_log_of_a_rotation_is_the_shortest_way(t: Array) -> None:
    rotation = SO3.exp(t)
    shortest = rotation.log()
    assert np.linalg.norm(shortest) <= np.pi + 1e-14
    np.testing.assert_allclose(
        so3_matrix(SO3.exp(shortest)), so3_matrix(rotation), rtol=0, atol=1e-13
    )


def test_both_quaternions_of_a_rotation_have_one_log() -> None:
    wxyz = SO3.exp(np.array([0.3, -0.2, 0.9])).wxyz
    np.testing.assert_array_equal(SO3(-wxyz).log(), SO3(wxyz).log())


@pytest.mark.parametrize("turns", [-3.3, -1.25, 1.5, 4.8])
def test_headings_count_full_turns(turns: float) -> None:
    """A robot that turned four and a bit times differs from one that turned only the bit."""
    t = np.array([0.4, -0.1, turns * 2.0 * np.pi])
    pose = SE2.exp(t)
    assert pose.xy_heading[2] == t[2]
    np.testing.assert_allclose((pose @ pose).xy_heading[2], 2.0 * t[2], rtol=1e-15)


@given(t=tangents(), point=tangents())
def test_points_and_vectors_are_mapped_as_by_the_matrix(t: Array, point: Array) -> None:
    pose, rotation = SE2.exp(t), SO3.exp(t)
    homogeneous = np.array([point[0], point[1], 1.0])
    close = {"rtol": 0, "atol": 1e-13}
    np.testing.assert_allclose(
        pose.transform(point[:2]), (se2_matrix(pose) @ homogeneous)[:2], **close
    )
    np.testing.assert_allclose(
        pose.rotate(point[:2]), se2_matrix(pose)[:2, :2] @ point[:2], **close
    )
    np.testing.assert_allclose(rotation.rotate(point), so3_matrix(rotation) @ point, **close)
    np.testing.assert_allclose(rotation.as_matrix(), so3_matrix(rotation), **close)


@given(a=tangents(), b=tangents())
def test_viser_agrees(a: Array, b: Array) -> None:
    """Except for turns of 1e-10 to 1e-8, where its SE2.exp loses the half-angle term."""
    assume(all(abs(t[2]) == 0.0 or abs(t[2]) > 1e-6 for t in (a, b)))
    pose = vtf.SE2.exp(a) @ vtf.SE2.exp(b).inverse()
    ours = SE2.exp(a) @ SE2.exp(b).inverse()
    np.testing.assert_allclose(se2_matrix(ours), pose.as_matrix(), rtol=0, atol=1e-9)
    rotation = vtf.SO3.exp(a) @ vtf.SO3.exp(b).inverse()
    ours = SO3.exp(a) @ SO3.exp(b).inverse()
    np.testing.assert_allclose(ours.as_matrix(), rotation.as_matrix(), rtol=0, atol=1e-9)


@every_group
def test_a_batch_is_its_members(group: Group) -> None:
    random = np.random.default_rng(0)
    a, b = random.normal(size=(4, 1, 3)), random.normal(size=(5, 3))
    composed = group.cls.exp(a) @ group.cls.exp(b).inverse()
    logs = composed.log()
    assert logs.shape == (4, 5, 3)
    for i in range(4):
        for j in range(5):
            one = group.cls.exp(a[i, 0]) @ group.cls.exp(b[j]).inverse()
            np.testing.assert_allclose(logs[i, j], one.log(), rtol=1e-14, atol=1e-15)
    assert getattr(group.cls.identity((2, 3)), group.parameters).shape[:2] == (2, 3)


@given(st.floats(-1e6, 1e6))
@example(np.nextafter(-np.pi, -np.inf))
@example(np.pi)
@example(-np.pi)
@example(np.nextafter(3.0 * np.pi, 0.0))
def test_wrapping_lands_in_range_and_turns_by_whole_turns(angle: float) -> None:
    wrapped = float(wrap(np.array(angle)))
    assert -np.pi < wrapped <= np.pi
    if -np.pi < angle <= np.pi:
        assert wrapped == angle
    turns = (angle - wrapped) / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


@given(st.floats(-50.0, 50.0), scales)
def test_sinc_is_sine_over_its_argument(x: float, scale: float) -> None:
    x *= scale
    value = float(sinc(np.array(x)))
    assert value * x == pytest.approx(np.sin(x), rel=1e-15, abs=DENORMAL)
    if abs(x) < 1e-8:
        assert value == 1.0


@given(pose=tangents(30.0), other=tangents(30.0))
def test_one_planar_pose_is_the_member_of_a_batch_to_the_bit(pose: Array, other: Array) -> None:
    one, many = SE2(pose), SE2(np.stack([pose, pose]))
    others = np.stack([other, other])
    for single, batch in (
        (SE2.exp(other), SE2.exp(others)),
        (one.plus(other), many.plus(others)),
        (one @ SE2(other), many @ SE2(others)),
    ):
        np.testing.assert_array_equal(single.xy_heading, batch.xy_heading[0])


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan, 1e308])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning", "ignore:overflow")
def test_a_heading_that_is_no_number_is_no_exception(bad: float) -> None:
    turned, here = np.array([1.0, 2.0, bad]), np.array([0.5, 0.0, np.copysign(1e308, bad)])
    many = np.stack([turned, turned]), np.stack([here, here])
    for single, batch in (
        (SE2.exp(turned), SE2.exp(many[0])),
        (SE2(here).plus(turned), SE2(many[1]).plus(many[0])),
        (SE2(turned) @ SE2(here), SE2(many[0]) @ SE2(many[1])),
    ):
        np.testing.assert_array_equal(single.xy_heading, batch.xy_heading[0])
