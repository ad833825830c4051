"""Plant faults in the programs, and count how often real-time tests catch each one.

`python -m tests.planted_faults [--runs 20] [--only quiet] [--plain] [FAULT ...]` runs the test of
each fault with it and without, on a quiet machine and with a busy process on each processor. With
`--plain`, tests have the same priority as those processes, else real-time as in
`scripts/run_tests`, if allowed. Rare events occur every 2 s, so that a test of some seconds
includes them.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.withheld import PATIENCE_S

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "tests/planted"
EVERY_S = 2.0
_LIMIT_S = 60.0
HELD = "tests/system/test_faults.py::test_without_a_fault_a_held_stick_keeps_driving"


@dataclass(frozen=True)
class Fault:
    """A fault, and the test that must catch it."""

    name: str
    text: str
    test: str


FAULTS = (
    Fault("loop-sleeps", "control loop sleeps 120 ms", HELD),
    Fault("dashboard-blocks", "event loop of the dashboard is blocked for 300 ms", HELD),
    Fault(
        "first-command-lost",
        "first command is lost",
        "tests/node/test_promptness.py::test_every_command_counts_including_the_first",
    ),
    Fault(
        "state-twice",
        "one state in twenty arrives twice",
        "tests/node/test_streams.py::test_every_stream_has_its_encoding_its_rate_and_a_rising_stamp",
    ),
    Fault(
        "lease-late",
        "lease is granted one period late",
        "tests/node/test_promptness.py::test_a_request_is_answered_within_one_period",
    ),
)


def realtime() -> list[str]:
    """Return a command prefix for real-time priority, empty if not allowed."""
    command = ["chrt", "--rr", "2"]
    with contextlib.suppress(OSError):
        if subprocess.run([*command, "true"], capture_output=True, check=False).returncode == 0:
            return command
    return []


def fails(test: str, fault: str = "", start: Sequence[str] = ()) -> bool:
    """Return whether a test fails with a planted fault, or without one.

    Raises:
        RuntimeError: If the test did not run.
    """
    folders = [str(FOLDER), str(ROOT / "src"), str(ROOT / "app"), str(ROOT)]
    variables = {
        "PYTHONPATH": os.pathsep.join(folders),
        "TEST_PLANTED_FAULT": fault,
        "TEST_PLANTED_EVERY_S": str(EVERY_S),
        "TEST_REALTIME": " ".join(start),
    }
    # Shorter than the limit of the test that calls this; some faults let a test wait in vain.
    limit = f"--timeout={_LIMIT_S:g}"
    pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", limit, test]
    done = subprocess.run(
        [*start, *pytest],
        cwd=ROOT,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    if done.returncode > 1 or ("1 failed" not in done.stdout and "1 passed" not in done.stdout):
        raise RuntimeError(done.stdout + done.stderr)
    return "1 failed" in done.stdout


@contextlib.contextmanager
def load() -> Generator[None]:
    """Run a busy process on each processor."""
    command = [sys.executable, "-c", "while True: pass"]
    spinning = [subprocess.Popen(command) for _ in os.sched_getaffinity(0)]
    try:
        yield
    finally:
        for each in spinning:
            each.kill()
            each.wait()


def count(test: str, fault: str, runs: int, start: Sequence[str], *, loaded: bool) -> str:
    """Return the number of failures of a test, as `3 of 20`."""
    with load() if loaded else contextlib.nullcontext():
        failed = sum(fails(test, fault, start) for _ in range(runs))
    return f"{failed} of {runs}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.planted_faults", description=__doc__)
    parser.add_argument("faults", nargs="*", metavar="FAULT", help="only these")
    parser.add_argument("--runs", type=int, default=20, help="runs of each test (20)")
    parser.add_argument("--only", choices=["quiet", "loaded"], help="only so, not both")
    parser.add_argument("--plain", action="store_true", help="do not run tests in real time")
    args = parser.parse_args()
    chosen = [fault for fault in FAULTS if not args.faults or fault.name in args.faults]
    ways = [way for way in ("quiet", "loaded") if args.only in (None, way)]
    start = () if args.plain else realtime()
    say(" | ".join(["| planted fault", *(f"caught, {way}" for way in ways), "test |"]))
    say("| --- " * (len(ways) + 2) + "|")
    healthy = [Fault("", "none", test) for test in dict.fromkeys(fault.test for fault in chosen)]
    for fault in [*chosen, *healthy]:
        counts = [
            count(fault.test, fault.name, args.runs, start, loaded=way == "loaded") for way in ways
        ]
        say(" | ".join([f"| {fault.text}", *counts, f"{fault.test.rpartition('::')[2]} |"]))


def say(line: str) -> None:
    """Print a line and flush."""
    print(line, flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
