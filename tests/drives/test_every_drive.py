"""What holds for every kind of drive, whatever its geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.drives.generated import directions, shares
from tests.drives.kinds import any_drives, omni_drives, sphere_drives
from tsd_twin import robots
from tsd_twin.drives import Drive, OmniDrive, SphereDrive
from tsd_twin.lie import Array
from tsd_twin.robots import KINDS

calm = settings(deadline=None, max_examples=60)


def within_limit(drive: Drive[Any], direction: Array, share: float) -> Array:
    return direction * (share / drive.demand(direction))


@calm
@given(drive=any_drives(), direction=directions(), share=shares)
def test_forward_undoes_inverse(drive: Drive[Any], direction: Array, share: float) -> None:
    twist = within_limit(drive, direction, share)
    motion = drive.forward(drive.inverse(twist))
    size = np.abs(twist).max() + np.abs(within_limit(drive, direction, 1e-12)).max() * share
    np.testing.assert_allclose(motion.twist, twist, rtol=0, atol=1e-10 * size)
    assert np.abs(motion.residual).max(initial=0.0) <= 1e-10 * size * max(1.0, drive.lever_m)


@calm
@given(drive=any_drives(), direction=directions(), excess=st.floats(1.001, 1e6))
def test_too_much_is_scaled_as_a_whole(drive: Drive[Any], direction: Array, excess: float) -> None:
    most = within_limit(drive, direction, 1.0)
    np.testing.assert_allclose(
        drive.inverse(excess * most), drive.inverse(most), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        drive.forward(drive.inverse(excess * most)).twist,
        most,
        rtol=0,
        atol=1e-9 * np.abs(most).max(),
    )


@calm
@given(drive=any_drives(), direction=directions(), factor=st.floats(1e-9, 100.0) | st.just(0.0))
def test_demand_grows_with_the_twist(drive: Drive[Any], direction: Array, factor: float) -> None:
    once = drive.demand(direction)
    assert drive.demand(factor * direction) == pytest.approx(factor * once, rel=1e-9, abs=1e-300)
    assert drive.demand(-direction) == pytest.approx(once, rel=1e-12)
    step = drive.rate_demand(direction, 0.01)
    assert drive.rate_demand(factor * direction, 0.01) == pytest.approx(factor * step, rel=1e-9)
    assert drive.rate_demand(direction, 0.02) == pytest.approx(0.5 * step, rel=1e-9)


@calm
@given(drive=any_drives())
def test_what_shall_stand_stands(drive: Drive[Any]) -> None:
    motion = drive.forward(drive.inverse(np.zeros(3)))
    np.testing.assert_array_equal(motion.twist, 0.0)
    np.testing.assert_array_equal(motion.residual, 0.0)
    assert drive.demand(np.zeros(3)) == 0.0


@calm
@given(drive=any_drives(), seed=st.integers(0, 2**16))
def test_a_batch_is_its_members(drive: Drive[Any], seed: int) -> None:
    twists = np.random.default_rng(seed).normal(size=(2, 3, 3))
    joints = drive.inverse(twists)
    assert joints.shape == (2, 3, len(drive.joints))
    motion = drive.forward(joints)
    moved = drive.move(drive.space.identity((2, 3)), twists, 0.1)
    close = {"rtol": 1e-9, "atol": 1e-12}
    for at in np.ndindex(2, 3):
        np.testing.assert_allclose(joints[at], drive.inverse(twists[at]), **close)
        alone = drive.forward(joints[at])
        np.testing.assert_allclose(motion.twist[at], alone.twist, **close)
        np.testing.assert_allclose(motion.residual[at], alone.residual, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(drive.demand(twists)[at], drive.demand(twists[at]), **close)
        one = drive.move(drive.space.identity(), twists[at], 0.1)
        np.testing.assert_allclose(moved.log()[at], one.log(), **close)


@calm
@given(drive=any_drives(), direction=directions(), share=shares)
def test_moving_in_two_halves_is_moving_once(
    drive: Drive[Any], direction: Array, share: float
) -> None:
    twist = within_limit(drive, direction, share)
    start = drive.space.identity()
    once = drive.move(start, twist, 0.01)
    twice = drive.move(drive.move(start, twist, 0.004), twist, 0.006)
    np.testing.assert_allclose(twice.log(), once.log(), rtol=1e-9, atol=1e-13)


@calm
@given(drive=st.one_of(omni_drives(), sphere_drives()), seed=st.integers(0, 2**16))
def test_blame_is_what_leaving_a_wheel_out_takes_off_the_residual(
    drive: OmniDrive | SphereDrive, seed: int
) -> None:
    """Wheels that disagree, against least squares without each of them."""
    joints = np.random.default_rng(seed).normal(size=len(drive.joints))
    residual = drive.forward(joints).residual
    rows = drive.wheel_radius_m * drive.speeds_from_twist
    values = drive.wheel_radius_m * joints
    for i, blame in enumerate(drive.blame(residual)):
        rest = [j for j in range(drive.wheels) if j != i]
        if np.linalg.matrix_rank(rows[rest], tol=1e-3 * np.abs(rows).max()) < 3:
            continue  # Without it nothing is left over: nobody can tell.
        left = values[rest] - rows[rest] @ np.linalg.lstsq(rows[rest], values[rest], rcond=None)[0]
        taken = residual @ residual - left @ left
        assert blame == pytest.approx(taken, rel=1e-5, abs=1e-9 * (values @ values))


def test_every_kind_has_a_robot_and_every_robot_a_kind() -> None:
    shipped = {type(robots.load(name)) for name in robots.names()}
    assert shipped == set(KINDS.values())
