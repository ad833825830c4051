"""Priorities of processes under test, where the run of all tests asks for real time."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

REALTIME = os.environ.get("TEST_REALTIME", "").split()
"""Starts a command in real time, as that of a robot on a machine of its own."""
AS_OTHERS = ["chrt", "--other", "0"] if REALTIME else []
"""Starts a command like those of others: tests in real time would pass their priority on, and what
only computes would hold up robots."""

ROBOT, TEST = 3, 2
"""Priorities in real time: what has little to do and must do it soon comes first."""
HEAVY = {"firmware.simulator", "tsd_dashboard", "tsd_demo"}
"""Programs that may take most of a processor. Two of one priority in real time would hold up each
other for 0.1 s, and robots that have a lower one for longer."""


def to_realtime(pid: int) -> None:
    """Let all threads of a process run in real time, as on a machine of its own."""
    with contextlib.suppress(OSError):  # A thread may have ended.
        for task in Path(f"/proc/{pid}/task").iterdir():
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
