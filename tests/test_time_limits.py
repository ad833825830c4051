"""Time limits exclude time used by other programs on the machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.time_limits import LONGEST, TimeLimit

pytestmark = [pytest.mark.system, pytest.mark.timeout(0)]

LIMIT_S = 0.4
SPIN = "while True: pass"


class ReachedError(Exception):
    """Raised at the limit of a test."""


def reach() -> None:
    raise ReachedError


def test_limit_of_real_time_ends_a_sleep() -> None:
    limit = TimeLimit(LIMIT_S, reach, waits=True)
    began_s = time.monotonic()
    with pytest.raises(ReachedError):
        time.sleep(60.0)
    assert time.monotonic() - began_s >= LIMIT_S
    limit.cancel()


def test_limit_of_processor_time_ends_a_computation_of_a_child() -> None:
    limit = TimeLimit(LIMIT_S, reach, waits=False)
    child = subprocess.Popen([sys.executable, "-c", SPIN])
    try:
        with pytest.raises(ReachedError):
            child.wait(60.0)
        assert limit.used_s >= LIMIT_S
    finally:
        limit.cancel()
        child.kill()
        child.wait()


def test_deadlock_without_processor_time_ends_as_well() -> None:
    limit = TimeLimit(LIMIT_S, reach, waits=False)
    began_s = time.monotonic()
    with pytest.raises(ReachedError):
        time.sleep(60.0)
    assert time.monotonic() - began_s >= 0.9 * LONGEST * LIMIT_S
    limit.cancel()


def test_withheld_time_of_children_is_not_used() -> None:
    """Three processes on one processor together wait twice the elapsed time."""
    cpu = max(os.sched_getaffinity(0))
    command = ["chrt", "--other", "0", sys.executable, "-c", SPIN]
    children = [
        subprocess.Popen(command, preexec_fn=lambda: os.sched_setaffinity(0, {cpu}))
        for _ in range(3)
    ]
    limit = TimeLimit(60.0, reach, waits=True)
    try:
        began_s = time.monotonic()
        time.sleep(2.0 * LIMIT_S)
        assert limit.used_s < 0.5 * (time.monotonic() - began_s)
    finally:
        limit.cancel()
        for child in children:
            child.kill()
            child.wait()


@pytest.mark.parametrize("waits", [True, False])
def test_cancelled_limit_does_nothing(*, waits: bool) -> None:
    limit = TimeLimit(LIMIT_S, reach, waits=waits)
    limit.cancel()
    time.sleep(2.0 * LIMIT_S)
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
