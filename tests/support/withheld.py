"""Withheld time: for how long threads were ready to run, and the machine ran something else.

Linux counts it for each thread (`/proc/<pid>/task/<tid>/schedstat`, second field). A thread that
sleeps, waits for a lock or for the interpreter, or is stopped by a signal is not ready to run: what
a program does wrong is never withheld time, so a real-time test may add it to its bounds.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

_REPEATS, _FREE_REPEATS = 0.2, 10
"""Fraction of the inputs to pages that may be given again, and a number that always may."""
_RAN, _WITHHELD = 0, 1
"""Counts of a thread."""
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_STOLEN = 8
"""Field of `/proc/stat` with the time that a hypervisor gave to other machines."""


class WithheldTime:
    """Withheld time of processes, with their children, and of the whole virtual machine.

    The sum over all threads: what a chain of threads does late is late by no more than that.
    """

    def __init__(self, *pids: int) -> None:
        """Measure these processes; without any, this one alone, without its children."""
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
        """Withheld time since it was made, until now or the end of its context."""
        if self._total_s is not None:
            return self._total_s
        return self._since_start_s(_WITHHELD) + _stolen_s() - self._stolen_s

    @property
    def ran_s(self) -> float:
        """Processor time since it was made, until now."""
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
    """Time that passes, less what is withheld from processes; without any, from this one."""

    def __init__(self, *pids: int) -> None:
        """Start."""
        self._withheld = WithheldTime(*pids)
        self._began_s = time.monotonic()

    @property
    def took_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._began_s - self._withheld.total_s


class Pauses:
    """Longest pause between events of processes, less what was withheld from them in that pause.

    Withheld time counts from the event before the pause, which may have been known late.
    """

    def __init__(self, *pids: int) -> None:
        """Watch these processes; without any, this one."""
        self._withheld = WithheldTime(*pids)
        self._last_s: float | None = None
        self._counts_s = deque([0.0], maxlen=2)
        self.longest_s = 0.0
        self.on_the_clock_s = 0.0
        """Longest with all that was withheld."""

    def note(self, at_s: float) -> None:
        """Note an event at a time, as soon as it is known."""
        withheld_s = self._withheld.total_s
        if self._last_s is not None:
            pause_s, in_it_s = at_s - self._last_s, withheld_s - self._counts_s[0]
            self.longest_s = max(self.longest_s, pause_s - in_it_s)
            self.on_the_clock_s = max(self.on_the_clock_s, pause_s)
        self._last_s = at_s
        self._counts_s.append(withheld_s)


@dataclass
class Tally:
    """Withheld and processor times of all processes of a kind in a run."""

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
    """Withheld time of each kind of process under test, and how much of it a run may have."""

    limit: float
    """Largest fraction of the time in which threads ran or were ready to run. Threads that wait for
    something else, as most do, change nothing in it."""
    free_s: float
    """Withheld time that no run fails for, however short it is."""
    tallies: dict[str, Tally] = field(default_factory=dict[str, Tally])
    inputs: int = 0
    """Inputs to pages that a test gives as often as a person would."""
    repeated: list[str] = field(default_factory=list[str])
    """Those that were given again, as the page had stalled."""

    def tries(self, what: str, count: int, *, free: int = 1) -> Iterator[int]:
        """Number attempts at an input to a page, and count those after the first, or `free`."""
        self.inputs += 1
        for attempt in range(count):
            if attempt >= free:
                self.repeated.append(what)
            yield attempt

    def follow(self, name: str, *pids: int) -> Followed:
        """Return the entry of a process that runs now; without a pid, of this one."""
        return Followed(self.tallies.setdefault(name, Tally()), WithheldTime(*pids))

    @property
    def excess(self) -> str:
        """Why the run cannot count, or nothing."""
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
        """Describe each kind of process, that with the most withheld time first, and inputs."""
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
    """Entry of one process in a budget."""

    def __init__(self, tally: Tally, withheld: WithheldTime) -> None:
        self._tally: Tally | None = tally
        self._withheld = withheld

    def end(self) -> None:
        """Count the process, once; call it just before the process ends."""
        tally, self._tally = self._tally, None
        if tally is not None:
            tally.add(self._withheld.total_s, self._withheld.ran_s)


IN_PROCESS = "robots, dashboards and operators in the process of the tests"
"""Kind of process in a budget."""
budget = Budget(limit=float(os.environ.get("TEST_WITHHELD_LIMIT", "0.75")), free_s=5.0)
"""Budget of this run: a quarter of what robots and dashboards want is too little to judge them by.
Next to three programs that compute on two processors they miss 75 to 80 %, with priorities 15 %."""


def family(pid: int) -> Iterator[int]:
    """Yield a process, its living children and theirs."""
    yield pid
    try:
        tasks = [int(task.name) for task in Path(f"/proc/{pid}/task").iterdir()]
        texts = [Path(f"/proc/{pid}/task/{tid}/children").read_text("ascii") for tid in tasks]
    except OSError:
        return
    for child in " ".join(texts).split():
        yield from family(int(child))


def _threads_s(pid: int) -> dict[int, tuple[float, float]]:
    """Times of each thread since its start: it ran, it was withheld; none of an ended process."""
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
"""Starts a command in real time, like a robot's on a dedicated machine."""
AS_OTHERS = ["chrt", "--other", "0"] if REALTIME else []
"""Starts a command with normal priority. Otherwise it would inherit the priority of a test in real
time, and delay robots by its computations."""

ROBOT, TEST = 3, 2
"""Priorities in real time: what has little to do and must do it soon comes first."""
_HEAVY, _HEAVY_NICENESS = (b"tsd_dashboard",), -12
"""Programs that may take most of a processor for a second, for example to draw meshes. In real time
they would hold up all robots: Linux withholds the processor from real-time processes for 50 ms once
they have used 950 ms of a second, and servos that are silent for 50 ms are a fault. A board in its
simulator takes most of a processor, too, but is a robot; one test at a time has one."""


def to_realtime(pid: int) -> None:
    """Let all threads of a process run in real time, or ahead of others in a heavy program."""
    with contextlib.suppress(OSError):  # A thread may have ended.
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        heavy = any(name in command for name in _HEAVY)
        for task in Path(f"/proc/{pid}/task").iterdir():
            if heavy:
                os.setpriority(os.PRIO_PROCESS, int(task.name), _HEAVY_NICENESS)
            else:
                os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(ROBOT))


def this_thread_is_a_robot() -> None:
    """Let this thread run before what tests and their programs compute in real time."""
    if REALTIME:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(ROBOT))


def own_threads_to_realtime() -> None:
    """Let the threads that this process has now run in real time, but none of its children."""
    if not REALTIME:
        return
    with contextlib.suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(int(task.name), policy, os.sched_param(TEST))
