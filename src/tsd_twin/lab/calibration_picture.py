"""The picture of a calibration: what is left of the disagreement, and how sure figures are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tsd_twin.lab import look
from tsd_twin.lab.figures import Row
from tsd_twin.lab.fit import Fit
from tsd_twin.lab.recording import Recording


def draw(recordings: Sequence[Recording], found: Fit, rows: Sequence[Row]) -> Figure:
    """Return it."""
    figure: Any = look.figure(11.0, 4.6, "Calibration from driven squares")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.2, 1.0, 1.0])
    for residuals, colour, style, name in (
        (found.before, look.REFERENCE, "--", "before"),
        (found.after, look.TRUTH, "-", "after"),
    ):
        for i, (each, residual) in enumerate(zip(recordings, residuals, strict=True)):
            left.semilogy(
                each.seen_s - each.t_s[0],
                1000 * np.hypot(residual[:, 0], residual[:, 1]),
                style,
                color=colour,
                linewidth=0.9,
                label=name if i == 0 else None,
            )
    look.dress(left, "time (s)", "camera to joints (mm)", "position, all runs")
    look.legend(left)
    _bars(middle, [row for row in rows if row.unit == "deg"], "deg", 1.0)
    _bars(right, [row for row in rows if row.unit != "deg"], "%", 100.0)
    return figure


def _bars(axes: look.Axes, rows: list[Row], unit: str, scale: float) -> None:
    """Draw how far off figures are, or how much they changed where the truth is not known."""
    at = np.arange(len(rows))[::-1]
    sizes = np.array([abs(row.before) if row.unit == "m" else 1.0 for row in rows])
    true = np.array([row.before if row.true is None else row.true for row in rows])
    before = scale * (np.array([row.before for row in rows]) - true) / sizes
    found = scale * (np.array([row.found for row in rows]) - true) / sizes
    spread = scale * 2.0 * np.array([row.sigma for row in rows]) / sizes
    known = rows[0].true is not None
    axes.barh(at, before, 0.7, color="#d9dee5", label="before")
    axes.errorbar(
        found, at, xerr=spread, fmt="o", color=look.TRUTH, markersize=4, capsize=3, label="found"
    )
    axes.set_yticks(at, [row.name for row in rows])
    title = "against the truth, 2 s.d." if known else "against the description, 2 s.d."
    look.dress(axes, f"{'error' if known else 'change'} ({unit})", "", title)
    look.legend(axes, loc="best")
