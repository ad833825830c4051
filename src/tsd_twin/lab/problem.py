"""What may be wrong with a machine, and where it would have been seen if that were so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsd_twin.drives import SingularityDrive
from tsd_twin.lab.recording import Recording
from tsd_twin.lie import SE2, Array

PRIOR_OFFSET_RAD, PRIOR_SHARE, PRIOR_LATE_S = float(np.radians(1.0)), 0.05, 0.05
"""What is known before: keeps near zero what a data set does not tell."""
_STEP = 1e-4
"""Of a slope, in what is known before: a few tenths of a thousandth of a degree."""


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """By how much a machine differs from what it was taken for."""

    offset_rad: Array
    """(k, 2): alpha, beta."""
    wheel_radius: float
    """As a factor."""
    pivot_radius: float
    """As a factor."""
    spin: Array
    """(k,): as factors of the speeds that the wheels were told."""
    late_s: float
    """By how much the joints tell later what the camera sees: both clocks and the bus to them."""


class Problem:
    """Unknowns as a vector: gimbals, wheel radius, pivot radius, differences of spin, lateness."""

    def __init__(self, drive: SingularityDrive, recordings: Sequence[Recording]) -> None:
        self.drive = drive
        self.modules = k = drive.modules
        self._drives: dict[float, SingularityDrive] = {}
        self.measured = all(bool(np.isfinite(run.spin_rad_per_s).all()) for run in recordings)
        # Only differences: all wheels faster is the same as larger wheels, to a camera.
        differences = np.linalg.svd(np.ones((1, k)))[2][1:].T
        self._spins = np.zeros((k, 0)) if self.measured else differences
        self.prior = np.array(
            [PRIOR_OFFSET_RAD] * (2 * k)
            + [PRIOR_SHARE] * (2 + self._spins.shape[1])
            + [PRIOR_LATE_S]
        )
        self.names = [f"module{i + 1}_{part}" for i in range(k) for part in ("alpha", "beta")]
        self.names += ["wheel radius", "pivot radius"]
        self.names += [f"spin difference {i + 1}" for i in range(self._spins.shape[1])]
        self.names += ["lateness of the joints"]

    def corrections(self, unknowns: Array) -> Corrections:
        """Return what a vector (u,) of unknowns stands for."""
        k = self.modules
        spin = 1.0 + self._spins @ unknowns[2 * k + 2 : -1]
        offset = unknowns[: 2 * k].reshape(k, 2)
        radii = 1.0 + unknowns[2 * k : 2 * k + 2]
        return Corrections(offset, float(radii[0]), float(radii[1]), spin, float(unknowns[-1]))

    def sigma(self, covariance: Array) -> Corrections:
        """Return the standard deviation of each figure, from the covariance (u, u) of unknowns."""
        k = self.modules
        own = np.sqrt(np.diag(covariance))
        spins = covariance[2 * k + 2 : -1, 2 * k + 2 : -1]
        spread = np.sqrt(np.einsum("ij,jk,ik->i", self._spins, spins, self._spins))
        radii, late_s = own[2 * k : 2 * k + 2], float(own[-1])
        return Corrections(
            own[: 2 * k].reshape(k, 2), float(radii[0]), float(radii[1]), spread, late_s
        )

    def residual(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return (m, 3): where the camera saw the robot less where it should have been."""
        return run.seen - self.poses(run, unknowns, start)

    def poses(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return (m, 3): where the robot should have been when the camera saw it."""
        right = self.corrections(unknowns)
        drive = self._with_pivots(right.pivot_radius)
        speeds = run.spin_rad_per_s if self.measured else run.told_rad_per_s * right.spin
        joints = np.empty((len(run.t_s), self.modules, 3))
        joints[..., :2] = run.angles_rad.reshape(-1, self.modules, 2) + right.offset_rad
        joints[..., 2] = speeds
        flat = joints.reshape(len(joints), -1)
        dt_s = np.diff(run.t_s)[:, None]
        middle, rates = 0.5 * (flat[1:] + flat[:-1]), np.diff(flat, axis=0) / dt_s
        twists = right.wheel_radius * drive.forward(middle, rates).twist
        steps = SE2.exp(twists * dt_s).xy_heading
        heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
        turned = SE2(np.column_stack([np.zeros((len(steps), 2)), heading[:-1]]))
        xy = np.concatenate([np.zeros((1, 2)), np.cumsum(turned.rotate(steps[:, :2]), axis=0)])
        poses = (SE2(start) @ SE2(np.column_stack([xy, heading]))).xy_heading
        there = np.empty((len(run.seen_s), 3))
        for i in range(3):
            there[:, i] = np.interp(run.seen_s + right.late_s, run.t_s, poses[:, i])
        return there

    def by_unknowns(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return (m, 3, u + 3): how residuals change with the unknowns, scaled, and the start."""
        here = self.poses(run, unknowns, start)
        changes = np.zeros((*here.shape, len(unknowns) + 3))
        for i, step in enumerate(_STEP * self.prior):
            there = self.poses(run, unknowns + step * (np.arange(len(unknowns)) == i), start)
            changes[..., i] = (here - there) / _STEP
        changes[:, 0, -3] = changes[:, 1, -2] = changes[:, 2, -1] = -1.0
        changes[:, 0, -1], changes[:, 1, -1] = here[:, 1] - start[1], start[0] - here[:, 0]
        return changes

    def _with_pivots(self, factor: float) -> SingularityDrive:
        """Return the drive with another pivot radius, and keep it: most guesses share it."""
        if factor not in self._drives:
            pivot_radius_m = self.drive.pivot_radius_m * factor
            self._drives = {factor: replace(self.drive, pivot_radius_m=pivot_radius_m)}
        return self._drives[factor]
