"""The three tracking errors, for motions with known errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.lab.tracking import tracking_errors

T = np.linspace(0.0, 1.0, 501)
STRAIGHT = np.stack([2.0 * T, 0.0 * T], axis=-1)


@given(lag_s=st.floats(0.001, 0.3))
def test_who_is_late_is_late_in_time_only(lag_s: float) -> None:
    late = np.stack([2.0 * np.maximum(T - lag_s, 0.0), 0.0 * T], axis=-1)
    errors = tracking_errors(late, STRAIGHT, STRAIGHT)
    assert errors.worst_m == pytest.approx(2.0 * lag_s)
    assert errors.cross_track_m == pytest.approx(0.0, abs=1e-12)
    assert errors.closure_m == pytest.approx(2.0 * lag_s)
    assert errors.size_m == pytest.approx(2.0)
    assert 0.0 < errors.rms_m <= errors.worst_m


@given(aside_m=st.floats(-0.5, 0.5))
def test_who_runs_beside_the_path_is_as_far_off_in_all_three(aside_m: float) -> None:
    errors = tracking_errors(STRAIGHT + np.array([0.0, aside_m]), STRAIGHT, STRAIGHT)
    for value in (errors.rms_m, errors.worst_m, errors.cross_track_m, errors.closure_m):
        assert value == pytest.approx(abs(aside_m), abs=1e-12)


def test_distances_are_to_the_legs_not_to_their_ends() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    xy = np.array([[0.5, 0.2], [1.3, 0.5], [1.3, -0.4], [-0.3, 0.4]])
    for points, far in zip(xy, (0.2, 0.3, 0.5, 0.5), strict=True):
        errors = tracking_errors(points[None], points[None], square)
        assert errors.cross_track_m == pytest.approx(far)


def test_the_sentence_has_millimetres_and_per_cent() -> None:
    sentence = tracking_errors(STRAIGHT + np.array([0.0, 0.01]), STRAIGHT, STRAIGHT).sentence()
    assert sentence == (
        "RMS time-tracking 10.0 mm (0.50 %), maximum cross-track 10.0 mm (0.50 %), "
        "closure 10.0 mm (0.50 %)"
    )
