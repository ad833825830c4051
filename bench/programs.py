"""Programs as context managers: robots, dashboards and bare peers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any

import psutil

from bench.machine import cpu_s, keep
from tests.support.withheld import Stopwatch


class program:  # noqa: N801  It is used as a function.
    """Process that prints `ready: ... <address>` and ends with its standard input."""

    def __init__(self, command: list[str]) -> None:
        self._command = command

    def __enter__(self) -> str:
        self.process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("ready:"):
                return line.split()[-1]
        raise RuntimeError(f"{' '.join(self._command)} ended before it was ready")

    def __exit__(self, *_: object) -> None:
        keep(self.process.pid)
        try:
            self.process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()

    def cpu_s(self) -> float:
        """Return the CPU time of the process and its children, s."""
        process = psutil.Process(self.process.pid)
        return cpu_s(process.pid, *(each.pid for each in process.children(recursive=True)))

    def load(self, seconds: float) -> float:
        """Return the CPU load over the next `seconds`, in ms of CPU time per second."""
        with Load(self) as load:
            time.sleep(seconds)
        return load.ms_per_s


class counter(program):  # noqa: N801  It is used as a function.
    """Process that counts from one line of its standard input to the next, and prints JSON."""

    def during(self, act: Callable[[], object]) -> dict[str, Any]:
        """Return the counts while `act` runs."""
        self._continue()
        act()
        self._continue()
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def _continue(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()


class Load:
    """CPU load of a program within `with`, in ms of CPU time per second."""

    ms_per_s = 0.0

    def __init__(self, measured: program) -> None:
        self._program = measured

    def __enter__(self) -> Load:
        self._start = time.monotonic(), self._program.cpu_s()
        return self

    def __exit__(self, *_: object) -> None:
        took_s, used_s = time.monotonic() - self._start[0], self._program.cpu_s() - self._start[1]
        self.ms_per_s = 1000.0 * used_s / took_s


class terminated(program):  # noqa: N801  It is used as a function.
    """Process that ends with SIGTERM instead."""

    def __exit__(self, *error: object) -> None:
        self.process.terminate()
        super().__exit__(*error)


@contextmanager
def realtime() -> Generator[None]:
    """Start programs as on machines of their own: in real time, where that is permitted."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def python(name: str, *arguments: str) -> list[str]:
    """Return the command of a module."""
    return [sys.executable, "-m", name, *arguments]


def tool(name: str, *arguments: str) -> program:
    """Return one of our programs, which ends with its standard input."""
    return program([*python(name, *arguments), "--until-eof"])


def mock(*arguments: str) -> program:
    """Return a simulated robot on a free port."""
    return tool("tsd_mock", "--listen", "tcp/127.0.0.1:0", *arguments)


def dashboard(endpoint: str, *arguments: str) -> program:
    """Return a dashboard for the robots at an endpoint."""
    return tool("tsd_dashboard", "--port", "0", "--connect", endpoint, *arguments)


def peer(name: str, *arguments: str) -> program:
    """Return a bare peer of `bench.peers`."""
    return program(python("bench.peers", name, *arguments))


def until(condition: Callable[[], bool], patience_s: float = 20.0) -> None:
    """Wait until a condition holds; time that the machine withholds from all does not count."""
    watch = Stopwatch(os.getpid())
    while not condition():
        if watch.took_s > patience_s:
            raise RuntimeError(f"a condition did not hold within {patience_s:g} s")
        time.sleep(0.02)
