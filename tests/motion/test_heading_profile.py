"""Heading profiles against scipy's clamped cubic splines."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline  # pyright: ignore

from tsd_twin.motion.paths import line
from tsd_twin.motion.routes import SampledHeading


@given(
    steps=st.lists(st.floats(0.05, 5.0), min_size=1, max_size=8),
    data=st.data(),
)
def test_sampled_headings_equal_a_clamped_spline(steps: list[float], data: st.DataObject) -> None:
    at = np.concatenate([[0.0], np.cumsum(steps)])
    angles = st.lists(st.floats(-20.0, 20.0), min_size=len(at), max_size=len(at))
    heading = np.array(data.draw(angles))
    spline: Any = CubicSpline(at, heading, bc_type="clamped")
    s = np.concatenate([np.linspace(0.0, at[-1], 97), at])
    found = SampledHeading(at.tolist(), heading.tolist()).at(s, line([0, 0], [1, 0]).at(s))
    for order, values in enumerate(found):
        expected = np.asarray(spline(s, order))
        np.testing.assert_allclose(
            values, expected, rtol=0.0, atol=1e-11 * (1.0 + np.abs(expected).max())
        )


def test_headings_beyond_the_ends_are_constant() -> None:
    s = np.array([-1.0, 0.0, 2.0, 3.0])
    profile = SampledHeading([0.0, 2.0], [0.5, 1.5])
    heading, per_m, per_m2 = profile.at(s, line([0, 0], [1, 0]).at(s))
    np.testing.assert_allclose(heading, [0.5, 0.5, 1.5, 1.5], atol=1e-15)
    assert not per_m.any()
    assert not per_m2[[0, 3]].any()
