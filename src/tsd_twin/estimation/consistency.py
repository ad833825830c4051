"""Consistency of the measured joints: chi-square test of the forward-kinematics residual.

With more actuators than degrees of freedom, forward kinematics leaves a residual. If it exceeds its
noise, some joint does not move as measured; the test names the actuator that explains most of the
residual.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.estimation.joint_errors import JointNoise, jacobians
from tsd_twin.kinematics import JointKind, Kinematics, TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import JointCompliance, JointErrors

FALSE_ALARM = 1e-4
"""False-alarm probability per test of a healthy robot."""
_REMAINDER_TAIL = 0.01
_LEAD = 4.0
"""Lead of the suspect over the others, in units of the statistic: a likelihood ratio of 7."""
_DIFF_STEP = 1e-5
"""Finite-difference step: radians, or a fraction of the speed."""
_MIN_SIGMA = 1e-5
"""Minimum standard deviation (rad or rad/s), for joints described without noise."""
_MIN_SINGULAR_MPS = 1e-4
"""m/s: residual directions below this are rounding errors, as with three wheels (no redundancy)."""
_RANK = 1e-6
"""Rank tolerance, relative to the largest singular value."""


_COMPLIANCE_FACTORS = (0.25, 0.5, 0.75, 1.0)
"""Factors on the modelled contact force, which saturates as slip grows."""


@dataclass(frozen=True, slots=True, eq=False)
class ParityTest:
    """Chi-square parity test at one joint vector."""

    whiten: Array
    """(d, m): maps a residual to its parity vector: d independent, standard normal numbers."""
    threshold: float
    """Threshold for the squared norm of the parity vector; infinite for d = 0."""
    slopes: Array
    """(n, m): derivatives of the residual with respect to the joints."""

    @staticmethod
    def at(
        kinematics: Kinematics[Any], joints: Array, sigma: Array, *, common: Array | None = None
    ) -> ParityTest:
        """Return the test around `joints` (n,) with standard deviations `sigma` (n,).

        `common` (n,) is a joint deviation along a fixed direction, scaled by one standard normal
        number.
        """
        slopes = jacobians(kinematics, joints, _DIFF_STEP)[1].T
        scale = np.maximum(1.0, np.abs(joints))
        _, sizes, directions = np.linalg.svd(slopes * scale[:, None], full_matrices=False)
        # Singular values are in descending order.
        count = int(np.count_nonzero(sizes > _RANK * max(sizes[0], _MIN_SINGULAR_MPS)))
        if count == 0:
            return ParityTest(np.zeros((0, slopes.shape[1])), np.inf, slopes)
        basis = directions[:count]
        noise = (np.maximum(sigma, _MIN_SIGMA)[:, None] * slopes) @ basis.T
        covariance = noise.T @ noise
        if common is not None:
            together = common @ slopes @ basis.T
            covariance += together[:, None] * together
        root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        whiten: Array = np.asarray(np.linalg.solve(root, basis), dtype=float)
        return ParityTest(whiten, chi_square_bound(count, FALSE_ALARM), slopes)

    def statistic(self, residual: Array) -> Array:
        """Return the test statistic (...) for residuals (..., m)."""
        return np.square(residual @ self.whiten.T).sum(axis=-1)

    def single_faults(self, residual: Array, by_slip: Array | None = None) -> tuple[Array, Any]:
        """Return how much each joint explains of residuals (..., m), and whether one explains all.

        The first array (..., n) is in units of the statistic. One explains all if the remainder is
        below the 99th percentile of the noise. `by_slip` (n, m) is the joint deflection per unit of
        residual, for compliant joints. Explanations that include deflection of the other joints are
        used only if no single joint suffices.
        """
        white = residual @ self.whiten.T
        squared = np.square(white).sum(axis=-1)
        most = chi_square_bound(len(self.whiten) - 1, _REMAINDER_TAIL)
        # Unit vectors in parity space, one per faulty joint; zero if the fault is not observable.
        explained: Array = np.square(white @ _unit_lines(self.slopes @ self.whiten.T).T)
        enough: Any = squared - explained.max(axis=-1) <= most
        if by_slip is not None:
            each = [
                _unit_lines(slopes @ self.whiten.T) for slopes in self._compliant_slopes(by_slip)
            ]
            yielding = np.maximum.reduce([np.square(white @ lines.T) for lines in each])
            explained = np.where(enough[..., None], explained, yielding)
            enough = squared - explained.max(axis=-1) <= most
        return explained, enough

    def _compliant_slopes(self, by_slip: Array) -> list[Array]:
        """Return `slopes` including joint deflection, for each of `_COMPLIANCE_FACTORS`.

        A change of the residual deflects the other joints, which changes the residual again.
        """
        again, eye = self.slopes.T @ by_slip, np.eye(len(by_slip.T))
        return [
            np.asarray(np.linalg.solve(eye - share * again, self.slopes.T), dtype=float).T
            for share in _COMPLIANCE_FACTORS
        ]


def _unit_lines(lines: Array) -> Array:
    """Normalize lines (n, d) to unit length."""
    lengths: Array = np.sqrt(np.square(lines).sum(axis=1, keepdims=True))
    # The speed of an upright wheel is not observable; normalizing its line would amplify rounding.
    return np.where(lengths > _RANK * lengths.max(), lines / np.maximum(lengths, 1e-300), 0.0)


def is_plausible(off: Array, covariance: Array) -> bool:
    """Return whether a difference `off` (d,) is within the gate for its `covariance` (d, d).

    One in 10,000 correct ones is not.
    """
    distance_sq = float(off @ np.linalg.solve(covariance, off))
    return distance_sq <= chi_square_bound(len(off), FALSE_ALARM)


@functools.cache
def chi_square_bound(dimensions: int, beyond: float) -> float:
    """Return the chi-square quantile with tail probability `beyond` (< 0.3).

    Avoids scipy.special, whose import would take a third of a robot node's startup time.
    """
    if dimensions <= 0:
        return 0.0
    bound = float(dimensions)
    # Newton's method on the log survival function, which is nearly linear.
    for _ in range(10):
        survival, density = _chi_square(bound, dimensions)
        bound += math.log(survival / beyond) * survival / density
    return bound


def _chi_square(x: float, dimensions: int) -> tuple[float, float]:
    """Return survival function and density of the chi-square distribution at `x`.

    Each two additional dimensions increase the survival function by twice the density.
    """
    odd = dimensions % 2
    densities = [
        0.5 * (0.5 * x) ** (0.5 * d - 1.0) * math.exp(-0.5 * x) / math.gamma(0.5 * d)
        for d in range(2 - odd, dimensions + 1, 2)
    ]
    first = math.erfc(math.sqrt(0.5 * x)) if odd else 2.0 * densities[0]
    return first + 2.0 * sum(densities[1:]), densities[-1]


_SMOOTHING_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class ConsistencyResult:
    """Result of the consistency test."""

    residual_mps: float
    """Smoothed residual, RMS over the contacts."""
    level: float
    """Test statistic divided by its threshold; above 1, known noise does not explain it."""
    shares: Array
    """(k,): fraction of the squared residual that each actuator alone explains, 0 to 1."""
    suspect: int | None
    """Index of the suspected actuator if the residual exceeds the threshold.

    None if several explain it equally well: with four wheels there is one residual, which any of
    them explains.
    """


_EDGE_SHARE = math.sqrt(3.0 / chi_square_bound(3, FALSE_ALARM))
"""Standard deviation assigned to a dead band, as a fraction of its width. Dead bands are bounded,
not Gaussian: with this fraction, three modules with all joints at an edge just reach the threshold,
averaged over the choice of edges."""
_DEFLECTION_SIGMA = 0.3
"""Standard deviation of a joint's deflection, relative to the model: loads are unequal, and joints
move within their backlash."""
_PLAY_SHARE = 1.0 / math.sqrt(12.0)
"""Standard deviation of the uniform distribution on [0, 1]."""
_DECAY_S = 0.2
"""Decay time constant for the effects of past motion and load."""
_SETTLED_S = 3.0
"""Time after which unchanged joints no longer affect the result."""


class ConsistencyMonitor:
    """Compares the smoothed forward-kinematics residual with its expectation for a healthy robot.

    The residual excludes wheel rolling caused by turning gimbals, because setpoints are consistent
    without it. Joint errors such as servo steps and wrong wheel speeds persist and do not average
    out. Smoothing therefore only removes short disturbances, and the threshold still applies to a
    single sample. While a robot accelerates, its joints deflect and lag (see `JointCompliance`), by
    a common factor that is unknown between 0 and 1.

    The suspect is the actuator of the joint that alone explains the whole residual, if any;
    otherwise the actuator whose removal leaves the others most consistent. If two explain it
    equally well, nobody is suspected: either of two modules may explain an error in the distance
    between them.
    """

    def __init__(
        self,
        kinematics: Kinematics[Any],
        noise: JointErrors,
        compliance: JointCompliance | None = None,
    ) -> None:
        self._kinematics = kinematics
        self._noise = JointNoise(kinematics, noise)
        self._owners = [_owner(joint.name, kinematics.actuators) for joint in kinematics.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in kinematics.joints])
        self._compliance = compliance
        if compliance is not None:
            self._play_share = _PLAY_SHARE * self._is_angle
            self._edge_rad = _EDGE_SHARE * compliance.dead_band_rad * self._is_angle
        self._joints, self._same_s = b"", 0.0
        self._latest: TwistSolution = TwistSolution(np.zeros(3), np.zeros(0))
        """Motion for the latest joints, which have been unchanged for `_same_s`."""
        self._smooth: Array | None = None
        """(m + 3 + n,): smoothed residual, twist and joints."""
        self._tilt_error: Array = np.zeros(len(self._is_angle))
        """(n,): modelled deflection, smoothed like the residual."""
        self._maxima: Array = np.zeros(2 * len(self._is_angle))
        """(2n,): decaying maxima of the deflection and of the joint rates."""
        self._modelled: Array | None = None
        self._test: tuple[bytes, ParityTest] | None = None
        """Test and the joints it was built for, reused while they are unchanged."""

    def advance(self, joints: Array, dt_s: float, *, modelled: Array | None = None) -> None:
        """Update with joints (n,), `dt_s` after the last ones.

        `modelled` (n,) marks speeds supplied by a model, which cannot be inconsistent with each
        other.
        """
        self._modelled = modelled
        same = joints.tobytes()
        if same != self._joints:
            self._joints, self._latest = same, self._kinematics.forward(joints)
            self._same_s = 0.0
        elif self._same_s > _SETTLED_S:
            return
        self._same_s += dt_s
        # Use one array, because numpy's per-call overhead dominates at this size.
        newest = np.concatenate((self._latest.residual, self._latest.twist, joints))
        at = len(self._latest.residual)
        if self._smooth is None:
            self._smooth = newest.copy()
            self._smooth[:at] = 0.0
        share = 1.0 - math.exp(-dt_s / _SMOOTHING_S)
        self._smooth = smooth = self._smooth + share * (newest - self._smooth)
        if self._compliance is None:
            return
        # The derivative of a low-pass output is (input − output) / time constant.
        rates = (newest - smooth) / _SMOOTHING_S
        vx, vy, omega = smooth[at : at + 3].tolist()
        over_ground = rates[at : at + 3] + np.array([-omega * vy, omega * vx, 0.0])
        self._tilt_error = self._compliance.by_acceleration @ over_ground
        sizes = np.abs(np.concatenate((self._tilt_error, rates[at + 3 :])))
        kept = math.exp(-dt_s / _DECAY_S)
        self._maxima = np.maximum(sizes, kept * self._maxima)

    def judge(self, joints: Array) -> ConsistencyResult:
        """Evaluate the test for a robot whose joints are at `joints` (n,)."""
        residual = None if self._smooth is None else self._smooth[: len(self._latest.residual)]
        squared = 0.0 if residual is None else float(residual @ residual)
        if residual is None or squared == 0.0:
            return ConsistencyResult(0.0, 0.0, np.zeros(len(self._kinematics.actuators)), None)
        test = self._test_at(joints)
        level = float(test.statistic(residual)) / test.threshold
        shares = self._kinematics.fault_contribution(residual) / squared
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        suspect = self._suspect(test, residual, joints, shares) if level > 1.0 else None
        return ConsistencyResult(math.sqrt(squared / len(residual)), level, shares, suspect)

    def _suspect(
        self, test: ParityTest, residual: Array, joints: Array, shares: Array
    ) -> int | None:
        """Return the actuator that explains `residual` best, or None if another does as well."""
        explained, enough = test.single_faults(residual, self._by_slip(joints))
        by_actuator = shares * test.statistic(residual)
        if enough:
            by_actuator = np.zeros(len(shares))
            np.maximum.at(by_actuator, self._owners, explained)
        *_, second, best = np.sort(by_actuator)
        return int(by_actuator.argmax()) if best - second > _LEAD else None

    def _test_at(self, joints: Array) -> ParityTest:
        key = joints.tobytes() + self._maxima.tobytes()
        if self._test is None or self._test[0] != key:
            self._test = (key, self._made_test(joints))
        return self._test[1]

    def _made_test(self, joints: Array) -> ParityTest:
        sigma, compliance = self._noise.sigma(joints), self._compliance
        if self._modelled is not None:
            sigma = np.where(self._modelled, 0.0, sigma)
        if compliance is None:
            return ParityTest.at(self._kinematics, joints, sigma)
        deflection, rate = self._maxima[: len(joints)], self._maxima[len(joints) :]
        trail = np.minimum(compliance.lag_s * rate, compliance.backlash_rad)
        parts = (sigma, _DEFLECTION_SIGMA * deflection, self._play_share * trail, self._edge_rad)
        sigma = np.sqrt(np.square(parts).sum(axis=0))
        return ParityTest.at(self._kinematics, joints, sigma, common=self._tilt_error)

    def _by_slip(self, joints: Array) -> Array | None:
        """Return the joint deflection (n, m) per unit of residual, or None without compliance."""
        if self._compliance is None:
            return None
        return self._compliance.by_slip(float(np.abs(joints[~self._is_angle]).mean()))


def _owner(joint: str, actuators: tuple[str, ...]) -> int:
    """Return the index of a joint's actuator, whose name equals the joint's name or its prefix."""
    (owner,) = (
        i for i, name in enumerate(actuators) if joint == name or joint.startswith(name + "_")
    )
    return owner
