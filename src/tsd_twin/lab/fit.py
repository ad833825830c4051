"""What is wrong with a machine, from drives that a camera saw: nonlinear least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize

from tsd_twin.drives import SingularityDrive
from tsd_twin.errors import TwinError
from tsd_twin.lab.problem import Corrections, Problem
from tsd_twin.lab.recording import Recording
from tsd_twin.lab.whitening import Whitening
from tsd_twin.lie import Array
from tsd_twin.robots.robot import JointErrors
from tsd_twin.sim import CameraNoise

_least_squares: Any = optimize.least_squares  # pyright: ignore  scipy has no types for it.
_PART_S = 1.5
_ROBUST: Any = {"loss": "soft_l1", "f_scale": 5.0}
_UNSEEN = 1.0
"""Data that tell less of a direction than is known before do not tell it."""
_MENTIONED = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What least squares found."""

    found: Corrections
    sigma: Corrections
    """Standard deviations of these."""
    common_spin_known: bool
    """False: wheel radius times the common spin was found, and written as the wheel radius."""
    unseen: list[str]
    """Directions that these data do not tell, as combinations of unknowns."""
    singular_values: Array
    """Of what the data tell over what was known before, largest first."""
    before: list[Array]
    """Residuals (m, 3) of each run with nothing corrected, metres and radians."""
    after: list[Array]
    """The same with all corrected."""


def fit(
    drive: SingularityDrive,
    recordings: Sequence[Recording],
    noise: CameraNoise,
    joints: JointErrors,
    speed_share: float = 0.0,
) -> Fit:
    """Return what explains best where the camera saw the robot, by the noise of it and of `joints`.

    `speed_share` is how far off all speeds that the wheels were told may be in common: what is
    known of the battery says so much less.
    Starts of the runs are unknown as well. The first guess comes from short parts of them, each
    begun where the camera saw it: a gimbal that is off by a degree turns a run many times over.

    Raises:
        TwinError: it does not come to an end.
    """
    problem = Problem(drive, recordings)
    weights = 1.0 / np.array([noise.sigma_m, noise.sigma_m, noise.sigma_rad])
    whitenings = [Whitening(drive, run, noise, joints) for run in recordings]
    count = len(problem.prior)
    parts = [
        part
        for run in recordings
        for first_s in np.arange(run.t_s[0], run.t_s[-1] - _PART_S, 2.0 * _PART_S)
        if len((part := run.part(first_s, first_s + _PART_S)).seen_s) > 2
    ]
    at_frame = [part.part(part.seen_s[0], part.t_s[-1]) for part in parts]

    def rough(scaled: Array) -> Array:
        own = scaled * problem.prior
        each = [(problem.residual(p, own, p.seen[0]) * weights).ravel() for p in at_frame]
        return np.concatenate([*each, scaled])

    def whole(scaled: Array) -> Array:
        own, starts = scaled[:count] * problem.prior, scaled[count:].reshape(-1, 3) / weights
        each = [
            white(problem.residual(run, own, start).ravel())
            for run, white, start in zip(recordings, whitenings, starts, strict=True)
        ]
        return np.concatenate([*each, scaled[:count]])

    def slopes(scaled: Array) -> Array:
        own, starts = scaled[:count] * problem.prior, scaled[count:].reshape(-1, 3) / weights
        rows: list[Array] = []
        for i, (run, white, start) in enumerate(zip(recordings, whitenings, starts, strict=True)):
            changes = problem.by_unknowns(run, own, start)
            changes[..., count:] /= weights
            flat = white(changes.reshape(-1, changes.shape[-1]))
            block = np.zeros((len(flat), len(scaled)))
            block[:, :count], block[:, count + 3 * i : count + 3 * i + 3] = (
                flat[:, :count],
                flat[:, count:],
            )
            rows.append(block)
        return np.concatenate([*rows, np.eye(count, len(scaled))])

    guess: Any = _least_squares(rough, np.zeros(count), ftol=1e-3, **_ROBUST)
    starts = np.array([run.seen[0] for run in recordings])
    first = np.concatenate([guess.x, (starts * weights).ravel()])
    best: Any = _least_squares(whole, first, jac=slopes, x_scale="jac", ftol=1e-8)
    if not best.success:
        raise TwinError("the calibration does not converge: was the camera on the same clock?")
    found = _fit(problem, recordings, weights, best.x, best.jac, starts)
    return replace(found, sigma=_with_speed_share(found, speed_share))


def _fit(
    problem: Problem,
    recordings: Sequence[Recording],
    weights: Array,
    scaled: Array,
    jacobian: Array,
    seen_starts: Array,
) -> Fit:
    count = len(problem.prior)
    unknowns, starts = scaled[:count] * problem.prior, scaled[count:].reshape(-1, 3) / weights
    covariance: Array = np.linalg.inv(jacobian.T @ jacobian)[:count, :count].astype(float)
    covariance = covariance * np.outer(problem.prior, problem.prior)
    data, free = jacobian[:-count, :count], jacobian[:-count, count:]
    told = data - free @ np.linalg.lstsq(free, data, rcond=None)[0]
    _, strengths, directions = np.linalg.svd(told, full_matrices=False)
    unseen = [
        _combination(direction, problem.names)
        for strength, direction in zip(strengths, directions, strict=True)
        if strength < _UNSEEN
    ]
    found, sigma = problem.corrections(unknowns), problem.sigma(covariance)
    if problem.measured:
        found, sigma = _with_measured_spin(found, sigma, recordings)
    nothing = np.zeros(count)
    return Fit(
        found,
        sigma,
        problem.measured,
        unseen,
        strengths,
        [problem.residual(r, nothing, s) for r, s in zip(recordings, seen_starts, strict=True)],
        [problem.residual(r, unknowns, s) for r, s in zip(recordings, starts, strict=True)],
    )


def _with_speed_share(fit: Fit, share: float) -> Corrections:
    """Return how sure figures are when all speeds that were told are off by a share in common."""
    if fit.common_spin_known:
        return replace(fit.sigma, spin=np.hypot(fit.sigma.spin, share))
    return replace(fit.sigma, wheel_radius=float(np.hypot(fit.sigma.wheel_radius, share)))


def _with_measured_spin(
    found: Corrections, sigma: Corrections, recordings: Sequence[Recording]
) -> tuple[Corrections, Corrections]:
    """Return both with the median of measured over told speeds: wheels spin up at first."""
    shares = np.concatenate(
        [
            run.spin_rad_per_s[turns] / run.told_rad_per_s[turns]
            for run in recordings
            if (turns := (run.told_rad_per_s > 0.0).all(axis=1)).any()
        ]
    )
    # The median of normal noise is less sure than its mean, by this factor.
    spread = np.sqrt(0.5 * np.pi / len(shares)) * shares[len(shares) // 10 :].std(axis=0)
    return replace(found, spin=np.median(shares, axis=0)), replace(sigma, spin=spread)


def _combination(direction: Array, names: Sequence[str]) -> str:
    """Return a direction in words, its largest parts only."""
    sign = np.sign(direction[np.argmax(np.abs(direction))])
    parts = [
        f"{sign * part:+.1f} {name}"
        for part, name in zip(direction, names, strict=True)
        if abs(part) >= _MENTIONED
    ]
    return " ".join(parts)
