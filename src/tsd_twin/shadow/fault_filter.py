"""Fault test of a linear model: which of several faults, if any, explains its residuals.

A Kalman filter learns nuisance parameters of known standard deviation. A fault adds a constant to
the residuals from some time on, so its effect on the innovations is known up to its size
(generalized likelihood ratio, Willsky and Jones 1976). A fault is named only if nothing else
explains the innovations as well and if the remainder is noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tsd_twin.estimation.consistency import chi_square_bound
from tsd_twin.lie import Array

EVIDENCE = 8.0
"""Log-likelihood ratio at which a fault is reported."""
UNKNOWN_EVIDENCE = 12.0
"""The same for a fault without a name: a part gets some time to show itself."""
START_EVIDENCE = 6.5
"""Half square of a learned constant, in its described standard deviations (3.6), at which a robot
differs from its description."""
_MARGIN = 4.0
"""Lead in evidence that a fault needs over those that do not include it."""
_REMAINDER_TAIL = 1e-3
"""Probability that noise leaves a larger remainder."""
_MODEL_SHARE = 0.15
"""Relative error of a fault's modelled effect, so that part of its evidence may remain."""
_SECOND = 3.0
"""Evidence that each further fault at the same time costs, because it is rare."""
_MAX_SQUARED = 4.0
"""Squared innovation per number above which a block weighs less: no single one proves a fault."""
_LEAST_BLOCKS = 4
_NAMED_BLOCKS, _OTHER_BLOCKS, _GONE_BLOCKS = 4, 6, 20
"""Blocks for which an explanation must last: a part, an unknown part, and no difference."""
_MAX_ONSETS = 12
_MAX_AGE = 240
"""Blocks after which a change is no longer new."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Faults that may explain the residuals together."""

    columns: tuple[int, ...]
    together: bool = False
    """Whether the columns share one size."""
    is_part: bool = True
    positive: bool = False
    """Whether its sizes cannot be negative."""
    least: float = 0.0
    """Least size, if larger than the least sizes of its columns."""

    def basis(self, count: int) -> Array:
        """Return the directions (p, count) of its faults."""
        unit = np.eye(count)[list(self.columns)]
        return np.atleast_2d(unit.sum(axis=0)) if self.together else unit


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Result of a test."""

    alike: tuple[Hypothesis, ...]
    """Hypotheses that explain the residuals equally well; none if nothing known does."""
    sizes: Array
    """(p,): fault sizes of the first."""
    begun: int
    """Block at which it began: at 0 the robot differs from its description, later it has changed.
    """
    evidence: float

    @property
    def explanation(self) -> tuple[int, ...]:
        """Columns of the fault that explains all; empty if it is unknown or one of several."""
        return self.alike[0].columns if len(self.alike) == 1 else ()


def with_pairs(singles: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses of single faults, and of two faults at once."""
    pairs = itertools.combinations(singles, 2)
    return [*singles, *(replace(a, columns=a.columns + b.columns) for a, b in pairs)]


