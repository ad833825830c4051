"""How all pictures of the lab look."""

from __future__ import annotations

from typing import Any, TypeAlias

from matplotlib.figure import Figure

Axes: TypeAlias = Any
"""Of matplotlib, which leaves the types of its keywords open; pictures are looked at."""

REFERENCE = "#5b6472"
TRUTH = "#c2410c"
ESTIMATE = "#1d4ed8"
CAMERA = "#0f766e"
SERIES = (TRUTH, ESTIMATE, CAMERA, "#7c3aed", "#b45309", "#be185d")
"""Told apart also by people who see few colours, since lines differ in style where they cross."""
_INK, _GRID = "#1f2933", "#d9dee5"


def figure(width_in: float, height_in: float, title: str) -> Figure:
    """Return an empty figure with a title on top, laid out by itself."""
    made: Any = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    made.suptitle(title, fontsize=13, color=_INK, x=0.01, ha="left", weight="bold")
    return made


def dress(axes: Axes, x_label: str, y_label: str, title: str = "") -> None:
    """Label both axes, with their units, and draw the grid."""
    axes.set_xlabel(x_label, color=_INK)
    axes.set_ylabel(y_label, color=_INK)
    if title:
        axes.set_title(title, fontsize=10, color=_INK, loc="left")
    axes.grid(visible=True, color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_INK, labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(_REST)


def legend(axes: Axes, **where: Any) -> None:
    """Name what is drawn."""
    axes.legend(frameon=False, fontsize=9, labelcolor=_INK, **where)


_REST = "#8a94a3"
