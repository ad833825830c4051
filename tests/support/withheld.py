"""Withheld processor time, and priorities of the processes under test.

Time is withheld from a thread while it is ready to run and the machine runs something else. Linux
counts this time per thread (`/proc/<pid>/task/<tid>/schedstat`, second field). A thread that
sleeps, waits for a lock or for the interpreter, or is stopped by a signal is not ready to run.
Faults of a program are therefore never withheld time, and a real-time test may add withheld time to
its bounds.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

PATIENCE_S = 1200.0
"""Limit of a wait that usually takes milliseconds: the longest time of a test on the clock.

The time limit of the test (`tests/time_limits.py`), which excludes withheld time, ends a wait in
vain. A shorter limit on the clock would fail on a loaded machine.
"""
T = TypeVar("T")
_RECHECK_S = 0.1
_REPEATS, _FREE_REPEATS = 0.2, 10
"""Fraction of page inputs that may be repeated, and a number that is always allowed."""
_RAN, _WITHHELD = 0, 1
"""Counts of a thread."""
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_STOLEN = 8
"""Field of `/proc/stat` with the time that a hypervisor gave to other machines."""


def wait_for(news: threading.Condition, condition: Callable[[], T]) -> T:
    """Wait until a condition holds, and return its last value; the caller holds `news`.

    News of what changed may be missing, so the condition is also checked from time to time.
    """
    end_s = time.monotonic() + PATIENCE_S
    while not (value := news.wait_for(condition, _RECHECK_S)) and time.monotonic() < end_s:
        pass
    return value


class WithheldTime:
    """Withheld time of processes, with their children, and of the whole virtual machine.

    The sum over all threads is an upper bound for the delay of a chain of threads.
    """

    def __init__(self, *pids: int) -> None:
        """Measure these processes, by default only this one without its children."""
        self._pids = pids
        self._stolen_s = _stolen_s()
        self._began = self._read()
        self._newest = dict(self._began)
        self._total_s: float | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._total_s = self.total_s
        if error is not None:
            error.add_note(f"The machine withheld {self._total_s:.3f} s.")

    @property
    def total_s(self) -> float:
        """Withheld time since creation, until now or the end of the context."""
        if self._total_s is not None:
            return self._total_s
        return self._since_start_s(_WITHHELD) + _stolen_s() - self._stolen_s

    @property
    def ran_s(self) -> float:
        """Processor time since creation."""
        return self._since_start_s(_RAN)

    def _since_start_s(self, count: int) -> float:
        self._newest.update(self._read())  # A thread that has ended keeps its last counts.
        none = (0.0, 0.0)
        return sum(
            each[count] - self._began.get(tid, none)[count] for tid, each in self._newest.items()
        )

    def _read(self) -> dict[int, tuple[float, float]]:
        if not self._pids:
            return _threads_s(os.getpid())
        pids = (pid for each in self._pids for pid in family(each))
        return {tid: each for pid in pids for tid, each in _threads_s(pid).items()}


class Stopwatch:
    """Elapsed time, less the withheld time of processes, by default of this one."""

    def __init__(self, *pids: int) -> None:
        """Start."""
        self._withheld = WithheldTime(*pids)
        self._began_s = time.monotonic()

    @property
    def took_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._began_s - self._withheld.total_s


class Pauses:
    """Longest pause between events of processes, less the time withheld in that pause.

    Withheld time counts from the event before the pause, which may be observed late.
    """

    def __init__(self, *pids: int) -> None:
        """Watch these processes, by default this one."""
        self._withheld = WithheldTime(*pids)
        self._last_s: float | None = None
        self._counts_s = deque([0.0], maxlen=2)
        self.longest_s = 0.0
        self.on_the_clock_s = 0.0
        """Longest pause with the withheld time included."""

    def note(self, at_s: float) -> None:
        """Record the time of an event at once."""
        withheld_s = self._withheld.total_s
        if self._last_s is not None:
            pause_s, in_it_s = at_s - self._last_s, withheld_s - self._counts_s[0]
            self.longest_s = max(self.longest_s, pause_s - in_it_s)
            self.on_the_clock_s = max(self.on_the_clock_s, pause_s)
        self._last_s = at_s
        self._counts_s.append(withheld_s)


@dataclass
class Tally:
    """Withheld and processor times of all processes of one kind in a run."""

    withheld_s: float = 0.0
    ran_s: float = 0.0
    count: int = 0

    def add(self, withheld_s: float, ran_s: float) -> None:
        """Add one process."""
        self.withheld_s += withheld_s
        self.ran_s += ran_s
        self.count += 1


@dataclass
class Budget:
    """Withheld time of each kind of process under test, and its limit for a run."""

    limit: float
    """Largest fraction of the time in which threads ran or were ready to run. Threads that wait for
    something else, as most do, change nothing in it."""
    free_s: float
    """Withheld time that is allowed in every run."""
    tallies: dict[str, Tally] = field(default_factory=dict[str, Tally])
    inputs: int = 0
    """Number of page inputs."""
    repeated: list[str] = field(default_factory=list[str])
    """Number of repeated inputs, after a page had stalled."""
    _running: set[int] = field(default_factory=set[int])
    """Process ids of the programs under test."""

    def tries(self, what: str, count: int, *, free: int = 1) -> Iterator[int]:
        """Number the attempts at a page input; count those after the first `free` ones."""
        self.inputs += 1
        for attempt in range(count):
            if attempt >= free:
                self.repeated.append(what)
            yield attempt

    def follow(self, name: str, *pids: int) -> Followed:
        """Return the entry of a running process, by default of this one."""
        self._running.update(pids)
        return Followed(self.tallies.setdefault(name, Tally()), WithheldTime(*pids))

    def watch(self) -> WithheldTime:
        """Start measuring this process and all programs under test that run now."""
        self._running = {pid for pid in self._running if Path(f"/proc/{pid}").exists()}
        return WithheldTime(os.getpid(), *self._running)

    @property
    def excess(self) -> str:
        """Reason why the run is invalid, or empty."""
        allowed = max(_FREE_REPEATS, _REPEATS * self.inputs)
        if len(self.repeated) > allowed:
            return (
                f"{len(self.repeated)} inputs to pages were given again, more than {allowed:.0f}: "
                "if the machine is not overloaded, pages lose inputs"
            )
        withheld_s = sum(each.withheld_s for each in self.tallies.values())
        wanted_s = withheld_s + sum(each.ran_s for each in self.tallies.values())
        allowed_s = max(self.free_s, self.limit * wanted_s)
        if withheld_s <= allowed_s:
            return ""
        return (
            f"the machine withheld {withheld_s:.1f} s from processes under test, more than "
            f"{allowed_s:.1f} s: repeat the run with less other load, or allow a larger fraction "
            f"of the time that they wanted than TEST_WITHHELD_LIMIT={self.limit:g}"
        )

    def lines(self) -> Iterator[str]:
        """Describe inputs and each kind of process, most withheld time first."""
        for name, it in sorted(self.tallies.items(), key=lambda item: -item[1].withheld_s):
            wanted_s = it.withheld_s + it.ran_s
            share = it.withheld_s / wanted_s if wanted_s else 0.0
            figures = f"{it.withheld_s:.2f} s of {wanted_s:.2f} s ({share:.0%}, {it.count}x)"
            yield f"withheld from {name}: {figures}"
        if self.inputs:
            again = ", ".join(f"{what} ({n}x)" for what, n in Counter(self.repeated).items())
            figures = f"{len(self.repeated)} of {self.inputs}" + (f": {again}" if again else "")
            yield f"inputs to pages given again: {figures}"


class Followed:
    """Budget entry of a process."""

    def __init__(self, tally: Tally, withheld: WithheldTime) -> None:
        self._tally: Tally | None = tally
        self._withheld = withheld

    def end(self) -> None:
        """Count the process once; call this just before it ends."""
        tally, self._tally = self._tally, None
        if tally is not None:
            tally.add(self._withheld.total_s, self._withheld.ran_s)


IN_PROCESS = "robots, dashboards and operators in the process of the tests"
"""Kind of process in a budget."""
budget = Budget(limit=float(os.environ.get("TEST_WITHHELD_LIMIT", "0.75")), free_s=5.0)
"""Budget of this run.

