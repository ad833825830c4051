"""`scripts/run_tests` runs each test once, and fails if too much time was withheld."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.withheld import PATIENCE_S

ROOT = Path(__file__).parents[2]
SETTINGS = "[pytest]\nmarkers =\n    timed\n    programs\n    busy\n    slow\n"
SOUND = "import pytest\n\n@pytest.mark.timed\ndef test_sound(): pass\n\ndef test_sum(): pass\n"
FAILS_ONCE = """
import pathlib, pytest

@pytest.mark.timed
@pytest.mark.{mark}
def test_fails_once():
    been = pathlib.Path("{mark}")
    first = not been.exists()
    been.touch()
    assert not first
"""
LOGS = """

@pytest.mark.{mark}
def test_{mark}():
    for _ in range(2):
        open("turns", "a").write("{mark} ")
        time.sleep(0.3)
"""
STARVED = """
import sys
sys.path.insert(0, {root!r})
from tests.conftest import pytest_sessionfinish, pytest_terminal_summary
from tests.support.withheld import budget

budget.follow("robot").end()
budget.tallies["robot"].add({withheld_s}, 30.0)
"""


def run_in(folder: Path, files: dict[str, str], **variables: str) -> tuple[int, str]:
    """Return exit status and output of a run over a separate project."""
    (folder / "pytest.ini").write_text(SETTINGS, "ascii")
    for name, text in files.items():
        (folder / name).write_text(text, "ascii")
    (folder / ".venv/bin").mkdir(parents=True)
    pytest_script = folder / ".venv/bin/pytest"
    pytest_script.write_text(f'#!/bin/sh\nexec {sys.executable} -m pytest "$@"\n', "ascii")
    python = folder / ".venv/bin/python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n', "ascii")
    for script in (pytest_script, python):
        script.chmod(0o755)
    shutil.copy(ROOT / "scripts/run_tests", folder)
    done = subprocess.run(
        [folder / "run_tests"],
        cwd=folder,
        # Plugins dominate the start of these runs, and these tests need none.
        env=os.environ
        | {"TEST_PRIORITIES": "same", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        | variables,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.system
@pytest.mark.parametrize("serial", ["", "1"], ids=["together", "in turn"])
def test_a_run_in_which_all_tests_pass_passes(tmp_path: Path, serial: str) -> None:
    status, output = run_in(tmp_path, {"test_sound.py": SOUND}, TEST_SERIAL=serial)
    assert status == 0
    assert output.count("1 passed") == 2


@pytest.mark.system
def test_runs_in_turn_do_not_overlap_except_those_that_only_compute(tmp_path: Path) -> None:
    tests = "".join(LOGS.format(mark=mark) for mark in ("timed", "programs", "busy", "slow"))
    status, _ = run_in(tmp_path, {"test_turns.py": f"import pytest, time{tests}"}, TEST_SERIAL="1")
    assert status == 0
    lines = (tmp_path / "turns").read_text("ascii").split()
    turns = ["timed", "timed", "programs", "programs", "busy", "busy"]
    assert lines[:6] == turns


@pytest.mark.system
@pytest.mark.parametrize("serial", ["", "1"], ids=["together", "in turn"])
@pytest.mark.parametrize("mark", ["programs", "busy", "slow"])
def test_a_test_that_fails_once_fails_the_run_and_is_not_repeated(
    tmp_path: Path, mark: str, serial: str
) -> None:
    tests = {"test_once.py": FAILS_ONCE.format(mark=mark), "test_sound.py": SOUND}
    status, output = run_in(tmp_path, tests, TEST_SERIAL=serial)
    assert status == 1
    assert output.count("FAILED test_once.py::test_fails_once") == 1
    assert f"failed: {'timed' if mark == 'slow' else mark} (1)" in output


@pytest.mark.system
@pytest.mark.parametrize(("withheld_s", "status"), [(1.0, 0), (110.0, 1)])
def test_a_run_with_too_much_withheld_time_fails_and_says_so(
    tmp_path: Path, withheld_s: float, status: int
) -> None:
    conftest = STARVED.format(root=str(ROOT), withheld_s=withheld_s)
    found, output = run_in(tmp_path, {"test_sound.py": SOUND, "conftest.py": conftest})
    assert found == status
    assert f"withheld from robot: {withheld_s:.2f} s of {withheld_s + 30.0:.2f} s" in output
    assert ("repeat the run with less other load" in output) == (status == 1)
