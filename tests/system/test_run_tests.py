"""`scripts/run_tests` says how many tests it ran again, and which: none goes unnoticed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SETTINGS = "[pytest]\nmarkers =\n    timed\n    busy\n    slow\n"
SOUND = "import pytest\n\n@pytest.mark.timed\ndef test_sound(): pass\n\ndef test_sum(): pass\n"
FAILS_ONCE = """
import pathlib, pytest

@pytest.mark.timed
@pytest.mark.{mark}
@pytest.mark.parametrize("which", ["a", "b"])
def test_fails_once(which):
    been = pathlib.Path("{mark}-" + which)
    first = not been.exists()
    been.touch()
    assert not first
"""


def run_in(folder: Path, tests: dict[str, str]) -> tuple[int, list[str]]:
    """Return the exit status and the lines of a run over a project of its own."""
    (folder / "pytest.ini").write_text(SETTINGS, "ascii")
    for name, text in tests.items():
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
        # Plugins take most of the start of each of these runs, and these tests need none.
        env=os.environ | {"TEST_PRIORITIES": "same", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        timeout=100,
    )
    return done.returncode, done.stdout.splitlines()


@pytest.mark.system
def test_a_run_in_which_all_passes_says_that_none_was_run_again(tmp_path: Path) -> None:
    status, lines = run_in(tmp_path, {"test_sound.py": SOUND})
    assert (status, lines[-1]) == (0, "run again: 0")


@pytest.mark.system
def test_tests_that_pass_only_alone_are_counted_and_named(tmp_path: Path) -> None:
    tests = {f"test_{mark}.py": FAILS_ONCE.format(mark=mark) for mark in ("timed", "busy")}
    status, lines = run_in(tmp_path, {**tests, "test_sound.py": SOUND})
    names = [f"test_{mark}.py::test_fails_once[{w}]" for mark in ("timed", "busy") for w in "ab"]
    assert (status, lines[-1]) == (0, f"run again: 4 ({', '.join(names)})")


@pytest.mark.system
def test_a_test_that_fails_again_fails_the_run_and_is_named(tmp_path: Path) -> None:
    fails = "import pytest\n\n@pytest.mark.timed\ndef test_wrong(): assert False\n"
    status, lines = run_in(tmp_path, {"test_wrong.py": fails, "test_sound.py": SOUND})
    assert (status, lines[-1]) == (1, "run again: 1 (test_wrong.py::test_wrong)")
