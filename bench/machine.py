"""Speed of the machine, and the time that it withheld from the measured processes."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np
import psutil

_LOOPS, _SIZE = 400_000, 256
_PRESSURE = Path("/proc/pressure/cpu")


def speed_ms() -> dict[str, float]:
    """Return the times of two fixed computations, in pure Python and in numpy, ms of CPU time."""
    matrix = np.random.default_rng(0).normal(size=(_SIZE, _SIZE))
    ones = np.ones(_SIZE)

    def python() -> None:
        total = 0
        for i in range(_LOOPS):
            total += i * i % 7

    def array() -> None:
        for _ in range(200):
            np.dot(np.sin(matrix), ones)

    return {"python_ms": _median_ms(python), "numpy_ms": _median_ms(array)}


def _median_ms(compute: Callable[[], None]) -> float:
    times_s: list[float] = []
    for _ in range(5):
        start_s = time.thread_time()
        compute()
        times_s.append(time.thread_time() - start_s)
    return 1000.0 * statistics.median(times_s)


class Withheld:
    """Fraction of the time ready to run that other processes withheld from this one's tree.

    The run delay of all threads in `/proc/*/task/*/schedstat` is the time that they waited for a
    core. Part of it is caused by the measured processes themselves, so it counts in proportion to
    the CPU time that others used, including time stolen from a virtual machine. Use it as a context
    manager and read `fraction` afterwards.
    """

    fraction = 0.0

    def __enter__(self) -> Self:
        _ENDED.clear()
        self._before, self._busy_s, self._own_s = _threads_ns(), _busy_s(), _own_s()
        return self

    def __exit__(self, *_: object) -> None:
        ran_ns = waited_ns = 0
        for thread, (run_ns, delay_ns) in (_ENDED | _threads_ns()).items():
            before_run_ns, before_delay_ns = self._before.get(thread, (0, 0))
            ran_ns += run_ns - before_run_ns
            waited_ns += delay_ns - before_delay_ns
        busy_s = _busy_s() - self._busy_s
        others = max(0.0, 1.0 - (_own_s() - self._own_s) / busy_s) if busy_s else 0.0
        self.fraction = others * waited_ns / max(ran_ns + waited_ns, 1)


_ENDED: dict[str, tuple[int, int]] = {}
"""CPU time and run delay of threads that ended since the start of the current measurement."""


def keep(pid: int) -> None:
    """Keep the times of a process that is about to end for the current measurement."""
    _ENDED.update(_threads_ns(pid))


def _threads_ns(pid: int | None = None) -> dict[str, tuple[int, int]]:
    """Return CPU time and run delay of all threads of a process and its children, or of this."""
    found: dict[str, tuple[int, int]] = {}
    try:
        first = psutil.Process(pid)
        processes = [first, *first.children(recursive=True)]
    except psutil.NoSuchProcess:
        return found
    for process in processes:
        for task in Path(f"/proc/{process.pid}/task").glob("*"):
            try:
                run_ns, delay_ns, _slices = (task / "schedstat").read_text().split()
            except OSError:  # It has just ended.
                continue
            found[task.name] = int(run_ns), int(delay_ns)
    return found


def _own_s() -> float:
    """Return the CPU time of this process and its children, also of those that ended, s."""
    total_s, ours = 0.0, psutil.Process()
    for process in (ours, *ours.children(recursive=True)):
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total_s += times.user + times.system + times.children_user + times.children_system
    return total_s


def _busy_s() -> float:
    """Return the CPU time of all processes, with the time stolen from a virtual machine, s."""
    times = psutil.cpu_times()
    return times.user + times.nice + times.system + getattr(times, "steal", 0.0)


def pressure_s() -> float:
    """Return the time for which any task of the machine waited for a core since boot, s."""
    if not _PRESSURE.exists():
        return 0.0
    return 1e-6 * int(_PRESSURE.read_text().split("total=")[1].split()[0])


def cpu_s(*pids: int) -> float:
    """Return the CPU time of running processes, s."""
    total_ns = 0
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").glob("*"):
            try:
                total_ns += int((task / "schedstat").read_text().split()[0])
            except OSError:
                continue
    return 1e-9 * total_ns


def description() -> dict[str, float]:
    """Return the number of cores and the times of the fixed computations."""
    return {"cores": float(len(os.sched_getaffinity(0))), **speed_ms()}
