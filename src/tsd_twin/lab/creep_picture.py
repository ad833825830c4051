"""The picture of a robot that creeps."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tsd_twin.lab import look
from tsd_twin.lab.creep import LIMIT_M, LIMIT_S, Creep
from tsd_twin.lie import Array


def draw(t_s: Array, poses: Array, creep: Creep) -> Figure:
    """Return it, of poses (n, 3) since the start, from above and against time."""
    figure: Any = look.figure(9.5, 4.4, "Creep of a robot that is told to stand")
    left, right = figure.subplots(1, 2)
    millimetres = 1000.0 * poses[:, :2]
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = 1000.0 * LIMIT_M * np.stack([np.cos(turn), np.sin(turn)])
    left.plot(*circle, "--", color=look.REFERENCE, linewidth=1.2, label="an inch")
    left.plot(*millimetres.T, color=look.TRUTH, linewidth=1.8, label="centre of the robot")
    left.plot(*millimetres[-1], "s", color=look.TRUTH, markersize=5)
    left.set_aspect("equal", adjustable="datalim")
    look.dress(left, "forward (mm)", "left (mm)", "from above")
    look.legend(left, loc="best")
    ends = np.array([0.0, LIMIT_S])
    right.plot(t_s, np.hypot(*millimetres.T), color=look.TRUTH, linewidth=1.8, label="distance")
    way_mm = 1000.0 * creep.way_m
    right.plot(ends, ends / LIMIT_S * way_mm, ":", color=look.ESTIMATE, label="way at this creep")
    right.axhline(1000.0 * LIMIT_M, color=look.REFERENCE, linestyle="--", linewidth=1.2)
    look.dress(right, "time (s)", "distance (mm)", "against time")
    look.legend(right, loc="best")
    return figure
