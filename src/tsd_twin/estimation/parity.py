"""Whether measured joints contradict one another by more than their noise: a chi-square test.

Joints measure more numbers than a twist has. What no twist explains lies in the parity space, of as
many dimensions as there are numbers too many: three, for three modules. There, divided by what the
noise of the joints makes of it, the squared length of a residual is chi-square distributed when all
is well (Ding, "Model-based Fault Diagnosis Techniques", 2013, chapter 10). So the threshold follows
from the rate of false alarms that one is ready to bear, and from nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import gammaincinv  # pyright: ignore

from tsd_twin.drives import Drive
from tsd_twin.lie import Array

FALSE_ALARM = 1e-4
"""Probability that a decision about a sound robot is wrong."""
_LEFT_OVER = 0.01
_NUDGE = 1e-5
"""Radians, or rad/s a rad/s: small enough for a slope."""
_LEAST_SIGMA = 1e-5
"""Radians or rad/s: what is described without noise is taken to have this much, for rounding."""
_NOTHING = 1e-4
"""m/s: directions that joints move less than this share of it are rounding, as with three wheels,
which never contradict one another."""
_RANK = 1e-6
"""Directions that joints move less than this share of the most are none."""


@dataclass(frozen=True, slots=True, eq=False)
class ParityTest:
    """The test at one joint vector."""

    whiten: Array
    """(d, m): from a residual to d numbers that are normal and independent when all is well."""
    lines: Array
    """(n, d): unit vectors along which these move when one joint alone is wrong; or zero."""
    threshold: float
    """Of the squared length of these; infinite when there are none, d = 0."""

    @staticmethod
    def at(
        drive: Drive[Any], joints: Array, sigma: Array, false_alarm: float = FALSE_ALARM
    ) -> ParityTest:
        """Return the test around `joints` (n,) with standard deviations `sigma` (n,).

        First-order error propagation through the forward kinematics, by differences.
        """
        steps = _NUDGE * np.maximum(1.0, np.abs(joints))
        nudged = np.concatenate([joints[None], joints + np.diag(steps)])
        residuals = drive.forward(nudged).residual
        slopes = (residuals[1:] - residuals[0]) / steps[:, None]
        _, sizes, directions = np.linalg.svd(slopes * np.maximum(1.0, np.abs(joints))[:, None])
        basis = directions[: int(np.count_nonzero(sizes > _RANK * max(sizes.max(), _NOTHING)))]
        if len(basis) == 0:
            return ParityTest(np.zeros((0, slopes.shape[1])), np.zeros((len(slopes), 0)), np.inf)
        noise = (np.maximum(sigma, _LEAST_SIGMA)[:, None] * slopes) @ basis.T
        covariance = noise.T @ noise
        root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        whiten: Array = np.asarray(np.linalg.solve(root, basis), dtype=float)
        lines: Array = slopes @ whiten.T
        lengths: Array = np.sqrt(np.square(lines).sum(axis=1, keepdims=True))
        # Of a wheel that pushes nothing, no speed shows: such a line would be rounding.
        lines = np.where(lengths > _RANK * lengths.max(), lines / np.maximum(lengths, 1e-300), 0.0)
        return ParityTest(whiten, lines, chi_square_bound(len(basis), false_alarm))

    @property
    def dimensions(self) -> int:
        """Of the parity space."""
        return len(self.whiten)

    def statistic(self, residual: Array, samples: float = 1.0) -> Array:
        """Return what to compare with the threshold (...), for the mean of `samples` residuals.

        `residual` is (..., m); the noise of one sample is independent of that of the others.
        """
        white = residual @ self.whiten.T
        return samples * np.square(white).sum(axis=-1)

    def single_fault(self, residual: Array) -> tuple[Array, Any]:
        """Return which joint alone explains most of residuals (..., m), and whether all of it.

        All, when what is left is no more than noise leaves in 99 of 100 cases.
        """
        white = residual @ self.whiten.T
        explained = np.square(white @ self.lines.T)
        left = np.square(white).sum(axis=-1) - explained.max(axis=-1)
        enough = left <= chi_square_bound(self.dimensions - 1, _LEFT_OVER)
        return explained.argmax(axis=-1), enough

    def evident(self, residual: Array, samples: float = 1.0) -> Any:
        """Return whether residuals (..., m) contradict the noise, booleans (...)."""
        return self.statistic(residual, samples) > self.threshold


def chi_square_bound(dimensions: int, beyond: float) -> float:
    """Return what chi-square of so many dimensions exceeds with the probability `beyond`."""
    if dimensions <= 0:
        return 0.0
    return 2.0 * float(gammaincinv(0.5 * dimensions, 1.0 - beyond))
