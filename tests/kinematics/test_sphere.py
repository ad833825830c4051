"""The sphere on its wheels: touching surfaces move alike, and row changes match the paper."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.kinematics.random_kinematics import directions, sphere_drives
from tsd_twin import robots
from tsd_twin.kinematics import SphereKinematics
from tsd_twin.kinematics.omni import contacts_and_directions, sphere_layout_problem
from tsd_twin.lie import SO3, Array

calm = settings(max_examples=60)
ATLAS = robots.load_robot("atlas").kinematics()
WHEELS = {
    "wheel_radius_m": 0.025,
    "max_speed_rad_per_s": 50.0,
    "max_acceleration_rad_per_s2": 100.0,
}


def test_the_ideal_rows_are_those_of_the_paper() -> None:
    """Eq. 26 for a mounting at 40 degrees: (R / r) (sin t cos az, sin t sin az, cos t)."""
    theta = np.radians(40.0)
    rows = [
        [np.sin(theta) * np.cos(az), np.sin(theta) * np.sin(az), np.cos(theta)]
        for az in np.radians([0.0, 120.0, 240.0])
    ]
    np.testing.assert_allclose(ATLAS.speeds_from_twist, 6.0 * np.array(rows), rtol=0, atol=1e-12)


def test_the_dual_rows_are_those_of_the_paper() -> None:
    """Eq. 25 with the cosine of Eq. 27, d = 12.5 mm, R = 150 mm, r_r = 4.85 mm."""
    theta, share = np.radians(40.0), 12.5 / (2.0 * (150.0 + 4.85))
    for side in (-1.0, 1.0):
        for i, az in enumerate(np.radians([0.0, 120.0, 240.0])):
            ideal = np.array(
                [np.sin(theta) * np.cos(az), np.sin(theta) * np.sin(az), np.cos(theta)]
            )
            hop = np.array([np.cos(theta) * np.cos(az), np.cos(theta) * np.sin(az), -np.sin(theta)])
            row = 6.0 * (math.sqrt(1.0 - share**2) * ideal + side * share * hop)
            ours = ATLAS.true_rows(np.full(3, side))[i]
            np.testing.assert_allclose(ours, row, rtol=0, atol=1e-12)


@calm
@given(kinematics=sphere_drives(), direction=directions(), seed=st.integers(0, 2**16))
def test_surfaces_that_touch_move_alike_where_the_wheel_pushes(
    kinematics: SphereKinematics, direction: Array, seed: int
) -> None:
    """A row's contact is off the wheel centre, where its roller touches the sphere."""
    sides = np.random.default_rng(seed).choice([-1.0, 1.0], size=kinematics.wheels)
    speeds = kinematics.true_inverse(direction, sides)
    for i, side in enumerate(sides):
        out, push = kinematics.contacts[i], kinematics.actuations[i]
        # The first row (-1) is on the side of the wheel's axle that points along R x v.
        axle = np.cross(out, push)
        touch = (
            math.cos(kinematics.row_offset_rad) * out
            - side * math.sin(kinematics.row_offset_rad) * axle
        )
        surface = np.cross(direction, kinematics.sphere_radius_m * touch)
        rim = kinematics.wheel_radius_m * speeds[i]
        assert surface @ push == pytest.approx(rim, abs=1e-12)


@calm
@given(kinematics=sphere_drives(), direction=directions(), seed=st.integers(0, 2**16))
def test_the_true_twist_undoes_the_true_inverse(
    kinematics: SphereKinematics, direction: Array, seed: int
) -> None:
    sides = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(4, kinematics.wheels))
    speeds = kinematics.true_inverse(direction, sides)
    np.testing.assert_allclose(
        kinematics.true_twist(speeds, sides), np.tile(direction, (4, 1)), rtol=0, atol=1e-9
    )


@calm
@given(kinematics=sphere_drives(), direction=directions())
def test_rows_without_a_distance_are_ideal(kinematics: SphereKinematics, direction: Array) -> None:
    plain = dataclasses.replace(kinematics, row_offset_rad=0.0)
    sides = np.ones(kinematics.wheels)
    np.testing.assert_array_equal(plain.true_rows(sides), plain.true_rows(-sides))
    np.testing.assert_allclose(
        plain.true_inverse(direction, sides), plain.speeds_from_twist @ direction, rtol=1e-12
    )


@given(turns=st.floats(-50.0, 50.0))
def test_a_row_carries_for_pi_over_n_as_the_paper_counts(turns: float) -> None:
    """l = floor(N phi / pi mod 2) + 1 with N = 8, and (-1)^l."""
    assume(abs(16.0 * turns - round(16.0 * turns)) > 1e-9)  # Between two rows, either may carry.
    phi = turns * 2.0 * math.pi
    index = math.floor((8.0 * phi / math.pi) % 2.0) + 1
    assert ATLAS.side(np.full(3, phi))[0] == (-1.0) ** index


