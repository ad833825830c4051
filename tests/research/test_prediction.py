"""Errors of the predicted pose, with other seeds than the table in the docs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from research.prediction import INITIAL_TWISTS, Case, position_errors
from tests.support.experiment_runs import is_picture, run


@pytest.mark.parametrize(("manoeuvre", "most_mm"), [("full stick", 2.0), ("wander", 1.5)])
def test_measured_twist_is_the_better_initial_twist(manoeuvre: str, most_mm: float) -> None:
    errors_m = position_errors(Case("tsd", "kinematic", manoeuvre, 2, 300, 6.0))
    none, commanded, measured = np.median(errors_m, axis=2).T
    assert (measured < commanded).all()
    assert (commanded < 0.2 * none).all()
    assert 1e3 * measured[0] < most_mm
    if manoeuvre == "full stick":
        assert measured[0] < 0.5 * commanded[0]


def test_table_has_a_row_for_each_round_trip(tmp_path: Path) -> None:
    lines = run(tmp_path, "prediction", "--seeds", "1", "--seconds", "2", "--jobs", "1")
    assert sum(line.startswith(("| full stick", "| wander")) for line in lines) == 6
    rows = (tmp_path / "prediction.csv").read_text().splitlines()
    assert len(rows) == 1 + 6 * len(INITIAL_TWISTS)
    assert is_picture(tmp_path / "prediction.png")
