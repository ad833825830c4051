"""The motor table of the thesis, and its linear fits, against numpy's."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.experiment_runs import is_picture, run, table
from tsd_twin import robots
from tsd_twin.lab.motors import fit_lines, round_half_up

MOTOR = robots.load_robot("tsd").motor


def test_it_prints_table_2_of_the_thesis_and_the_better_fit(tmp_path: Path) -> None:
    text = "\n".join(run(tmp_path, "motors"))
    for line in ("77.65 / -563.3", "77.16 / -439.6", "77.30 / -477.1"):
        assert line in text
    for line in ("76.03 / -332.4", "74.13 / -22.8", "74.69 / -116.8"):
        assert line in text
    errors = [int(n) for n in re.findall(r"off by (\d+) rpm", text)]
    assert all(better < worse for worse, better in zip(errors[:3], errors[3:], strict=True))
    assert is_picture(tmp_path / "motors.png")
    columns = table(tmp_path / "motors.csv")
    np.testing.assert_array_equal(columns["signal"], MOTOR.signal)
    np.testing.assert_array_equal(columns["motor2_rpm"], MOTOR.speed_rpm[1])
    np.testing.assert_allclose(
        columns["motor3_all_rows_rpm"], 77.30 * columns["signal"] - 477.1, atol=1.0
    )


@given(
    points=st.lists(
        st.tuples(st.integers(0, 180), st.floats(0, 15_000)),
        min_size=3,
        max_size=12,
        unique_by=lambda point: point[0],
    )
)
def test_a_fit_is_that_of_least_squares(points: list[tuple[int, float]]) -> None:
    signal, rpm = np.array(sorted(points)).T
    lines = fit_lines(signal, rpm[None], np.full(len(signal), True))
    slope, offset = np.polyfit(signal, rpm, 1)
    assert lines.slope[0] == pytest.approx(slope, abs=1e-6)
    assert lines.offset[0] == pytest.approx(offset, abs=1e-4)


def test_halves_are_rounded_away_from_zero_as_in_print() -> None:
    assert [round_half_up(x, 1) for x in (-563.25, 563.25, -0.04)] == ["-563.3", "563.3", "-0.0"]
