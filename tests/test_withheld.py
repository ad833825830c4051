"""Withheld time is processor time taken by other programs, excluding the program's own waits."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.withheld import ROBOT, Budget, Pauses, Tally, WithheldTime, wait_for

pytestmark = pytest.mark.system

SPIN = "print(flush=True)\nwhile True: pass"
WATCHED_S = 0.5
COMPUTED_S = 0.05


@contextlib.contextmanager
def process(text: str, cpu: int) -> Generator[int]:
    """A program pinned to one processor, after it has printed a line."""
    command = ["chrt", "--other", "0", sys.executable, "-c", text]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, preexec_fn=lambda: os.sched_setaffinity(0, {cpu})
    ) as started:
        try:
            assert started.stdout is not None
            started.stdout.readline()
            yield started.pid
        finally:
            started.kill()


@pytest.fixture
def cpu() -> int:
    return max(os.sched_getaffinity(0))


def ran_s(pid: int) -> float:
    """Processor time of the main thread of a process."""
    return int(Path(f"/proc/{pid}/schedstat").read_text("ascii").split()[0]) * 1e-9


def test_a_competitor_for_the_processor_withholds_half_of_it(cpu: int) -> None:
    with process(SPIN, cpu) as pid, process(SPIN, cpu), WithheldTime(pid) as withheld:
        began_s, before_s = time.monotonic(), ran_s(pid)
        time.sleep(WATCHED_S)
        took_s, used_s = time.monotonic() - began_s, ran_s(pid) - before_s
    # Other programs may add to it; in any case, withheld and used time sum up to the total.
    assert withheld.total_s > 0.4 * took_s
    assert withheld.total_s + used_s == pytest.approx(took_s, abs=0.1 * took_s)


def test_a_budget_watches_the_programs_that_it_follows_and_forgets_those_that_have_ended(
    cpu: int,
) -> None:
    budget = Budget(limit=0.1, free_s=1.0)
    with process(SPIN, cpu) as ended:
        budget.follow("robot", ended)
    with process(SPIN, cpu) as pid, process(SPIN, cpu):
        budget.follow("robot", pid)
        withheld = budget.watch()
        time.sleep(WATCHED_S)
        assert withheld.total_s > 0.3 * WATCHED_S


def test_a_process_that_sleeps_next_to_one_that_spins_misses_next_to_nothing(cpu: int) -> None:
    text = "import time\nprint(flush=True)\ntime.sleep(60)"
    with process(text, cpu) as pid, process(SPIN, cpu):
        before = ""
        while (seen := Path(f"/proc/{pid}/schedstat").read_text("ascii")) != before:
            before = seen  # It has run since, so it does not sleep yet.
            time.sleep(0.2)
        with WithheldTime(pid) as withheld:
            time.sleep(WATCHED_S)
    assert withheld.total_s < 0.1 * WATCHED_S


def test_a_stopped_process_is_not_ready_to_run(cpu: int) -> None:
    """A test that stops a process causes a fault, whose consequences are not excused."""
    with process(SPIN, cpu) as pid:
        os.kill(pid, signal.SIGSTOP)
        os.waitpid(pid, os.WUNTRACED)  # It must run once more to stop.
        with WithheldTime(pid) as withheld, process(SPIN, cpu):
            time.sleep(WATCHED_S)
        assert withheld.total_s < 0.1 * WATCHED_S


@contextlib.contextmanager
def before_all_others() -> Generator[None]:
    """Give this thread and its children priority over all others; skip if not allowed."""
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(ROBOT + 1))
    except PermissionError:
        pytest.skip("needs a processor that nothing else takes")
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, priority)


def test_a_thread_that_waits_for_the_interpreter_is_no_excuse() -> None:
    """Computing threads of a program delay each other without any other load."""
    ended = threading.Event()

    def compute() -> None:
        while not ended.is_set():
            pass

    threads = [threading.Thread(target=compute) for _ in range(2)]
    with before_all_others(), WithheldTime() as together:
        began_s, before_s = time.monotonic(), time.thread_time()
        for thread in threads:
            thread.start()
        while time.thread_time() - before_s < COMPUTED_S:
            pass
        took_s = time.monotonic() - began_s
        ended.set()
        for thread in threads:
            thread.join()
    # Each of three threads had a third of the interpreter, and waited the rest of the time.
    assert took_s > 1.5 * COMPUTED_S
    assert together.total_s < 0.3 * took_s


def test_time_that_a_process_ran_is_counted_beside_what_it_missed(cpu: int) -> None:
    news = threading.Condition()
    with process(SPIN, cpu) as pid, process(SPIN, cpu), news:
        withheld, began_s = WithheldTime(pid), time.monotonic()

        def is_counted() -> bool:
            took_s = time.monotonic() - began_s
            counted_s = withheld.ran_s + withheld.total_s
            return took_s >= WATCHED_S and abs(counted_s - took_s) <= 0.1 * took_s

        assert wait_for(news, is_counted)  # A wait is counted once it has ended.


def test_children_count_and_those_that_have_ended_keep_their_time(cpu: int) -> None:
    text = (
        "import subprocess, sys\n"
        "child = subprocess.Popen([sys.executable, '-c', 'while True: pass'])\n"
        "print(child.pid, flush=True)\nchild.wait()\nprint(flush=True)\ninput()"
    )
    with process(text, cpu) as pid, process(SPIN, cpu), WithheldTime(pid) as withheld:
        time.sleep(WATCHED_S)
        before_s = withheld.total_s
        assert before_s > 0.3 * WATCHED_S
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii")
        os.kill(int(children), signal.SIGKILL)
        time.sleep(0.1)
        assert withheld.total_s >= before_s


def test_a_pause_counts_less_what_was_withheld_in_it(cpu: int) -> None:
    with process(SPIN, cpu) as pid, process(SPIN, cpu):
        competing, alone = Pauses(pid), Pauses()
        for pauses in (competing, alone):
            pauses.note(time.monotonic())
        time.sleep(WATCHED_S)
        for pauses in (competing, alone):
            pauses.note(time.monotonic())
    assert competing.longest_s < 0.6 * WATCHED_S
    assert alone.longest_s > 0.9 * WATCHED_S


def test_a_failure_says_what_the_machine_withheld() -> None:
    with pytest.raises(AssertionError) as failure, WithheldTime():
        raise AssertionError("late")
    (note,) = failure.value.__notes__
    assert note.startswith("The machine withheld ")


def test_a_budget_adds_up_and_names_the_excess() -> None:
    budget = Budget(limit=0.1, free_s=1.0, tallies={"robot": Tally(1.0, 45.0, 2)})
    budget.tallies["page"] = Tally(4.0, 0.0, 1)
    assert budget.excess == ""
    names = [line.split(":")[0] for line in budget.lines()]
    assert names == ["withheld from page", "withheld from robot"]
    budget.tallies["page"].add(0.1, 0.1)
    assert "withheld 5.1 s" in budget.excess


def test_inputs_that_are_given_again_count_and_too_many_fail_the_run() -> None:
    budget = Budget(limit=0.1, free_s=1.0)
    for _ in range(10):
        next(budget.tries("press", 5))
    assert budget.excess == ""
    assert list(budget.lines()) == ["inputs to pages given again: 0 of 10"]
    for _ in range(4):
        assert list(budget.tries("push", 5, free=2)) == list(range(5))
    assert "12 inputs to pages were given again" in budget.excess
    assert list(budget.lines()) == ["inputs to pages given again: 12 of 14: push (12x)"]


def test_a_short_run_may_have_a_moment_of_withheld_time() -> None:
    budget = Budget(limit=0.1, free_s=1.0, tallies={"robot": Tally(1.0, 1.0, 1)})
    assert budget.excess == ""


def test_a_followed_process_is_counted_once() -> None:
    budget = Budget(limit=0.1, free_s=1.0)
    followed = budget.follow("robot")
    followed.end()
    followed.end()
    assert budget.tallies["robot"].count == 1
