"""Priorities of processes under test, where the run of all tests asks for real time."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

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
