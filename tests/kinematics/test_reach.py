"""Reachable twists against rolling rigid bodies, an oracle without gauges and matrices."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.random_kinematics import any_drives, drives, omni_drives, sphere_drives
from tsd_twin.kinematics import (
    Kinematics,
    OmniKinematics,
    SingularityKinematics,
    SphereKinematics,
)
from tsd_twin.kinematics.base import largest_projection, largest_twist, section, shadow
from tsd_twin.lie import Array

calm = settings(max_examples=40)
PLANES = [(0, 1), (0, 2), (1, 2)]
SAMPLES = 4000
POINTS = 48


def reaches(drive: Any, twists: Array) -> Array:
    """Return for twists (n, 3) whether the drive can reach them, from each rolling wheel alone."""
    match drive:
        case SingularityKinematics():
            # A pivot moves as fast as the rim of its tilted wheel: r spin sin(tilt).
            speeds = [
                np.hypot(twists[:, 0] - twists[:, 2] * y, twists[:, 1] + twists[:, 2] * x)
                / (drive.wheel_radius_m * abs(drive.spin_rad_per_s) * ratio)
                for (x, y), ratio in zip(drive.pivots_m, drive.spin_ratio, strict=True)
            ]
            return np.max(speeds, axis=0) <= math.sin(drive.max_tilt_rad)
        case OmniKinematics():
            # Along the roller's axle, the hub moves like the rim: r spin cos(roller).
            speeds = []
            for (x, y), forward, roller in zip(
                drive.positions_m, drive.directions_rad, drive.rollers_rad, strict=True
            ):
                hub = twists[:, 0] - twists[:, 2] * y, twists[:, 1] + twists[:, 2] * x
                along = hub[0] * math.cos(forward + roller) + hub[1] * math.sin(forward + roller)
                speeds.append(np.abs(along) / (drive.wheel_radius_m * math.cos(roller)))
            return np.max(speeds, axis=0) <= drive.max_speed_rad_per_s
        case SphereKinematics():
            # In the driven direction, the surface moves like the rim.
            speeds = [
                np.abs(np.cross(twists, drive.sphere_radius_m * contact) @ push)
                / drive.wheel_radius_m
                for contact, push in zip(drive.contacts, drive.actuations, strict=True)
            ]
            return np.max(speeds, axis=0) <= drive.max_speed_rad_per_s
        case _:
            raise AssertionError(drive)


def spread(drive: Kinematics[Any], seed: int, across: float) -> Array:
    """Random twists (n, 3) in a box `across` times as wide as the reach of single axes."""
    tops = np.diag(largest_twist(drive, np.eye(3)))
    return np.random.default_rng(seed).uniform(-across, across, (SAMPLES, 3)) * tops


@calm
@given(drive=any_drives(), seed=st.integers(0, 2**32 - 1))
def test_what_rolls_is_within_the_largest_twist_and_nothing_else_is(
    drive: Kinematics[Any], seed: int
) -> None:
    twists = spread(drive, seed, 1.5)
    most = largest_twist(drive, twists)
    share = np.linalg.norm(twists, axis=-1) / np.linalg.norm(most, axis=-1)
    clear = np.abs(share - 1.0) > 1e-9
    assert np.array_equal(reaches(drive, twists)[clear], (share < 1.0)[clear])


@calm
@given(drive=any_drives(), plane=st.sampled_from(PLANES))
def test_the_section_is_where_wheels_reach_their_limit_without_the_third_component(
    drive: Kinematics[Any], plane: tuple[int, int]
) -> None:
    twists = np.zeros((POINTS, 3))
    twists[:, plane] = section(drive, plane, POINTS)
    assert reaches(drive, (1.0 - 1e-9) * twists).all()
    assert not reaches(drive, (1.0 + 1e-9) * twists).any()


@calm
@given(drive=any_drives(), plane=st.sampled_from(PLANES), seed=st.integers(0, 2**32 - 1))
def test_the_shadow_covers_every_twist_that_rolls(
    drive: Kinematics[Any], plane: tuple[int, int], seed: int
) -> None:
    twists = spread(drive, seed, 4.0)
    done = twists[reaches(drive, twists)]
    third = 3 - sum(plane)
    done[:, third] = 0.0
    farthest = largest_projection(drive, done, third)
    lengths, most = (np.linalg.norm(each, axis=-1) for each in (done, farthest))
    assert len(done) > 0
    assert (lengths <= most * (1.0 + 1e-9)).all()


@calm
@given(drive=any_drives(), plane=st.sampled_from(PLANES))
def test_each_point_of_the_shadow_is_reached_and_none_beyond_it(
    drive: Kinematics[Any], plane: tuple[int, int]
) -> None:
    """The third component is found by successively finer grids."""
    third = 3 - sum(plane)
    free = np.eye(3)[third]
    for point in shadow(drive, plane, POINTS)[:: POINTS // 6]:
        twist = np.zeros(3)
        twist[list(plane)] = point
        widest = float(largest_twist(drive, free)[third] * (1.0 + drive.joint_utilization(twist)))
        low, high = -widest, widest
        best = 0.0
        for _ in range(12):
            grid = np.linspace(low, high, 41)
            best = grid[int(drive.joint_utilization(twist + grid[:, None] * free).argmin())]
            low, high = best - (high - low) / 20.0, best + (high - low) / 20.0
        assert reaches(drive, (1.0 - 1e-6) * (twist + best * free)[None]).all()
        beyond = (1.0 + 1e-6) * twist + np.linspace(-widest, widest, 2001)[:, None] * free
        assert not reaches(drive, beyond).any()


@calm
@given(drive=st.one_of(omni_drives(), sphere_drives()), plane=st.sampled_from(PLANES))
def test_the_shadow_of_wheels_that_roll_is_that_of_the_corners_of_their_polytope(
    drive: OmniKinematics | SphereKinematics, plane: tuple[int, int]
) -> None:
    """Corners by brute force: three wheels turn at their limit, the others below theirs."""
    rows = drive.speeds_from_twist / drive.max_speed_rad_per_s
    corners: list[Array] = []
    for three in combinations(range(len(rows)), 3):
        chosen = rows[list(three)]
        if np.linalg.cond(chosen) > 1e9:
            continue
        for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)):
            corner = np.linalg.solve(chosen, np.array(signs, dtype=float))
            if np.abs(rows @ corner).max() <= 1.0 + 1e-9:
                corners.append(corner)
    seen = np.array(corners)
    third = 3 - sum(plane)
    seen[:, third] = 0.0
    seen = seen[np.linalg.norm(seen, axis=-1) > 1e-6]
    lengths = np.linalg.norm(seen, axis=-1)
    most = np.linalg.norm(largest_projection(drive, seen, third), axis=-1)
    assert (lengths <= most * (1.0 + 1e-6)).all()
    # The farthest point of a polygon from zero is a corner.
    far = int(lengths.argmax())
    assert lengths[far] == pytest.approx(most[far], rel=1e-6)


def test_the_drive_of_the_thesis_is_as_fast_in_every_direction() -> None:
    """r_w = 40 mm at 2,500 rpm and 30 degrees: 5.24 m/s, 34.9 rad/s."""
    drive = SingularityKinematics(
        azimuths_rad=np.radians([90.0, 210.0, 330.0]),
        pivot_radius_m=0.15,
        wheel_radius_m=0.04,
        spin_rad_per_s=2500.0 * math.pi / 30.0,
        max_tilt_rad=math.radians(30.0),
        max_tilt_rate_rad_per_s=6.6,
    )
    top_mps = 0.04 * 2500.0 * math.pi / 30.0 * 0.5
    speeds = np.linalg.norm(section(drive, (0, 1), POINTS), axis=-1)
    assert speeds == pytest.approx(top_mps, rel=1e-12)
    assert shadow(drive, (0, 1), POINTS) == pytest.approx(section(drive, (0, 1), POINTS), rel=1e-9)
    assert largest_twist(drive, np.array([0.0, 0.0, 2.0]))[2] == pytest.approx(top_mps / 0.15)


def test_turning_helps_a_robot_whose_pivots_are_on_one_side() -> None:
    """Its shadow is wider than its section, so some speeds are reached only on a curve."""
    drive = SingularityKinematics(
        azimuths_rad=np.radians([-30.0, 0.0, 30.0]),
        pivot_radius_m=0.15,
        wheel_radius_m=0.04,
        spin_rad_per_s=260.0,
        max_tilt_rad=math.radians(30.0),
        max_tilt_rate_rad_per_s=6.6,
    )
    straight, curved = (
        np.linalg.norm(outline(drive, (0, 1), POINTS), axis=-1) for outline in (section, shadow)
    )
    assert (curved >= straight * (1.0 - 1e-12)).all()
    assert curved.max() > 1.5 * straight.max()


@calm
@given(drive=drives())
def test_two_axes_of_a_plane_reach_what_they_reach_alone(drive: SingularityKinematics) -> None:
    tops = np.diag(largest_twist(drive, np.eye(3)))
    for plane in PLANES:
        outline = section(drive, plane, POINTS)
        assert outline[0] == pytest.approx([tops[plane[0]], 0.0], abs=1e-9 * tops[plane[0]])
