"""Which speeds of the wheels have been driven with, and with which others to drive next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsd_twin.lab.excitation import patterns
from tsd_twin.lab.output import Output
from tsd_twin.lab.recording import Recording
from tsd_twin.lab.write_back import edited
from tsd_twin.lie import Array

_ALIKE = 0.05
NEXT = "calibrate_next.toml"


def ratio_of(run: Recording) -> Array:
    """Return the speeds (k,) that the wheels were told in a run, over the slowest of them."""
    told = np.median(run.told_rad_per_s, axis=0)
    return (told / told.min()).round(3)


def missing(recordings: Sequence[Recording]) -> list[list[float]]:
    """Return the ratios that no run has had."""
    driven = [ratio_of(run) for run in recordings]
    return [
        ratio
        for ratio in patterns(recordings[0].modules)
        if not any(np.abs(each - ratio).max() < _ALIKE for each in driven)
    ]


def advice(out: Output, log: str, text: str, recordings: Sequence[Recording]) -> list[str]:
    """Return how to go on, and leave the description for that; nothing when all has been driven.

    `text` is the description of the robot, `log` the file that has the runs until now.
    """
    left = missing(recordings)
    if not left:
        return []
    out.text(NEXT, edited(text, NEXT, {"drive": {"spin_ratio": left[0]}}))
    log_at, next_at = out.folder / log, out.folder / NEXT
    more = f"{len(left)} more run{'s' if len(left) > 1 else ''}"
    return [
        f"{more} with one wheel faster would tell each zero apart: start the robot with --robot",
        f"  {next_at}, and then tsd-lab calibrate --drive --log {log_at} --out {out.folder}",
    ]
