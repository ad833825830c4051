"""Experiments in the docs of the Student tab have the stated results."""

from __future__ import annotations

import re
from urllib.parse import parse_qsl

import pytest

from tests.support.markdown_pages import page
from tsd_twin.dashboard.scene.robot_visual import MOST_TILT_RAD
from tsd_twin.dashboard.sessions.student import solve
from tsd_twin.dashboard.wire.from_page import StudentRequest

ROWS = re.findall(
    r"^\| `\?(\S+)` \| [^|]+ \| ([^|]+) \| ([\d.]+) (\S+) \|$", page("student.md"), re.MULTILINE
)


def test_the_page_has_experiments() -> None:
    assert len(ROWS) >= 8


@pytest.mark.parametrize(("query", "name", "value", "unit"), ROWS)
def test_an_experiment_has_its_result(query: str, name: str, value: str, unit: str) -> None:
    given = dict(parse_qsl(query))
    knobs = {key: float(text) for key, text in given.items() if "." in key}
    reply = solve(StudentRequest(number=1, base=given["student"], knobs=knobs))[0]
    assert reply.problem == ""
    assert reply.figures is not None
    (found,) = [figure for figure in reply.figures.figures if figure.name == name]
    assert float(f"{found.value:.3g}") == float(value)
    assert found.unit == unit


def test_the_most_tilt_that_is_drawn() -> None:
    assert f"up to {MOST_TILT_RAD * 57.29578:.0f}°" in page("student.md")
