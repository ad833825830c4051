"""Splines of scipy, for curved paths.

The only module of this package that imports scipy, with the extra `paths`. It is imported where a
path bends: it takes a quarter of a second, and straight motions do not need it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.errors import needs_extra
from tsd_twin.lie import Array

with needs_extra("A curved path", "paths"):
    from scipy import interpolate  # pyright: ignore

SCIPY: Any = interpolate  # scipy has no types for its splines.


def smoothing(points: Array, weights: Array, at: Array, rms: float) -> Any:
    """Quintic spline within a weighted RMS distance of `points` (n, 2) at `at` (n,)."""
    # With the full output scipy does not warn about a near-convergence.
    options: dict[str, Any] = {"s": len(at) * rms**2, "k": 5, "full_output": 1}
    knots, coefficients, degree = SCIPY.splprep(points.T, w=weights, u=at, **options)[0][0]
    return SCIPY.BSpline(knots, np.array(coefficients).T, degree)
