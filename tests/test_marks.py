"""A run skips the files of which its marks choose no test, and no others."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support import marks
from tests.support.marks import may_choose
from tests.support.slow_tests import TESTS

LANES = re.findall(
    r'"((?:not )?(?:timed|busy|programs)[a-z ]*)"',
    (TESTS.parent / "scripts/run_tests").read_text("utf-8"),
)
"""What `scripts/run_tests` runs side by side."""
ALL = "pytestmark = [pytest.mark.system, pytest.mark.busy]\n\n"
ONE = "@pytest.mark.{}\ndef test_one(): pass\n"


def test_each_file_is_in_a_lane() -> None:
    assert len(LANES) == 4
    for path in TESTS.rglob("test_*.py"):
        assert any(may_choose(lane, path) for lane in LANES), path


@pytest.mark.parametrize(
    ("folder", "text", "chosen"),
    [
        ("lab", "", {"not timed"}),
        ("lab", ONE.format("system"), {"not timed", "timed and not busy and not programs"}),
        ("node", "", {"timed and not busy and not programs"}),
        ("node", ONE.format("computes"), {"not timed", "timed and not busy and not programs"}),
        ("node", ONE.format("busy"), {"busy", "timed and not busy and not programs"}),
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


def test_of_marks_that_are_not_written_in_files_all_is_possible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(marks, "TESTS", tmp_path)
    path = tmp_path / "test_made.py"
    path.write_text("", "utf-8")
    assert may_choose("slow", path)
    assert may_choose("not timed and not slow", path)
    assert not may_choose("timed and slow", path)
