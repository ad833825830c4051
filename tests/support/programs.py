"""Programs of the package and scripts, started as by a user.

`python -m tests.support.programs FILE [FLAGS]` runs `tsd-mock` and writes its true motion to a
file, because a robot behind a router cannot be observed while the router is down.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

import tsd_mock
import tsd_twin
from tests.support.robot_node import patient_robot
from tests.support.withheld import AS_OTHERS, PATIENCE_S, REALTIME, Followed, budget, to_realtime
from tsd_twin.lie import SE2, Array
from tsd_twin.simulation import BoardModel


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


def recording_readers() -> set[int]:
    """Return the pids of the processes that read recordings for this one."""
    starters = [
        pid
        for pid in children_of(os.getpid())
        if b"tsd_twin.recording.reader_process" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    return {reader for pid in starters for reader in children_of(pid)}


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


@contextmanager
def mock_robot(*, shipped: bool = False) -> Generator[Program]:
    """Run `tsd-mock` for scripts; unless `shipped`, delays do not stop the robot."""
    flags = [] if shipped else patient_robot()
    mock = Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0", *flags])
    try:
        mock.ready()
        yield mock
    finally:
        mock.end()
        mock.clean_up()


def run_script(script: Path, folder: Path, *arguments: str) -> str:
    """Run a script with `folder` as its working directory; return its output."""
    done = subprocess.run(
        [sys.executable, str(script), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return done.stdout


def drive(
    endpoint: str,
    *,
    vx_mps: float,
    vy_mps: float = 0.0,
    omega_rad_per_s: float = 0.0,
    duration_s: float,
    operator: str = "script",
) -> None:
    """Drive a robot for a time."""
    with tsd_twin.connect(endpoint) as robot, robot.control(operator) as base:
        base.drive(
            vx_mps=vx_mps,
            vy_mps=vy_mps,
            omega_rad_per_s=omega_rad_per_s,
            duration_s=duration_s,
        )


class TracedBoard(BoardModel):
    """Simulated board that writes a line for each setpoint: time, x, y, largest speed, robot.

    Robots in a process are numbered in the order of their first setpoints.
    """

    file: TextIO
    _numbers = itertools.count()
    _number: int | None = None

    def write(self, setpoint: Array, now_s: float) -> None:
        super().write(setpoint, now_s)
        truth = self.truth(now_s)
        assert isinstance(truth.pose, SE2)
        x, y = truth.pose.xy_heading[:2]
        if self._number is None:
            self._number = next(self._numbers)
        self.file.write(f"{now_s} {x} {y} {np.abs(truth.twist).max()} {self._number}\n")
        self.file.flush()


def follow_trace(file: Path, ended: threading.Event) -> Iterator[tuple[float, ...]]:
    """Yield new lines of a trace until an event is set."""
    with file.open(encoding="ascii") as lines:
        text = ""
        while not ended.is_set():
            text += lines.readline()
            if not text.endswith("\n"):
                time.sleep(0.005)
                continue
            yield tuple(map(float, text.split()))
            text = ""


if __name__ == "__main__":
    with Path(sys.argv.pop(1)).open("w", encoding="ascii") as TracedBoard.file:
        tsd_mock.BoardModel = TracedBoard
        tsd_mock.main()
