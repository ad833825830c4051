"""`tsd-lab` as a user runs it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.app.mistaken_programs import start_each
from tests.support.bus_operator import BusOperator
from tests.support.experiment_runs import is_picture
from tests.support.programs import Program
from tests.support.robot_node import running
from tsd_lab import EXPERIMENTS

pytestmark = pytest.mark.system

Start = Callable[..., Program]


def test_it_prints_figures_and_says_where_the_files_are(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "lab"
    lab = start("tsd_lab", "motors", "--out", str(folder))
    assert lab.wait() == 0
    assert lab.sentence == ""
    assert any("77.65 / -563.3" in line for line in lab.output)
    assert lab.output[-2:] == [f"wrote {folder / 'motors.csv'}", f"wrote {folder / 'motors.png'}"]
    assert is_picture(folder / "motors.png")


def test_help_lists_all_experiments_and_each_has_examples(tmp_path: Path) -> None:
    names = [experiment.name for experiment in EXPERIMENTS]
    lists, *each = start_each(
        "tsd_lab", [["--help"], *([name, "--help"] for name in names)], tmp_path
    )
    assert lists.code == 0
    for name, shown in zip(names, each, strict=True):
        assert any(line.strip().startswith(name) for line in lists.printed.splitlines())
        assert shown.code == 0
        assert any(line.startswith(f"  tsd-lab {name}") for line in shown.printed.splitlines())


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_zeroing_that_is_interrupted_leaves_the_robot_disarmed_and_free(
    start: Start, tmp_path: Path, sign: signal.Signals
) -> None:
    with running() as node, BusOperator(node) as alice:
        lab = start("tsd_lab", "zero", "--connect", node.endpoint, "--yes", "--out", str(tmp_path))
        alice.wait_for("ready")
        assert lab.end(sign) != 0
        assert "interrupted" in lab.sentence
        alice.wait_for("disarmed")
        alice.wait_until(lambda: alice.status.lease.holder is None)


def test_a_mistake_is_one_sentence(tmp_path: Path) -> None:
    mistakes = [
        (["square", "--robot", "nope"], "tsd-lab: nope: no such robot"),
        (["follow", "--points", "a", "b"], "tsd-lab: a point is two numbers"),
        (["calibrate", "--log", "nope.csv"], "tsd-lab: nope.csv cannot be read as a log"),
        (["zero", "--connect", "nonsense"], "tsd-lab: 'nonsense' is no endpoint: write it as"),
        (["motors", "--out", "/proc/lab"], "tsd-lab: /proc/lab cannot be written to"),
    ]
    ended = start_each("tsd_lab", [flags for flags, _ in mistakes], tmp_path)
    for (flags, sentence), lab in zip(mistakes, ended, strict=True):
        assert lab.code != 0, flags
        assert lab.said.startswith(sentence), flags
        assert lab.said.count("\n") == 1, flags
