"""The floor: a grid with a line each metre, axes in the origin of `odom`, and metres on them."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.strokes import strokes
from tsd_twin.lie import Array

LABELLED_M = 5
"""Metres from the origin up to which the axes are labelled."""
_TEXT_M = 0.07
_GAP_M = 0.03


def add_ground(scene: viser.SceneApi, root: str, labels: str) -> None:
    """Add grid and axes below the node `root`, and the labels as the node of that name."""
    scene.world_axes.visible = False  # It does not move with `root`.
    scene.add_grid(
        f"{root}/g",
        infinite_grid=True,
        cell_size=0.1,
        cell_color=palette.GRID_FINE,
        cell_thickness=0.6,
        section_size=1.0,
        section_color=palette.GRID_METRE,
        section_thickness=1.3,
        fade_distance=12.0,
        fade_strength=2.0,
        shadow_opacity=0.35,
    )
    scene.add_frame(
        f"{root}/o",
        axes_length=0.12,
        axes_radius=0.002,
        origin_radius=0.004,
        position=(0, 0, 0.004),
    )
    scene.add_line_segments(
        labels, _scale(), palette.GRID_LABEL, thickness=1.5, thickness_units="screen"
    )


def _scale() -> Array:
    """Return the lines (n, 2, 3) of the labels, a hair above the floor."""
    words = [strokes("x", (0.14, -_GAP_M), _TEXT_M), strokes("y", (_GAP_M, 0.14), _TEXT_M)]
    for metres in (m for m in range(-LABELLED_M, LABELLED_M + 1) if m):
        words.append(strokes(f"{metres} m", (metres + _GAP_M, -_GAP_M), _TEXT_M))
        words.append(strokes(f"{metres} m", (_GAP_M, metres - _GAP_M), _TEXT_M))
    flat = np.concatenate(words)
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), 0.002)], axis=-1)
