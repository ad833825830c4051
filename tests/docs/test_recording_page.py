"""Scripts in docs/recording.md run on a recording, and the flags of its commands exist."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

import tsd_twin
from tests.support.markdown_pages import code, page, quoted, section, tables
from tests.support.programs import Program, drive
from tests.support.robot_node import patient_robot
from tests.support.withheld import PATIENCE_S

PAGE = page("recording.md")
SCRIPTS = code(PAGE, "python")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """A folder with `run.mcap`, a recording of a drive and a stop."""
    folder = tmp_path_factory.mktemp("page")
    programs = [Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0", *patient_robot()])]
    try:
        endpoint = programs[0].ready().split()[-1]
        programs.append(Program(["tsd_record", "--connect", endpoint, "--dir", str(folder)]))
        path = Path(programs[1].ready().split()[-1])
        end_s = time.monotonic() + PATIENCE_S
        while path.stat().st_size < 3000:
            assert time.monotonic() < end_s
            time.sleep(0.05)
        drive(endpoint, vx_mps=0.3, duration_s=0.3)
        programs[1].end()
        path.rename(folder / "run.mcap")
        yield folder
    finally:
        for program in programs:
            program.clean_up()


@pytest.mark.system
@pytest.mark.parametrize("number", range(len(SCRIPTS)))
def test_every_script_runs_and_prints(number: int, recorded: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPTS[number]],
        cwd=recorded,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) > 3


@pytest.mark.system
def test_the_topics_of_the_table_are_those_of_a_file(recorded: Path) -> None:
    (rows,) = tables(section(PAGE, "## What is in a file"))
    shown: list[str] = []
    for row in rows:
        names = [name.removeprefix("twin/<robot>/") for name in quoted(row[0])]
        shown += ["(.+)" if name == "<key>" else name.replace("*", "[^/]+") for name in names]
    patterns = [name.replace("<key>", ".+") for name in shown]
    topics = tsd_twin.open_recording(recorded / "run.mcap").topics
    below = [topic.removeprefix("twin/tsd/") for topic in topics]
    assert [t for t in below if not any(re.fullmatch(p, t) for p in patterns)] == []
    for needed in ("requests", "desc", "alive", "log/inputs", "cmd/script/twist/raw"):
        assert needed in below


@pytest.mark.system
@pytest.mark.parametrize("name", ["tsd-demo", "tsd-record", "tsd-replay", "tsd-lab"])
def test_the_flags_of_the_page_are_those_of_the_programs(name: str) -> None:
    used = {
        flag
        for line in re.findall(rf"^{name}[^#\n]*", "\n".join(code(PAGE, "sh")), re.MULTILINE)
        for flag in re.findall(r"--[a-z-]+", line)
    }
    command = {"tsd-record": ["tsd-record", "export"], "tsd-lab": ["tsd-lab", "rerun"]}
    helps = ""
    for words in ([name], command.get(name, [name])):
        module = words[0].replace("-", "_")
        ran = subprocess.run(
            [sys.executable, "-m", module, *words[1:], "--help"], capture_output=True, text=True
        )
        helps += ran.stdout
    assert [flag for flag in used if flag not in helps] == []
