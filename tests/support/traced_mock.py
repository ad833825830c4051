"""`tsd-mock` that writes its true motion to a file: `python -m tests.support.traced_mock FILE`.

A robot behind a router cannot be observed in another way while that router is away.
"""

from __future__ import annotations

import itertools
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

import tsd_mock
from tsd_twin.lie import SE2, Array
from tsd_twin.simulation import BoardModel


class TracedBoard(BoardModel):
    """Simulated board that writes a line for each setpoint: time, x, y, largest speed, robot.

    Robots in a process are numbered in the order of their first setpoints.
    """

    file: TextIO
    _numbers = itertools.count()
    _number: int | None = None

    def write(self, setpoint: Array, now_s: float) -> None:
        super().write(setpoint, now_s)
        truth = self.truth(now_s)
        assert isinstance(truth.pose, SE2)
        x, y = truth.pose.xy_heading[:2]
        if self._number is None:
            self._number = next(self._numbers)
        self.file.write(f"{now_s} {x} {y} {np.abs(truth.twist).max()} {self._number}\n")
        self.file.flush()


def follow_trace(file: Path, ended: threading.Event) -> Iterator[tuple[float, ...]]:
    """Yield the lines of a trace as they are written, until an event."""
    with file.open(encoding="ascii") as lines:
        text = ""
        while not ended.is_set():
            text += lines.readline()
            if not text.endswith("\n"):
                time.sleep(0.005)
                continue
            yield tuple(map(float, text.split()))
            text = ""


if __name__ == "__main__":
    with Path(sys.argv.pop(1)).open("w", encoding="ascii") as TracedBoard.file:
        tsd_mock.BoardModel = TracedBoard
        tsd_mock.main()
