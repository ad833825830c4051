"""Random kinematics, twists and joint vectors for property tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from tsd_twin.kinematics import Kinematics, OmniKinematics, SingularityKinematics, SphereKinematics
from tsd_twin.kinematics import omni as omni_module
from tsd_twin.lie import Array


def drive_of(
    azimuths: list[float], spin: float = 260.0, pivot_radius: float = 0.15
) -> SingularityKinematics:
    return SingularityKinematics(
        azimuths_rad=np.array(azimuths),
        pivot_radius_m=pivot_radius,
        wheel_radius_m=0.04,
        spin_rad_per_s=spin,
        max_tilt_rad=np.radians(30.0),
        max_tilt_rate_rad_per_s=6.6,
    )


ratios = st.one_of(st.just(1.0), st.floats(0.5, 2.0))
"""Wheels all turn alike, more often than not."""


@st.composite
def drives(draw: st.DrawFn, fewest: int = 2) -> SingularityKinematics:
    """Two to six modules anywhere around the robot, no two of them closer than 0.2 rad."""
    gaps = draw(st.lists(st.floats(0.2, 1.0), min_size=fewest - 1, max_size=5))
    azimuths = np.cumsum([draw(st.floats(-np.pi, np.pi)), *gaps])
    order = draw(st.permutations(range(len(azimuths))))
    return SingularityKinematics(
        azimuths_rad=azimuths[list(order)],
        pivot_radius_m=draw(st.floats(0.05, 1.0)),
        wheel_radius_m=draw(st.floats(0.01, 0.2)),
        spin_rad_per_s=draw(st.sampled_from([-1.0, 1.0])) * draw(st.floats(50.0, 1500.0)),
        max_tilt_rad=np.radians(draw(st.floats(5.0, 60.0))),
        max_tilt_rate_rad_per_s=draw(st.floats(0.5, 20.0)),
        spin_ratio=np.array([draw(ratios) for _ in azimuths]),
    )


@st.composite
def directions(draw: st.DrawFn) -> Array:
    """Return a direction for a twist, sometimes along one axis."""
    twist = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(3)])
    twist *= draw(st.sampled_from([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]))
    return twist if np.abs(twist).max() > 1e-3 else np.array([1.0, 0.0, 0.0])


shares = st.one_of(st.floats(1e-100, 1.0), st.sampled_from([1e-12, 1e-9, 1e-6, 0.0]))
"""Fractions of the tilt limit, including values near zero, where steer angles are undefined."""


def within_limit(kinematics: SingularityKinematics, direction: Array, share: float) -> Array:
    return direction * (share / kinematics.joint_utilization(direction))


def size(kinematics: SingularityKinematics, twist: Array) -> float:
    """Speed of the fastest pivot, at most."""
    return float(np.hypot(twist[0], twist[1]) + abs(twist[2]) * kinematics.pivot_radius_m)


@st.composite
def joint_vectors(draw: st.DrawFn, kinematics: SingularityKinematics) -> Array:
    """Joints that need not agree with each other."""
    angles, spins = st.floats(-1.0, 1.0), st.floats(-1500.0, 1500.0)
    return np.array([[draw(angles), draw(angles), draw(spins)] for _ in range(kinematics.modules)])


angles = st.floats(-np.pi, np.pi)
lengths = st.floats(0.05, 1.0)


def strength(rows: Array) -> float:
    """The weakest direction of a matrix against its strongest."""
    strengths = np.linalg.svd(rows, compute_uv=False)
    return float(strengths[-1] / strengths[0])


@st.composite
def omni_drives(draw: st.DrawFn) -> OmniKinematics:
    """Three to six wheels anywhere, driving anywhere, with rollers at any sensible angle."""
    k = draw(st.integers(3, 6))
    positions = np.array([[draw(st.floats(-1.0, 1.0)) for _ in range(2)] for _ in range(k)])
    directions = np.array([draw(angles) for _ in range(k)])
    rollers = np.array([draw(st.sampled_from([0.0, np.pi / 4, -np.pi / 4, 0.9])) for _ in range(k)])
    # A layout that can hardly move in some way amplifies rounding; none is built like that.
    assume(np.abs(positions).max() > 0.05)
    assume(not omni_module.layout_problem(positions, directions, rollers))
    kinematics = OmniKinematics(
        positions_m=positions,
        directions_rad=directions,
        rollers_rad=rollers,
        wheel_radius_m=draw(st.floats(0.01, 0.2)),
        max_speed_rad_per_s=draw(st.floats(5.0, 200.0)),
        max_acceleration_rad_per_s2=draw(st.floats(10.0, 1000.0)),
    )
    assume(strength(kinematics.speeds_from_twist) > 0.02)
    return kinematics


@st.composite
def sphere_drives(draw: st.DrawFn) -> SphereKinematics:
    """Three to five wheels anywhere on the sphere, turned anyhow."""
    k = draw(st.integers(3, 5))
    contacts, actuations = omni_module.contacts_and_directions(
        np.array([draw(angles) for _ in range(k)]),
        np.array([draw(st.floats(-1.2, 1.2)) for _ in range(k)]),
        np.array([draw(angles) for _ in range(k)]),
    )
    assume(strength(np.cross(contacts, actuations)) > 0.1)
    return SphereKinematics(
        contacts=contacts,
        actuations=actuations,
        sphere_radius_m=draw(lengths),
        wheel_radius_m=draw(st.floats(0.01, 0.05)),
        row_offset_rad=draw(st.sampled_from([0.0, 1e-6, 0.02, 0.05])),
        row_rad=np.pi / draw(st.integers(2, 20)),
        max_speed_rad_per_s=draw(st.floats(5.0, 200.0)),
        max_acceleration_rad_per_s2=draw(st.floats(10.0, 1000.0)),
    )


def any_drives() -> st.SearchStrategy[Kinematics[Any]]:
    return st.one_of(drives(), omni_drives(), sphere_drives())
