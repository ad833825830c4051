"""Parts of overlays: frames in both themes, lines and areas, and the rate of changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard.scene.appearance import PALETTES, Palette, Rgb, Theme
from tsd_twin.dashboard.scene.unlit import line_colour
from tsd_twin.lie import Array

_SQRT2 = math.sqrt(2.0)
CASING_M = 0.0022
"""Width of the casing on each side of a line or solid."""


class RateLimiter:
    """Rate limiter with time as an argument."""

    def __init__(self, hz: float) -> None:
        self._period_s = 1.0 / hz
        self._last_s = -math.inf

    def is_due(self, now_s: float) -> bool:
        """Return whether a period has passed since it last returned True, or time went back."""
        # Tolerate early calls, because the callers are periodic too.
        if 0.0 <= now_s - self._last_s < self._period_s - 1e-3:
            return False
        self._last_s = now_s
        return True


def themed(scene: viser.SceneApi, name: str) -> list[tuple[str, Palette]]:
    """Add a child frame for each theme, and return their names and colours.

    Each client receives one of them, see `client_filter`: messages to all clients cost less than
    messages to each one.
    """
    for theme in Theme:
        scene.add_frame(f"{name}/{theme}", show_axes=False)
    return [(f"{name}/{theme}", PALETTES[theme]) for theme in Theme]


def set_all(handles: Sequence[Any], **values: Any) -> None:
    """Set properties of the same overlay in all themes."""
    for handle in handles:
        for name, value in values.items():
            setattr(handle, name, value)


def add_lines(
    scene: viser.SceneApi,
    name: str,
    points: Array | npt.NDArray[np.float32],
    colour: Rgb | npt.NDArray[np.uint8],
    width: float,
    *,
    on_screen: bool = False,
    visible: bool = True,
) -> viser.LineSegmentsHandle:
    """Add unlit line segments (n, 2, 3).

    Args:
        scene: Scene.
        name: Name of the node.
        points: (n, 2, 3): metres.
        colour: Displayed colour, or the `vertex_colour` (n, 2, 3) of each end.
        width: Metres, or pixels at any distance.
        on_screen: Whether the width is in pixels.
        visible: Whether it is visible.
    """
    return scene.add_line_segments(
        name,
        np.asarray(points, np.float32),
        line_colour(colour) if isinstance(colour, tuple) else colour,
        thickness=width,
        thickness_units="screen" if on_screen else "world",
        visible=visible,
    )


def add_area(
    scene: viser.SceneApi,
    name: str,
    corners: npt.NDArray[np.float32],
    colour: Rgb,
    opacity: float,
    *,
    visible: bool = True,
) -> viser.MeshHandle:
    """Add a translucent polygon (n, 3) that is star-shaped around its first corner."""
    return scene.add_mesh_simple(
        name,
        corners,
        fan(len(corners)),
        color=colour,
        opacity=opacity,
        side="double",
        cast_shadow=False,
        receive_shadow=False,
        visible=visible,
    )


def fan(corners: int) -> npt.NDArray[np.uint32]:
    """Return the faces (n, 3) of a polygon around its first corner."""
    second = np.arange(1, corners - 1, dtype=np.uint32)
    return np.stack([0 * second, second, second + 1], axis=-1)


def raised(outline: Array, height_m: float) -> npt.NDArray[np.float32]:
    """Return points (n, 2) at a height above the floor, (n, 3)."""
    return np.insert(outline, 2, height_m, axis=-1).astype(np.float32)


def closed(outline: Array) -> Array:
    """Return an outline (n, d) with its first point at its end as well."""
    return np.concatenate([outline, outline[:1]])


def dashes(path: Array, dash_m: float, gap_m: float) -> Array:
    """Return dashes (k, 2, d) along a path (n, d); those at corners are in two pieces."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    ends = np.concatenate([[0.0], np.cumsum(steps)])
    if not ends[-1] > 0.0:
        return np.zeros((0, 2, path.shape[1]))
    starts = np.arange(0.0, ends[-1], dash_m + gap_m)
    bounds = np.concatenate([starts, np.minimum(starts + dash_m, ends[-1])])
    places = np.unique(np.concatenate([bounds, ends]))
    middles = 0.5 * (places[:-1] + places[1:])
    drawn = np.remainder(middles, dash_m + gap_m) < dash_m
    axes = [np.interp(places, ends, path[:, axis]) for axis in range(path.shape[1])]
    points: Array = np.stack(axes, axis=-1)
    return np.stack([points[:-1], points[1:]], axis=1)[drawn]


def hatching(outline: Array, spacing_m: float) -> Array:
    """Return parallel diagonals (k, 2, 2) across a convex outline (n, 2).

    They are on fixed lines, so that those of a changed outline only become longer or shorter.
    """
    along: Array = (outline[:, 0] + outline[:, 1]) / _SQRT2
    across: Array = (outline[:, 1] - outline[:, 0]) / _SQRT2
    first, last = math.ceil(across.min() / spacing_m), math.floor(across.max() / spacing_m)
    levels: Array = spacing_m * np.arange(first, last + 1, dtype=np.float64).reshape(-1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):  # Sides may be parallel to the lines.
        shares: Array = (levels - across) / (np.roll(across, -1) - across)
        places: Array = along + shares * (np.roll(along, -1) - along)
    crossed = (shares >= 0.0) & (shares <= 1.0)
    low: Array = np.where(crossed, places, np.inf).min(axis=-1, keepdims=True)
    high: Array = np.where(crossed, places, -np.inf).max(axis=-1, keepdims=True)
    ends: Array = np.concatenate([low, high], axis=1)
    lines: Array = np.stack([ends - levels, ends + levels], axis=-1) / _SQRT2
    kept: Array = lines[ends[:, 0] < ends[:, 1]]
    return kept
