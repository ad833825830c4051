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

ROBOT, TEST, HEAVY = 3, 2, 1
"""Priorities in real time: what has little to do and must do it soon comes first."""
_HEAVY = (b"tsd_dashboard",)
"""Programs that may take most of a processor, and must not starve robots of other tests. A board in
its simulator takes most of one, too, but is a robot: its computer takes 0.1 s of silence for a
fault, and one test at a time has one."""


def to_realtime(pid: int) -> None:
    """Let all threads of a process run in real time, as on a machine of its own."""
    with contextlib.suppress(OSError):  # A thread may have ended.
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        priority = HEAVY if any(name in command for name in _HEAVY) else ROBOT
        for task in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(priority))


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