Robots and dashboards with a quarter of the time that they need cannot be judged. Next to three
computing programs on two processors they miss 75 to 80 %, with priorities 15 %.
"""


def family(pid: int) -> Iterator[int]:
    """Yield a process and its living descendants."""
    yield pid
    try:
        tasks = [int(task.name) for task in Path(f"/proc/{pid}/task").iterdir()]
        texts = [Path(f"/proc/{pid}/task/{tid}/children").read_text("ascii") for tid in tasks]
    except OSError:
        return
    for child in " ".join(texts).split():
        yield from family(int(child))


def _threads_s(pid: int) -> dict[int, tuple[float, float]]:
    """Return running and withheld times of each thread; empty if the process ended."""
    found: dict[int, tuple[float, float]] = {}
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
    except OSError:
        return found
    for task in tasks:
        with contextlib.suppress(OSError):  # It may have ended since.
            ran, withheld, _slices = (task / "schedstat").read_bytes().split()
            found[int(task.name)] = int(ran) * 1e-9, int(withheld) * 1e-9
    return found


def _stolen_s() -> float:
    return int(Path("/proc/stat").read_text("ascii").split(maxsplit=9)[_STOLEN]) * _TICK_S


REALTIME = os.environ.get("TEST_REALTIME", "").split()
"""Command prefix for real-time priority, as on a dedicated robot computer."""
AS_OTHERS = ["chrt", "--other", "0"] if REALTIME else []
"""Command prefix for normal priority. Without it, a command inherits the real-time priority of a
test and delays robots."""

ROBOT, TEST = 3, 2
"""Real-time priorities; short, urgent work has the higher one."""
_HEAVY, _HEAVY_NICENESS = (b"tsd_dashboard",), -12
"""Programs that may take most of a processor for a second, for example to load meshes. With
real-time priority they would delay all robots: Linux withholds the processor from real-time
processes for 50 ms after 950 ms of a second, and servos that are silent for 50 ms are a fault.
Simulated boards also take most of a processor, but are robots; only one test at a time runs one.
"""


def to_realtime(pid: int) -> None:
    """Give all threads of a process real-time priority, or a heavy program a lower niceness."""
    with contextlib.suppress(OSError):  # A thread may have ended.
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        heavy = any(name in command for name in _HEAVY)
        for task in Path(f"/proc/{pid}/task").iterdir():
            if heavy:
                os.setpriority(os.PRIO_PROCESS, int(task.name), _HEAVY_NICENESS)
            else:
                os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(ROBOT))


def this_thread_is_a_robot() -> None:
    """Give this thread priority over real-time tests and their programs."""
    if REALTIME:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(ROBOT))


def own_threads_to_realtime() -> None:
    """Give the current threads of this process real-time priority, but not its children."""
    if not REALTIME:
        return
    with contextlib.suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(int(task.name), policy, os.sched_param(TEST))
