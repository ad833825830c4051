"""Properties of every drive kind with any geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.random_kinematics import (
    any_drives,
    directions,
    omni_drives,
    shares,
    sphere_drives,
)
from tsd_twin import robots
from tsd_twin.kinematics import Kinematics, OmniKinematics, SphereKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import DESCRIPTIONS, ExternalDescription

calm = settings(max_examples=60)


def within_limit(kinematics: Kinematics[Any], direction: Array, share: float) -> Array:
    return direction * (share / kinematics.joint_utilization(direction))


@calm
@given(kinematics=any_drives(), direction=directions(), share=shares)
def test_forward_undoes_inverse(
    kinematics: Kinematics[Any], direction: Array, share: float
) -> None:
    twist = within_limit(kinematics, direction, share)
    motion = kinematics.forward(kinematics.inverse(twist))
    size = np.abs(twist).max() + np.abs(within_limit(kinematics, direction, 1e-12)).max() * share
    np.testing.assert_allclose(motion.twist, twist, rtol=0, atol=1e-10 * size)
    assert np.abs(motion.residual).max(initial=0.0) <= 1e-10 * size * max(
        1.0, kinematics.twist_scale_m
    )


@calm
@given(kinematics=any_drives(), direction=directions(), excess=st.floats(1.001, 1e6))
def test_too_much_is_scaled_as_a_whole(
    kinematics: Kinematics[Any], direction: Array, excess: float
) -> None:
    most = within_limit(kinematics, direction, 1.0)
    np.testing.assert_allclose(
        kinematics.inverse(excess * most), kinematics.inverse(most), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        kinematics.forward(kinematics.inverse(excess * most)).twist,
        most,
        rtol=0,
        atol=1e-9 * np.abs(most).max(),
    )


@calm
@given(
    kinematics=any_drives(), direction=directions(), factor=st.floats(1e-9, 100.0) | st.just(0.0)
)
def test_demand_grows_with_the_twist(
    kinematics: Kinematics[Any], direction: Array, factor: float
) -> None:
    once = kinematics.joint_utilization(direction)
    assert kinematics.joint_utilization(factor * direction) == pytest.approx(
        factor * once, rel=1e-9, abs=1e-300
    )
    assert kinematics.joint_utilization(-direction) == pytest.approx(once, rel=1e-12)
    step = kinematics.rate_utilization(direction, 0.01)
    assert kinematics.rate_utilization(factor * direction, 0.01) == pytest.approx(
        factor * step, rel=1e-9
    )
    assert kinematics.rate_utilization(direction, 0.02) == pytest.approx(0.5 * step, rel=1e-9)


@calm
@given(kinematics=any_drives())
def test_what_shall_stand_stands(kinematics: Kinematics[Any]) -> None:
    motion = kinematics.forward(kinematics.inverse(np.zeros(3)))
    np.testing.assert_array_equal(motion.twist, 0.0)
    np.testing.assert_array_equal(motion.residual, 0.0)
    assert kinematics.joint_utilization(np.zeros(3)) == 0.0


@calm
@given(kinematics=any_drives(), seed=st.integers(0, 2**16))
def test_a_batch_is_its_members(kinematics: Kinematics[Any], seed: int) -> None:
    twists = np.random.default_rng(seed).normal(size=(2, 3, 3))
    joints = kinematics.inverse(twists)
    assert joints.shape == (2, 3, len(kinematics.joints))
    motion = kinematics.forward(joints)
    moved = kinematics.integrate(kinematics.pose_type.identity((2, 3)), twists, 0.1)
    close = {"rtol": 1e-9, "atol": 1e-12}
    for at in np.ndindex(2, 3):
        np.testing.assert_allclose(joints[at], kinematics.inverse(twists[at]), **close)
        alone = kinematics.forward(joints[at])
        np.testing.assert_allclose(motion.twist[at], alone.twist, **close)
        np.testing.assert_allclose(motion.residual[at], alone.residual, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            kinematics.joint_utilization(twists)[at],
            kinematics.joint_utilization(twists[at]),
            **close,
        )
        one = kinematics.integrate(kinematics.pose_type.identity(), twists[at], 0.1)
        np.testing.assert_allclose(moved.log()[at], one.log(), **close)


@calm
@given(kinematics=any_drives(), direction=directions(), share=shares)
def test_moving_in_two_halves_is_moving_once(
    kinematics: Kinematics[Any], direction: Array, share: float
) -> None:
    twist = within_limit(kinematics, direction, share)
    start = kinematics.pose_type.identity()
    once = kinematics.integrate(start, twist, 0.01)
    twice = kinematics.integrate(kinematics.integrate(start, twist, 0.004), twist, 0.006)
    np.testing.assert_allclose(twice.log(), once.log(), rtol=1e-9, atol=1e-13)


@calm
@given(kinematics=st.one_of(omni_drives(), sphere_drives()), seed=st.integers(0, 2**16))
def test_blame_is_what_leaving_a_wheel_out_takes_off_the_residual(
    kinematics: OmniKinematics | SphereKinematics, seed: int
) -> None:
    """Inconsistent wheels, against least squares without each of them."""
    joints = np.random.default_rng(seed).normal(size=len(kinematics.joints))
    residual = kinematics.forward(joints).residual
    rows = kinematics.wheel_radius_m * kinematics.speeds_from_twist
    values = kinematics.wheel_radius_m * joints
    for i, fault_contribution in enumerate(kinematics.fault_contribution(residual)):
        rest = [j for j in range(kinematics.wheels) if j != i]
        if np.linalg.matrix_rank(rows[rest], tol=1e-3 * np.abs(rows).max()) < 3:
            continue  # Without it no residual is left, which is ambiguous.
        left = values[rest] - rows[rest] @ np.linalg.lstsq(rows[rest], values[rest], rcond=None)[0]
        taken = residual @ residual - left @ left
        assert fault_contribution == pytest.approx(taken, rel=1e-5, abs=1e-9 * (values @ values))


def test_every_kind_has_a_robot_and_every_robot_a_kind() -> None:
    shipped = {type(robots.load_robot(name)) for name in robots.robot_names()}
    assert shipped == set(DESCRIPTIONS.values()) - {ExternalDescription}