class FaultFilter:
    """Tests hypotheses about columns of a linear model with nuisances."""

    def __init__(
        self, sigma: Array, scale: Array, least: Array, hypotheses: Sequence[Hypothesis]
    ) -> None:
        """`sigma` (n,): nuisances. `scale` and `least` (f,): typical and least fault sizes.

        Columns without a hypothesis are disturbances that are not parts.
        """
        self.sigma = sigma
        self.scale = scale
        """(f,): typical fault sizes."""
        self._hypotheses = list(hypotheses)
        others = set(range(len(scale))).difference(*(each.columns for each in hypotheses))
        self._all = [*hypotheses, *(Hypothesis((i,), is_part=False) for i in sorted(others))]
        self._bases = [each.basis(len(scale)) for each in self._all]
        self._leasts = [
            np.maximum(np.abs(basis) @ least / np.abs(basis).sum(axis=1), each.least)
            for basis, each in zip(self._bases, self._all, strict=True)
        ]
        self._costs = [_SECOND * (len(each.columns) - 1) for each in self._all]
        singles = [i for i, basis in enumerate(self._bases) if len(basis) == 1]
        self._single: Array = np.concatenate([self._bases[i] for i in singles])
        self._single_least: Array = np.concatenate([self._leasts[i] for i in singles])
        self._single_scale: Array = self._sizes(self._single)
        self._single_cost: Array = np.array([self._costs[i] for i in singles])
        self.restart()

    def restart(self) -> None:
        """Forget all that was learned."""
        sigma, count = self.sigma, len(self.scale)
        self.state: Array = np.zeros(len(sigma))
        self.covariance: Array = np.diag(sigma**2)
        self._begun = [0]
        """Block at which a fault may have begun, for each onset; the first is the start."""
        self._learned: Array = np.zeros((1, len(sigma), count))
        self._information: Array = np.zeros((1, count, count))
        self._match: Array = np.zeros((1, count))
        self._blocks = 0
        self._same: tuple[tuple[int, ...] | None, int] = (None, 0)
        """Explanation of the last blocks, and their number."""
        self.verdict: Verdict | None = None
        """Verdict that has lasted for some blocks, or None while nothing differs."""

    def predict(self, kept: Array, walk: Array, source: npt.NDArray[np.int_] | None = None) -> None:
        """Advance the nuisances: `kept` (n,) correlations with the past, `walk` (n,) per block.

        `source` (n,) are the indices of their former places.
        """
        if source is not None:
            self.state, self.covariance = self.state[source], self.covariance[source][:, source]
            self._learned = self._learned[:, source]
        self.state = kept * self.state
        self.covariance = kept[:, None] * self.covariance * kept
        self.covariance[np.diag_indices(len(kept))] += (1.0 - kept**2) * self.sigma**2 + walk**2
        self._learned = kept[:, None] * self._learned

    def add(self, error: Array, rows: Array, columns: Array, noise: Array) -> None:
        """Add a residual (d,) with Jacobians of nuisances (d, n) and of faults (d, f).

        `noise` (d, d) is its covariance.
        """
        innovation = error - rows @ self.state
        crossed = rows @ self.covariance
        covariance = crossed @ rows.T + noise
        solve = np.linalg.inv(covariance)
        squared = float(innovation @ solve @ innovation)
        solve = solve * min(1.0, _MAX_SQUARED * len(error) / max(squared, 1e-12))
        gain = crossed.T @ solve
        shown = columns - rows @ self._learned
        weighed = np.swapaxes(shown, 1, 2) @ solve
        self._information = self._information + weighed @ shown
        self._match = self._match + weighed @ innovation
        self.state = self.state + gain @ innovation
        self.covariance = self.covariance - gain @ crossed
        self._learned = self._learned + gain @ shown
        self._blocks += 1
        self._begin()
        if self._has_changed():
            unknown = self.verdict is not None and not self.verdict.explanation
            verdict = self.verdict
            self.restart()
            self.verdict = verdict if unknown else None
        else:
            self._report(self._judge())

    def _report(self, raw: Verdict | None) -> None:
        """Report an explanation that has lasted."""
        found = None if raw is None else raw.explanation
        same, count = self._same
        self._same = (found, count + 1 if found == same else 1)
        now = None if self.verdict is None else self.verdict.explanation
        blocks = _NAMED_BLOCKS if found else _OTHER_BLOCKS if found is not None else _GONE_BLOCKS
        if found == now or self._same[1] >= blocks:
            self.verdict = raw

    def _has_changed(self) -> bool:
        """Return whether the reported fault has been repaired, or an unknown one has changed."""
        if self.verdict is None:
            return False
        newer = range(self._reported() + 1, len(self._begun))
        sizes = self.verdict.sizes
        bases = [each.basis(len(self.scale)) for each in self.verdict.alike[:1]]
        for onset in newer:
            if self._blocks - self._begun[onset] < _LEAST_BLOCKS:
                continue
            for basis in bases if self.verdict.explanation else self._single[:, None]:
                evidence, _, change = self.evidence(onset, basis)
                back = not self.verdict.explanation or float(change @ sizes) < -0.5 * sizes @ sizes
                if evidence >= EVIDENCE and back:
                    return True
        return False

    def _reported(self) -> int:
        """Return the index of the onset of the reported fault; the first if it is unknown."""
        begun = 0 if self.verdict is None else self.verdict.begun
        return self._begun.index(begun) if begun in self._begun else 0

    def _begin(self) -> None:
        """Add an onset, and drop one of many, so that older ones are further apart."""
        ages = [self._blocks - begun for begun in self._begun]
        pinned = {0, self._reported()}
        drop = [i for i in range(1, len(ages)) if ages[i] > _MAX_AGE and i not in pinned]
        if not drop and len(ages) >= _MAX_ONSETS:
            places = [i for i in range(2, len(ages) - 1) if i not in pinned]
            drop = [min(places, key=lambda i: (ages[i - 1] - ages[i + 1]) / ages[i])]
        kept = [i for i in range(len(ages)) if i not in drop]
        self._begun = [*(self._begun[i] for i in kept), self._blocks]

        def grown(values: Array) -> Array:
            return np.concatenate([values[kept], np.zeros((1, *values.shape[1:]))])

        self._learned = grown(self._learned)
        self._information, self._match = grown(self._information), grown(self._match)

    def _sizes(self, basis: Array) -> Array:
        """Return the typical sizes (p,) of faults along `basis` (p, f)."""
        sizes: Array = np.abs(basis) @ self.scale / np.abs(basis).sum(axis=1)
        return sizes

    def evidence(self, onset: int, basis: Array) -> tuple[float, float, Array]:
        """Return evidence and explained half square of faults along `basis` (p, f), and sizes."""
        information: Array = basis @ self._information[onset] @ basis.T
        match: Array = basis @ self._match[onset]
        prior: Array = np.diag(self._sizes(basis) ** -2.0)
        sizes: Array = np.asarray(np.linalg.solve(information + prior, match), dtype=float)
        half = 0.5 * float(match @ sizes)
        occam = np.linalg.slogdet(prior + information)[1] - np.log(np.diag(prior)).sum()
        return half - 0.5 * float(occam), half, sizes

    def _judge(self) -> Verdict | None:
        match = self._match @ self._single.T
        information = np.einsum("pf,ofg,pg->op", self._single, self._information, self._single)
        sizes = match / (information + self._single_scale**-2.0)
        half = 0.5 * match * sizes
        evidence = half - 0.5 * np.log1p(information * self._single_scale**2) - self._single_cost
        # From the start: half the square of the learned value in described standard deviations.
        evidence[0] = half[0] + EVIDENCE - START_EVIDENCE
        evidence = np.where(np.abs(sizes) >= self._single_least, evidence, 0.0)
        old = np.array([self._blocks - begun >= _LEAST_BLOCKS for begun in self._begun])
        by_onset = np.where(old, evidence.max(axis=1), 0.0)
        onset = int(by_onset.argmax())
        most = float(by_onset[onset])
        if most < (EVIDENCE if self.verdict is None else 0.5 * EVIDENCE):
            return None
        named = self._named(onset)
        if named is None and most < UNKNOWN_EVIDENCE and self.verdict is None:
            return None
        alike, found = named or ((), np.zeros(0))
        return Verdict(alike, found, self._begun[onset], most)

    def _named(self, onset: int) -> tuple[tuple[Hypothesis, ...], Array] | None:
        """Return the hypotheses that explain all, and the sizes of the best, or None."""
        results = [
            (evidence - cost, half, sizes)
            for cost, (evidence, half, sizes) in zip(
                self._costs, (self.evidence(onset, basis) for basis in self._bases), strict=True
            )
        ]
        whole: Array = np.eye(len(self.scale))
        _, most, _ = self.evidence(onset, whole)
        prior: Array = np.diag(self.scale**-2.0)
        information = self._information[onset]
        seen: Array = np.asarray(np.linalg.solve(information + prior, information), dtype=float)
        freedom = float(np.trace(seen))
        order = sorted(range(len(results)), key=lambda i: -results[i][0])
        best = order[0]
        evidence, half, sizes = results[best]
        chosen = self._all[best]
        left = max(1, round(freedom - len(sizes)))
        remainder = 2.0 * (most - half)
        known = self.verdict is not None and self.verdict.explanation == chosen.columns
        share = _MODEL_SHARE * (2.0 if known else 1.0)
        bound = chi_square_bound(left, _REMAINDER_TAIL) + 2.0 * share * half
        if remainder > bound or (np.abs(sizes) < self._leasts[best]).any() or not chosen.is_part:
            return None
        if chosen.positive and (sizes < 0.0).any():
            return None
        alike = [
            self._all[i]
            for i in order
            if results[i][0] > evidence - _MARGIN
            and len(self._bases[i]) <= len(self._bases[best])
            and not set(chosen.columns) < set(self._all[i].columns)
        ]
        if any(not each.is_part for each in alike):
            return None
        return tuple(alike), sizes
