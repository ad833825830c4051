"""Regions around an estimated planar pose that hold the true one with a stated probability."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from tsd_twin.estimation.pose_spread import chord
from tsd_twin.lie import Array

REGION_SIGMAS = 2.0
"""Radius of the region of the position, in standard deviations."""
REGION_SHARE = 1.0 - math.exp(-0.5 * REGION_SIGMAS**2)
"""Probability of the region of the position, and of that of the heading: 86 %."""
HEADING_SIGMAS = NormalDist().inv_cdf(0.5 * (1.0 + REGION_SHARE))
"""Half-width of the region of the heading, in standard deviations: its probability is the same."""
_SIDES = 48


def position_region(covariance: Array) -> Array:
    """Return the outline (n, 2) of the region of the position, less the estimated position.

    `covariance` (3, 3) is that of a pose in exponential coordinates, axes of `odom`. The region is
    an ellipse in these coordinates. Over the floor it is bent: each point of it goes with the most
    likely heading there.
    """
    angles = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    variances = np.maximum(variances, 0.0)
    errors = REGION_SIGMAS * np.sqrt(variances) * circle @ axes.T
    # The regression of the heading on the position, by its principal axes; none along an axis
    # without extent.
    along = np.where(variances > 0.0, 1.0 / np.maximum(variances, 1e-300), 0.0)
    turned = errors @ (axes * along) @ axes.T @ covariance[:2, 2]
    bent = (errors[:, 0] + 1j * errors[:, 1]) * chord(turned)
    return np.stack([bent.real, bent.imag], axis=-1)


def heading_region_rad(covariance: Array) -> float:
    """Return the half-width of the region of the heading, at most half a turn."""
    return min(HEADING_SIGMAS * math.sqrt(max(float(covariance[2, 2]), 0.0)), math.pi)


def encloses(outline: Array, point: Array) -> bool:
    """Return whether a closed `outline` (n, 2) winds around a `point` (2,)."""
    arms = outline - point
    following = np.roll(arms, -1, axis=0)
    crossed = arms[:, 0] * following[:, 1] - arms[:, 1] * following[:, 0]
    turns = np.arctan2(crossed, (arms * following).sum(axis=-1))
    return abs(float(turns.sum())) > np.pi
