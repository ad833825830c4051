"""`--log-file` of every program: details, rotation, and a writer thread for slow disks."""

from __future__ import annotations

import argparse
import importlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from logging.handlers import RotatingFileHandler
from pathlib import Path

import pytest

from tsd_twin.cli import program

pytestmark = pytest.mark.computes
LOG = logging.getLogger("tsd_twin.test")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def run_with(body: Callable[[], object], *flags: str) -> None:
        monkeypatch.setattr("sys.argv", ["tsd-x", *flags])
        made = program.parser("tsd-x", "Nothing.", [])

        def start(args: argparse.Namespace) -> None:
            assert not args.verbose
            body()

        program.run(made, start)

    return run_with


def test_details_are_in_the_file_with_their_time(run: Callable[..., None], tmp_path: Path) -> None:
    file = tmp_path / "robot.log"
    run(lambda: LOG.info("armed by %s", "ann"), "--log-file", str(file))
    run(lambda: LOG.warning("stopped"), "--log-file", str(file))
    first, second = file.read_text().splitlines()
    assert first.startswith("20")
    assert first.endswith(" tsd_twin.test: armed by ann")
    assert second.endswith(" stopped")


def test_old_parts_are_dropped(
    run: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "_LOG_BYTES", 1000)
    file = tmp_path / "robot.log"
    run(lambda: [LOG.info("line %d", i) for i in range(500)], "--log-file", str(file))
    parts = sorted(tmp_path.iterdir())
    assert [part.name for part in parts] == ["robot.log", *(f"robot.log.{i}" for i in range(1, 6))]
    assert max(part.stat().st_size for part in parts) <= 1000
    assert "line 499" in file.read_text()


def test_slow_disk_does_not_delay_the_program(
    run: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()

    def emit(_handler: RotatingFileHandler, _record: logging.LogRecord) -> None:
        free.wait(60.0)

    monkeypatch.setattr(RotatingFileHandler, "emit", emit)
    logged: list[float] = []

    def body() -> None:
        for _ in range(100):
            LOG.info("event")
        logged.append(time.monotonic())
        assert not free.is_set()
        free.set()

    run(body, "--log-file", str(tmp_path / "robot.log"))
    assert logged


def test_file_that_cannot_be_written_is_named(run: Callable[..., None], tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"the log cannot be written: .*missing"):
        run(lambda: None, "--log-file", str(tmp_path / "missing" / "robot.log"))


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return parser._actions  # noqa: SLF001  argparse lists them nowhere else.


def _commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for action in _actions(parser):
        if isinstance(action.choices, dict):  # Subparsers by command.
            for command in action.choices.values():
                yield command
                yield from _commands(command)


@pytest.mark.parametrize("name", ["tsd_camera", "tsd_lab", "tsd_record"])
def test_no_command_has_a_flag_of_its_own_for_what_all_programs_have(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a recording passed to `--log` would be opened and written as a log."""
    made: list[argparse.ArgumentParser] = []
    monkeypatch.setattr(program, "run", lambda parser, _body: made.append(parser))
    importlib.reload(importlib.import_module(name)).main()
    common = {action.dest for action in _actions(program.parser("tsd-x", "Nothing.", []))}
    commands = list(_commands(made[0]))
    assert commands
    for command in commands:
        assert {action.dest for action in _actions(command)} & common == {"help"}, command.prog
