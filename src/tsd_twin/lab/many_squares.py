"""The square by many robots, each with errors of its own: how the three errors spread."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.lab import look
from tsd_twin.lab.one_square import Square
from tsd_twin.lab.output import Output
from tsd_twin.lab.tracking import TrackingErrors
from tsd_twin.lie import Array

_NAMES = ("RMS time-tracking", "maximum cross-track", "closure")
_COLUMNS = ("rms_percent", "cross_track_percent", "closure_percent")
_KEYS = ("rms_m", "cross_track_m", "closure_m")


@dataclass(frozen=True, slots=True)
class _Driven:
    seed: int
    duration_s: float
    errors: TrackingErrors


def run_many(squares: Sequence[Square], out: Output) -> list[str]:
    """Drive all of them, as many at once as there are cores; draw and say how errors spread."""
    driven = list(out.progress(_drive_all(squares), "driving squares", len(squares)))
    percent = np.array([[_percent(one.errors, key) for key in _KEYS] for one in driven])
    out.table(
        "squares",
        {"seed": [float(one.seed) for one in driven]} | dict(zip(_COLUMNS, percent.T, strict=True)),
    )
    first = squares[0]
    title = f"{len(driven)} squares of 1 m in {driven[0].duration_s:.2f} s, loop: {first.loop}"
    _draw(percent, title, out)
    return [
        f"{title}, seeds {driven[0].seed} to {driven[-1].seed}; "
        "per cent of the side (median, 95 of 100, worst):",
        *(f"  {name:20} {_spread(of)}" for name, of in zip(_NAMES, percent.T, strict=True)),
    ]


def _drive_all(squares: Sequence[Square]) -> Iterator[_Driven]:
    # Processes of their own: matplotlib and threads do not mix with a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(os.cpu_count() or 1, len(squares)), context) as pool:
        yield from pool.map(_drive, squares)


def _drive(square: Square) -> _Driven:
    trajectory, record = square.drive()
    return _Driven(square.seed, trajectory.duration_s, record.errors())


def _percent(errors: TrackingErrors, key: str) -> float:
    return 100.0 * float(getattr(errors, key)) / errors.size_m


def _spread(percent: Array) -> str:
    figures = (np.median(percent), np.quantile(percent, 0.95), percent.max())
    return " ".join(f"{figure:6.2f}" for figure in figures)


def _draw(percent: Array, title: str, out: Output) -> None:
    figure: Any = look.figure(7.0, 4.2, title)
    axes = figure.subplots()
    for row, (of, colour) in enumerate(zip(percent.T, look.SERIES, strict=False)):
        # Side by side in the order of the seeds, so that none hides another.
        beside = row + np.linspace(-0.3, 0.3, len(of)) if len(of) > 1 else np.array([row])
        axes.plot(beside, of, ".", color=colour, markersize=7)
        median = float(np.median(of))
        axes.plot([row - 0.35, row + 0.35], [median, median], color=colour, linewidth=1.2)
    axes.set_xticks(range(len(_NAMES)), _NAMES)
    axes.set_ylim(bottom=0.0)
    look.dress(axes, "", "error (% of the side)", "each dot is a robot, the line is the median")
    out.picture("squares", figure)
