"""Freed memory returns to the system; runs in a separate process, as the setting is global."""

from __future__ import annotations

import subprocess
import sys

_PROGRAM = """
import psutil
from tsd_twin.cli.malloc import tune_malloc

taken = {call}
del_me = bytearray(20_000_000)
del del_me  # From here on glibc would take blocks of up to this size from the heap.
blocks, between = [], []
for _ in range(1000):
    blocks.append(bytearray(b"x" * 100_000))
    between.append(bytearray(2_000))
before = psutil.Process().memory_info().rss
blocks.clear()
print(int(taken), before - psutil.Process().memory_info().rss)
"""


def given_back(call: str) -> tuple[int, int]:
    """Return whether the setting was accepted, and how much RSS drops on freeing 100 MB."""
    command = [sys.executable, "-c", _PROGRAM.replace("{call}", call)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    taken, size = map(int, output.split())
    return taken, size


def test_freed_blocks_between_others_are_given_back() -> None:
    taken, size = given_back("tune_malloc()")
    assert taken == 1
    assert size > 90_000_000


def test_without_it_they_stay_in_the_heap() -> None:
    _, size = given_back("0")
    assert size < 10_000_000
