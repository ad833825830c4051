"""`tsd-mock` that writes its true motion to a file: `python -m tests.support.traced_mock FILE`.

A robot behind a router cannot be observed in another way while that router is away.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TextIO

import numpy as np

import tsd_mock
from tsd_twin.lie import SE2, Array
from tsd_twin.simulation import BoardModel


class TracedBoard(BoardModel):
    """Simulated board that writes a line for each set-point: time, x, y, largest speed."""

    file: TextIO

    def write(self, setpoint: Array, now_s: float) -> None:
        super().write(setpoint, now_s)
        truth = self.truth(now_s)
        assert isinstance(truth.pose, SE2)
        x, y = truth.pose.xy_heading[:2]
        self.file.write(f"{now_s} {x} {y} {np.abs(truth.twist).max()}\n")
        self.file.flush()


if __name__ == "__main__":
    with Path(sys.argv.pop(1)).open("w", encoding="ascii") as TracedBoard.file:
        tsd_mock.BoardModel = TracedBoard
        tsd_mock.main()
