"""A run skips exactly the files without a test selected by its marks."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import marks
from tests.marks import may_choose
from tests.slow_tests import TESTS

LANES = re.findall(
    r'"((?:not )?(?:timed|busy|programs)[a-z() ]*)"',
    (TESTS.parent / "scripts/run_tests").read_text("utf-8"),
)
"""Selections that `scripts/run_tests` runs in parallel."""
QUICK = "not timed and (not slow or shared)"
WAITING = "timed and not busy and not programs"
ALL = "pytestmark = [pytest.mark.system, pytest.mark.busy]\n\n"
ONE = "@pytest.mark.{}\ndef test_one(): pass\n"


def test_each_file_is_in_a_lane() -> None:
    assert len(LANES) == 5
    for path in TESTS.rglob("test_*.py"):
        assert any(may_choose(lane, path) for lane in LANES), path


@pytest.mark.parametrize(
    ("folder", "text", "chosen"),
    [
        ("lab", "", {QUICK}),
        ("lab", ONE.format("system"), {QUICK, WAITING}),
        ("node", "", {WAITING}),
        ("node", ONE.format("computes"), {QUICK, WAITING}),
        ("node", ONE.format("busy"), {"busy", WAITING}),
        ("app", "", {"programs"}),
        ("app", ONE.format("busy"), {"busy", "programs"}),
        ("app", ALL, {"busy"}),
    ],
)
def test_a_file_is_read_by_the_lanes_of_its_tests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, text: str, chosen: set[str]
) -> None:
    monkeypatch.setattr(marks, "TESTS", tmp_path)
    path = tmp_path / folder / "test_made.py"
    path.parent.mkdir()
    path.write_text(text, "utf-8")
    assert {lane for lane in LANES if may_choose(lane, path)} == chosen


def test_a_file_may_have_slow_tests_if_one_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(marks, "TESTS", tmp_path)
    listed = frozenset({"lab/test_made.py::test_one"})
    monkeypatch.setattr(marks, "listed", lambda: listed)
    monkeypatch.setattr(marks, "long_listed", frozenset[str])
    for name, has_slow in (("lab/test_made.py", True), ("lab/test_made_too.py", False)):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("", "utf-8")
        assert may_choose("slow", path) is has_slow
        assert may_choose("not timed and slow", path) is has_slow
        assert may_choose("not timed and not slow", path)
        assert not may_choose("timed and slow", path)
