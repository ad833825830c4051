"""Runs programs as a user starts them."""

from __future__ import annotations

import contextlib
import itertools
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

from tests.support.browser import CHEAP_FLAGS, executable
from tests.support.priorities import AS_OTHERS, REALTIME, to_realtime
from tests.support.withheld import Followed, budget
from tsd_twin.adapters.cmd_vel import PAUSE_S

PATIENCE_S = 60.0


def longest_pause_s(times_s: Iterable[float], since_s: float) -> float:
    """Return the longest gap between events from `since_s` until now."""
    within = [since_s, *(each for each in times_s if each > since_s), time.monotonic()]
    return max(after - before for before, after in itertools.pairwise(within))


def stays_put(moved_m: float, pushed_s: Iterable[float], since_s: float, withheld_s: float) -> None:
    """Check that a stick held since before did not move the robot.

    If the machine delayed the pushes by more than `PAUSE_S`, the robot counts the stick as
    released, and later pushes may move it.
    """
    pause_s = longest_pause_s(pushed_s, since_s)
    assert pause_s < PAUSE_S + withheld_s, "the stick was let go"
    assert moved_m < 0.01 or pause_s >= PAUSE_S


class Program:
    """Running program of this package."""

    def __init__(self, arguments: list[str]) -> None:
        # A program that prints a `ready:` line loads without real-time priority, because a second
        # of real-time load would starve robots that are driving.
        self._loads = REALTIME and arguments[0] != "tsd_lab"
        priority = AS_OTHERS if self._loads else REALTIME
        self.process = subprocess.Popen(
            [*priority, sys.executable, "-m", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.output: list[str] = []
        self.errors: list[str] = []
        self._name = arguments[0]
        self._followed: Followed | None = None
        self._ready = threading.Event()
        self._threads = [
            threading.Thread(target=self._read, args=(self.process.stdout, self.output)),
            threading.Thread(target=self._read, args=(self.process.stderr, self.errors)),
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, stream: Iterable[str], into: list[str]) -> None:
        for line in stream:
            into.append(line.rstrip("\n"))
            if line.startswith("ready:"):
                if self._loads:
                    family_to_realtime(self.process.pid)
                self._followed = budget.follow(self._name, self.process.pid)
                self._ready.set()
        self._ready.set()

    def ready(self) -> str:
        """Return the `ready:` line."""
        assert self._ready.wait(PATIENCE_S), f"not ready: {self.output} {self.errors}"
        lines = [line for line in self.output if line.startswith("ready:")]
        assert lines, f"ended before it was ready: {self.output} {self.errors}"
        return lines[0]

    def end(self, signal_number: int = signal.SIGINT) -> int:
        """Signal, wait, and return the exit code."""
        self._count()
        self.process.send_signal(signal_number)
        return self.wait()

    def wait(self) -> int:
        """Wait for the end and return the exit code."""
        code = self.process.wait(PATIENCE_S)
        for thread in self._threads:
            thread.join(PATIENCE_S)
        return code

    def _count(self) -> None:
        """Charge the CPU time withheld from this program to the budget."""
        if self._followed is not None:
            self._followed.end()

    @property
    def sentence(self) -> str:
        """Output on standard error so far."""
        return "\n".join(self.errors)

    def clean_up(self) -> None:
        """End the process and close its pipes."""
        self._count()
        if self.process.poll() is None:
            self.process.kill()
        self.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@contextlib.contextmanager
def starting() -> Generator[Callable[..., Program]]:
    """Start programs, and end them in reverse order on exit."""
    started: list[Program] = []

    def start(*arguments: str) -> Program:
        started.append(Program(list(arguments)))
        return started[-1]

    try:
        yield start
    finally:
        for program in reversed(started):
            program.clean_up()


@pytest.fixture
def start() -> Generator[Callable[..., Program]]:
    """Start programs that end with the test."""
    with starting() as start_one:
        yield start_one


@pytest.fixture(scope="module")
def start_shared() -> Generator[Callable[..., Program]]:
    """Start programs that the tests of a module share."""
    with starting() as start_one:
        yield start_one


def children_of(pid: int) -> list[int]:
    """Return the pids of the living children of a process."""
    found: list[int] = []
    for folder in Path("/proc").glob("[0-9]*"):
        fields = stat_of(int(folder.name))
        if fields is not None and int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(folder.name))
    return found


def alive(pid: int) -> bool:
    """Return whether a process exists and is not a zombie."""
    fields = stat_of(pid)
    return fields is not None and fields[0] != "Z"


def family_to_realtime(pid: int) -> None:
    """Give a process and its descendants real-time priority, as on a dedicated robot computer."""
    for child in children_of(pid):
        family_to_realtime(child)
    to_realtime(pid)


def stat_of(pid: int) -> list[str] | None:
    """Return the fields of `/proc/<pid>/stat` from the state on, or None if the process is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None


@pytest.fixture(scope="module")
def browser(request: pytest.FixtureRequest) -> Generator[Browser]:
    """Headless browser that renders the scene; tests may override the flags."""
    flags = list(getattr(request, "param", CHEAP_FLAGS))
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=executable(), args=flags)
        yield running
        running.close()