@calm
@given(before=st.floats(-9.0, 9.0), way=st.floats(-3.0, 3.0))
def test_the_mean_side_is_that_of_all_angles_on_the_way(before: float, way: float) -> None:
    assume(abs(way) > 1e-6)  # A wheel at rest remains on its row; see below.
    angles = before + way * (np.arange(20_000) + 0.5) / 20_000
    mean = ATLAS.side(np.stack([angles] * 3, axis=-1)).mean(axis=0)
    ours = ATLAS.mean_side(np.full(3, before), np.full(3, before + way))
    np.testing.assert_allclose(ours, mean, rtol=0, atol=2e-3)


def test_a_wheel_that_stands_is_on_the_row_it_stands_on() -> None:
    angles = np.array([0.1, 0.5, -0.1])
    np.testing.assert_array_equal(ATLAS.mean_side(angles, angles), ATLAS.side(angles))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 1.0, 20.0])
def test_rows_are_mistaken_as_often_as_wrong_angles_are_on_the_other_one(share: float) -> None:
    random = np.random.default_rng(0)
    angles = random.uniform(-2.0, 2.0, 3)
    wrong = share * ATLAS.row_rad * random.standard_normal((20000, 3))
    found = (ATLAS.side(angles + wrong) != ATLAS.side(angles)).mean(axis=0)
    said = ATLAS.wrong_side(angles, np.full(3, share * ATLAS.row_rad))
    np.testing.assert_allclose(said, found, atol=0.03)


def test_the_orthogonal_mounting_turns_about_three_axes_at_right_angles() -> None:
    """Eq. 19, 20: on the sphere's axes, each wheel turns it about a different axis."""
    contacts = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    actuations = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    kinematics = SphereKinematics(contacts, actuations, 0.15, 0.04, np.pi / 8, **WHEELS)
    rows = kinematics.speeds_from_twist
    np.testing.assert_allclose(rows @ rows.T, 36.0 * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(kinematics.inverse(np.array([0.0, 0.0, 1.0])), [6.0, 0.0, 0.0])


@calm
@given(
    kinematics=sphere_drives(), turn=st.tuples(*[st.floats(-2.0, 2.0)] * 3), direction=directions()
)
def test_a_platform_that_is_turned_as_a_whole_turns_the_sphere_about_turned_axes(
    kinematics: SphereKinematics, turn: tuple[float, float, float], direction: Array
) -> None:
    """Eq. 31 for any mounting; no axis is special."""
    rotation = SO3.exp(np.array(turn))
    turned = dataclasses.replace(
        kinematics,
        contacts=rotation.rotate(kinematics.contacts),
        actuations=rotation.rotate(kinematics.actuations),
    )
    sides = np.where(np.arange(kinematics.wheels) % 2, -1.0, 1.0)
    np.testing.assert_allclose(
        turned.true_inverse(rotation.rotate(direction), sides),
        kinematics.true_inverse(direction, sides),
        rtol=0,
        atol=1e-11 * kinematics.sphere_radius_m / kinematics.wheel_radius_m,
    )


def test_angles_place_a_wheel_where_they_say() -> None:
    """A wheel in front, half-way down, pushes to the left; turned by 90 degrees it pushes up."""
    contacts, actuations = contacts_and_directions(
        np.zeros(2), np.radians([30.0, 30.0]), np.array([0.0, np.pi / 2])
    )
    down = np.array([math.cos(np.pi / 6), 0.0, -0.5])
    np.testing.assert_allclose(contacts, [down, down], atol=1e-15)
    np.testing.assert_allclose(actuations[0], [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(actuations[1], [0.5, 0.0, math.cos(np.pi / 6)], atol=1e-15)


def test_wheels_that_share_a_plane_of_axes_are_refused() -> None:
    """On the equator all wheels push about the vertical."""
    contacts, actuations = contacts_and_directions(
        np.array([0.0, 2.0, 4.0]), np.zeros(3), np.zeros(3)
    )
    assert "cannot" in sphere_layout_problem(contacts[:2], actuations[:2])
    said = sphere_layout_problem(contacts, actuations)
    assert said.startswith("no wheel can turn the sphere about the axis")
    with pytest.raises(ValueError, match="about the axis"):
        SphereKinematics(contacts, actuations, 0.15, 0.04, np.pi / 8, **WHEELS)


def test_it_moves_by_turning_about_the_axes_of_the_base() -> None:
    """A quarter turn about X, then Z, both in base axes: the top comes to the front."""
    pose = ATLAS.integrate(SO3.identity(), np.array([np.pi / 2, 0.0, 0.0]), 1.0)
    pose = ATLAS.integrate(pose, np.array([0.0, 0.0, np.pi / 2]), 1.0)
    # Up moves to -Y by the first turn, and from there to +X by the second.
    np.testing.assert_allclose(pose.rotate(np.array([0.0, 0.0, 1.0])), [1.0, 0.0, 0.0], atol=1e-12)
