"""The three errors of a path test: in time, beside the path, and at the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array

_BLOCK = 512


@dataclass(frozen=True, slots=True)
class TrackingErrors:
    """One number hides what went wrong: lateness, a drift, or a corner that was cut."""

    rms_m: float
    """Root mean square distance to where the robot should have been at that time."""
    worst_m: float
    """Greatest such distance."""
    cross_track_m: float
    """Greatest distance to the nearest point of the path."""
    closure_m: float
    """Distance between where it ended and where it should have."""
    size_m: float
    """Larger side of the box around the path: what 100 % are."""

    def sentence(self) -> str:
        """Return all three in millimetres and in per cent of the size."""
        parts = [
            f"{name} {1000 * value:.1f} mm ({100 * value / self.size_m:.2f} %)"
            for name, value in (
                ("RMS time-tracking", self.rms_m),
                ("maximum cross-track", self.cross_track_m),
                ("closure", self.closure_m),
            )
        ]
        return ", ".join(parts)


def tracking_errors(xy: Array, reference_xy: Array, path_xy: Array) -> TrackingErrors:
    """Return the errors of positions `xy` (n, 2) against those at the same times, and a path.

    `path_xy` (m, 2) are points along the path, close together.
    """
    apart = xy - reference_xy
    off = np.hypot(apart[:, 0], apart[:, 1])
    return TrackingErrors(
        rms_m=float(np.sqrt(np.mean(np.square(off)))),
        worst_m=float(off.max()),
        cross_track_m=float(_distances(xy, path_xy).max()),
        closure_m=float(off[-1]),
        size_m=float(np.ptp(path_xy, axis=0).max()),
    )


def _distances(xy: Array, path_xy: Array) -> Array:
    """Return the distance of each of `xy` (n, 2) to the nearest leg between points (m, 2)."""
    start, legs = path_xy[:-1], np.diff(path_xy, axis=0)
    squared = np.maximum(np.square(legs).sum(axis=1), 1e-300)
    nearest: list[Array] = []
    for at in range(0, len(xy), _BLOCK):
        off = xy[at : at + _BLOCK, None] - start
        share = np.clip((off * legs).sum(axis=2) / squared, 0.0, 1.0)
        away = off - share[..., None] * legs
        nearest.append(np.sqrt(np.square(away).sum(axis=2).min(axis=1)))
    return np.concatenate(nearest)
