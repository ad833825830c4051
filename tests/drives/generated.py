"""Drives and twists for property tests."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import Array


def drive_of(
    azimuths: list[float], spin: float = 260.0, pivot_radius: float = 0.15
) -> SingularityDrive:
    return SingularityDrive(
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
def drives(draw: st.DrawFn, fewest: int = 2) -> SingularityDrive:
    """Two to six modules anywhere around the robot, no two of them closer than 0.2 rad."""
    gaps = draw(st.lists(st.floats(0.2, 1.0), min_size=fewest - 1, max_size=5))
    azimuths = np.cumsum([draw(st.floats(-np.pi, np.pi)), *gaps])
    order = draw(st.permutations(range(len(azimuths))))
    return SingularityDrive(
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
    """A direction for a twist; one axis alone now and then."""
    twist = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(3)])
    twist *= draw(st.sampled_from([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]))
    return twist if np.abs(twist).max() > 1e-3 else np.array([1.0, 0.0, 0.0])


shares = st.one_of(st.floats(1e-100, 1.0), st.sampled_from([1e-12, 1e-9, 1e-6, 0.0]))
"""Of the tilt limit; near zero on purpose, where steer angles have no meaning."""


def within_limit(drive: SingularityDrive, direction: Array, share: float) -> Array:
    return direction * (share / drive.demand(direction))


def size(drive: SingularityDrive, twist: Array) -> float:
    """Speed of the fastest pivot, at most."""
    return float(np.hypot(twist[0], twist[1]) + abs(twist[2]) * drive.pivot_radius_m)


@st.composite
def joint_vectors(draw: st.DrawFn, drive: SingularityDrive) -> Array:
    """Joints that need not agree with each other."""
    angles, spins = st.floats(-1.0, 1.0), st.floats(-1500.0, 1500.0)
    return np.array([[draw(angles), draw(angles), draw(spins)] for _ in range(drive.modules)])
