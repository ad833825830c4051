"""Time limits of tests that a loaded machine does not exceed."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path

from tests.support.withheld import WithheldTime, family

LONGEST = 10.0
"""A limit ends after so many times its length on the clock, in any case."""
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_RECHECK_S = 0.5


def computed_s() -> float:
    """Return the processor time of this process and its children, on each processor."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    in_all_s = sum(each.ru_utime + each.ru_stime for each in used)
    children = (pid for pid in family(os.getpid()) if pid != os.getpid())
    in_all_s += sum(_processor_s(pid) for pid in children)
    return in_all_s / len(os.sched_getaffinity(0))


def _processor_s(pid: int) -> float:
    """Processor time of a living process and of its children that have ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return _TICK_S * sum(int(each) for each in fields[11:15])


class TimeLimit:
    """Calls a function once this process has used its time, on the main thread.

    If it `waits`, for real time that passes in it: all but the time that the machine withheld from
    it and its children. Else the processor time of them.
    """

    def __init__(self, limit_s: float, on_end: Callable[[], None], *, waits: bool) -> None:
        self._limit_s, self._on_end = limit_s, on_end
        self._began_s = time.monotonic()
        self._withheld = WithheldTime(os.getpid()) if waits else None
        self._computed_s = computed_s()
        signal.signal(signal.SIGALRM, self._check)
        signal.setitimer(signal.ITIMER_REAL, limit_s)

    def cancel(self) -> None:
        """End it."""
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)

    @property
    def used_s(self) -> float:
        """Time used, and no less than the clock's divided by `LONGEST`."""
        passed_s = time.monotonic() - self._began_s
        if self._withheld is not None:
            used_s = passed_s - self._withheld.total_s
        else:
            used_s = computed_s() - self._computed_s
        return max(used_s, passed_s / LONGEST)

    def _check(self, _signal: int, _frame: object) -> None:
        left_s = self._limit_s - self.used_s
        if left_s > 0.0:
            signal.setitimer(signal.ITIMER_REAL, max(left_s, _RECHECK_S))
        else:
            self._on_end()
