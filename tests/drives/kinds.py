"""Random drives of the other kinds, and of any kind."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from tests.drives.generated import drives as singularity_drives
from tsd_twin.drives import Drive, OmniDrive, SphereDrive
from tsd_twin.drives import omni as omni_module
from tsd_twin.drives import sphere as sphere_module
from tsd_twin.lie import Array

angles = st.floats(-np.pi, np.pi)
lengths = st.floats(0.05, 1.0)


def strength(rows: Array) -> float:
    """The weakest direction of a matrix against its strongest."""
    strengths = np.linalg.svd(rows, compute_uv=False)
    return float(strengths[-1] / strengths[0])


@st.composite
def omni_drives(draw: st.DrawFn) -> OmniDrive:
    """Three to six wheels anywhere, driving anywhere, with rollers at any sensible angle."""
    k = draw(st.integers(3, 6))
    positions = np.array([[draw(st.floats(-1.0, 1.0)) for _ in range(2)] for _ in range(k)])
    directions = np.array([draw(angles) for _ in range(k)])
    rollers = np.array([draw(st.sampled_from([0.0, np.pi / 4, -np.pi / 4, 0.9])) for _ in range(k)])
    # A layout that can hardly move in some way amplifies rounding; none is built like that.
    assume(np.abs(positions).max() > 0.05)
    assume(not omni_module.impossible(positions, directions, rollers))
    drive = OmniDrive(
        positions_m=positions,
        directions_rad=directions,
        rollers_rad=rollers,
        wheel_radius_m=draw(st.floats(0.01, 0.2)),
        max_speed_rad_per_s=draw(st.floats(5.0, 200.0)),
        max_acceleration_rad_per_s2=draw(st.floats(10.0, 1000.0)),
    )
    assume(strength(drive.speeds_from_twist) > 0.02)
    return drive


@st.composite
def sphere_drives(draw: st.DrawFn) -> SphereDrive:
    """Three to five wheels anywhere on the sphere, turned anyhow."""
    k = draw(st.integers(3, 5))
    contacts, actuations = sphere_module.mounting(
        np.array([draw(angles) for _ in range(k)]),
        np.array([draw(st.floats(-1.2, 1.2)) for _ in range(k)]),
        np.array([draw(angles) for _ in range(k)]),
    )
    assume(strength(np.cross(contacts, actuations)) > 0.1)
    return SphereDrive(
        contacts=contacts,
        actuations=actuations,
        sphere_radius_m=draw(lengths),
        wheel_radius_m=draw(st.floats(0.01, 0.05)),
        row_offset_rad=draw(st.sampled_from([0.0, 1e-6, 0.02, 0.05])),
        row_rad=np.pi / draw(st.integers(2, 20)),
        max_speed_rad_per_s=draw(st.floats(5.0, 200.0)),
        max_acceleration_rad_per_s2=draw(st.floats(10.0, 1000.0)),
    )


def any_drives() -> st.SearchStrategy[Drive[Any]]:
    return st.one_of(singularity_drives(), omni_drives(), sphere_drives())
