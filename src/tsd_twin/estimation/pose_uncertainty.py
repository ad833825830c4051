"""Pose uncertainty of dead reckoning: accumulated biases and white noise.

Also computes confidence regions of the pose. Derived in `docs/estimation.md`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array, sinc

_Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class TwistErrors:
    """Errors of an estimated twist, in base axes.

    The true twist is the estimated twist, plus `bias_jacobian @ u` with biases `u` that are
    independent and standard normal, plus white noise.
    """

    bias_jacobian: Array
    """(3, m): Jacobian with respect to the biases."""
    white_per_s: Array
    """(3, 3): covariance that white noise adds to the integrated twist per second."""
    covariance: Array
    """(3, 3): total covariance of the twist, from biases and noise."""

    @staticmethod
    def none(biases: int) -> TwistErrors:
        """Return the errors of an exact twist."""
        return TwistErrors(np.zeros((3, biases)), np.zeros((3, 3)), np.zeros((3, 3)))

    @property
    def is_exact(self) -> bool:
        """Whether all errors are zero."""
        return not (self.bias_jacobian.any() or self.white_per_s.any())


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of an estimated pose: `bias_jacobian @ u` with the biases `u`, plus process noise."""

    bias_jacobian: Array
    """(3, m): Jacobian with respect to the biases."""
    noise_cov: Array
    """(3, 3): covariance of the process noise, which is independent of the biases."""

    @property
    def covariance(self) -> Array:
        """(3, 3): covariance of the pose."""
        return self.bias_jacobian @ self.bias_jacobian.T + self.noise_cov


_SAMPLES = 128
"""Approximate number of samples."""


def bias_samples(biases: int) -> Array:
    """Return deterministic samples (n, m) of standard normal biases.

    Their first five moments about the origin match the normal distribution: mean and covariance
    exactly, the fourth moment averaged over all directions.
    """
    random = np.random.default_rng(0)
    dimensions = max(biases, 3)
    pairs = max(1, round(_SAMPLES / (4 * dimensions)))
    # Two vector lengths give squared lengths the mean m and the variance 2 m.
    lengths = [math.sqrt(dimensions + sign * math.sqrt(2.0 * dimensions)) for sign in (-1.0, 1.0)]
    blocks = [
        length * np.linalg.qr(random.standard_normal((dimensions, dimensions)))[0]
        for _ in range(pairs)
        for length in lengths
    ]
    half = np.concatenate(blocks)
    return np.concatenate([half, -half])[:, :biases]


class _SampleState(Protocol):
    """State of a pose uncertainty."""

    @property
    def noise_cov(self) -> Array:
        """(3, 3): covariance of the white noise."""
        ...


StateT = TypeVar("StateT", bound=_SampleState)


class PoseUncertainty(ABC, Generic[PoseT, StateT]):
    """Pose uncertainty in exponential coordinates about the axes of `odom`.

    Each sample is a robot with its own biases. All samples follow the measured twists, each with
    the error caused by its biases. The covariance is their second moment plus the covariance of the
    white noise. Samples advance by blocks of steps.
    """

    def __init__(self, biases: int) -> None:
        self._biases = bias_samples(biases)
        self._errors = TwistErrors.none(biases)
        self._rates: Array = np.zeros((len(self._biases), 3))
        self._is_exact = True
        self._state: StateT = self._exact()
        self._begin()

    @property
    def bias_count(self) -> int:
        """Number of biases, m."""
        return self._biases.shape[1]

    @property
    def state(self) -> StateT | None:
        """State for `errors_at`, or None in the middle of a block."""
        return self._state if self._elapsed_s == 0.0 else None

    @property
    def covariance(self) -> Array:
        """(3, 3): covariance of the pose error."""
        if self._covariance is None:
            if self._began is None:
                self._began = self._coordinates(self._state)
            errors, noise_cov = self._began, self._state.noise_cov
            if self._elapsed_s > 0.0:
                # Within a block, linearize in the additional error.
                carry, by_twist = self._linear()
                errors = errors @ carry.T + self._rates @ by_twist.T
                noise_cov = self._ended_noise(carry)
            self._covariance = errors.T @ errors / len(errors) + noise_cov
        return self._covariance

    def errors_at(self, state: StateT) -> PoseErrors:
        """Return the pose errors of a `state`, linear in the biases by regression."""
        errors = self._coordinates(state)
        bias_jacobian = errors.T @ self._biases / len(errors)
        bent = errors.T @ errors / len(errors) - bias_jacobian @ bias_jacobian.T
        return PoseErrors(bias_jacobian, bent + state.noise_cov)

    def set(self, errors: PoseErrors | None) -> None:
        """Set the pose errors; None means zero."""
        self._state = self._exact() if errors is None else self._given(errors)
        self._begin()

    def refresh(self, errors: TwistErrors) -> None:
        """End the block, assuming that twist errors changed linearly to `errors`."""
        rates = self._rates
        if errors is not self._errors:
            rates = self._biases @ errors.bias_jacobian.T
        if self._elapsed_s > 0.0:
            self._state = self._ended(0.5 * (self._rates + rates))
            self._begin()
        self._errors, self._rates, self._is_exact = errors, rates, errors.is_exact

    def step(self, before: PoseT, after: PoseT, twist: Array, dt_s: float) -> None:
        """Advance from one estimated pose to another by `twist` (3,)."""
        if self._is_exact and not twist.any():
            return  # All samples are at rest.
        self._advance(before, after, twist, dt_s)
        self._elapsed_s += dt_s
        self._covariance = None

    def _begin(self) -> None:
        """Begin a block of steps."""
        self._elapsed_s = 0.0
        self._covariance: Array | None = None
        self._began: Array | None = None
        """(n, 3): errors at the start of the block, in exponential coordinates."""
        self._clear()

    @abstractmethod
    def _clear(self) -> None:
        """Clear the sums over a block."""

    @abstractmethod
    def _advance(self, before: PoseT, after: PoseT, twist: Array, dt_s: float) -> None:
        """Add a step to the block."""

    @abstractmethod
    def _linear(self) -> tuple[Array, Array]:
        """Return the Jacobians (3, 3) of the errors w.r.t. the initial errors and the twist."""

    @abstractmethod
    def _ended_noise(self, carry: Array) -> Array:
        """Return the covariance (3, 3) of the white noise at the end of the block."""

    @abstractmethod
    def _ended(self, rates: Array) -> StateT:
        """Return the state at the end of the block, for samples with twist errors (n, 3)."""

    @abstractmethod
    def _exact(self) -> StateT:
        """Return the state without errors."""

    @abstractmethod
    def _given(self, errors: PoseErrors) -> StateT:
        """Return the state with pose errors."""

    @abstractmethod
    def _coordinates(self, state: StateT) -> Array:
        """Return the errors (n, 3) of the samples in exponential coordinates."""


class SE2Samples(NamedTuple):
    """Samples of planar poses, and the white noise."""

    position_error: _Complex
    """(n,): position error x + i y of each sample."""
    heading_error: Array
    """(n,): heading error of each sample."""
    noise_cov: Array
    """(3, 3): covariance of the white noise."""


class SE2Uncertainty(PoseUncertainty[SE2, SE2Samples]):
    """Uncertainty of a planar pose: x, y, heading."""

    def _clear(self) -> None:
        self._way = 0j
        """Estimated displacement in the block."""
        self._by_velocity = 0j
        """Derivative of the displacement w.r.t. an error of vx; for vy, rotate by 90°."""
        self._by_turn_rate = 0j
        """Derivative of the displacement w.r.t. an error of omega."""
        self._heading_s = 0.0

    def _advance(self, before: SE2, after: SE2, twist: Array, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        x, y, heading = before.xy_heading.tolist()
        x_after, y_after, heading_after = after.xy_heading.tolist()
        way = complex(x_after - x, y_after - y)
        middle = 0.5 * (heading + heading_after)
        self._by_turn_rate += 1j * way * (self._elapsed_s + 0.5 * dt_s)
        self._by_velocity += dt_s * complex(math.cos(middle), math.sin(middle))
        self._way += way
        self._heading_s += dt_s * middle

    def _ended(self, rates: Array) -> SE2Samples:
        off, turned, _ = self._state
        error = self._by_velocity * (rates[:, 0] + 1j * rates[:, 1])
        error += self._by_turn_rate * rates[:, 2]
        # A sample's heading error rotates its displacement in this block.
        off = off + np.exp(1j * turned) * (self._way + error) - self._way
        turned = turned + self._elapsed_s * rates[:, 2]
        return SE2Samples(off, turned, self._ended_noise(self._linear()[0]))

    def _linear(self) -> tuple[Array, Array]:
        x, y = self._way.real, self._way.imag
        c, s = self._by_velocity.real, self._by_velocity.imag
        far, left = self._by_turn_rate.real, self._by_turn_rate.imag
        carry = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
        return carry, np.array([[c, -s, far], [s, c, left], [0.0, 0.0, self._elapsed_s]])

    def _ended_noise(self, carry: Array) -> Array:
        heading = self._heading_s / self._elapsed_s
        c, s = math.cos(heading), math.sin(heading)
        axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        grown = axes @ (self._elapsed_s * self._errors.white_per_s) @ axes.T
        return carry @ self._state.noise_cov @ carry.T + grown

    def _exact(self) -> SE2Samples:
        samples = len(self._biases)
        return SE2Samples(np.zeros(samples, dtype=complex), np.zeros(samples), np.zeros((3, 3)))

    def _given(self, errors: PoseErrors) -> SE2Samples:
        along = self._biases @ errors.bias_jacobian.T
        off = (along[:, 0] + 1j * along[:, 1]) * chord(along[:, 2])
        return SE2Samples(off, along[:, 2], errors.noise_cov)

    def _coordinates(self, state: SE2Samples) -> Array:
        off = state.position_error / chord(state.heading_error)
        return np.stack([off.real, off.imag, state.heading_error], axis=-1)


def chord(turned: Array) -> _Complex:
    """Return the complex factor by which a turn by `turned` (...) deforms a straight line.

    Clamped at half a turn, beyond which exponential coordinates are ambiguous.
    """
    half = np.clip(0.5 * turned, -0.5 * np.pi, 0.5 * np.pi)
    return np.asarray(sinc(half) * np.exp(1j * half), dtype=complex)


def exponential_error(estimate: SE2, true: SE2) -> Array:
    """Return the error (..., 3) of an estimate in exponential coordinates, axes of `odom`.

    Moving `estimate` by the error as a constant twist in these axes yields `true`. Covariances of
    planar poses refer to these coordinates. Heading differences are wrapped.
    """
    off = true.xy_heading - estimate.xy_heading
    turned = (off[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    straight = (off[..., 0] + 1j * off[..., 1]) / chord(turned)
    return np.stack([straight.real, straight.imag, turned], axis=-1)


class SO3Samples(NamedTuple):
    """Samples of orientations, and the white noise."""

    rotation_error: Array
    """(n, 3): rotation vector from the estimated orientation to each sample."""
    noise_cov: Array
    """(3, 3): covariance of the white noise."""


class SO3Uncertainty(PoseUncertainty[SO3, SO3Samples]):
    """Uncertainty of a sphere's orientation, as rotation vectors about the base axes."""

    def _clear(self) -> None:
        self._carry: Array = np.eye(3)
        self._by_twist: Array = np.zeros((3, 3))

    def _advance(self, before: SO3, after: SO3, twist: Array, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        turn = SO3.exp(dt_s * twist).as_matrix()
        self._carry = turn @ self._carry
        self._by_twist = turn @ self._by_twist + dt_s * np.eye(3)

    def _ended(self, rates: Array) -> SO3Samples:
        gained, carried = (
            SO3.exp(rates @ self._by_twist.T),
            SO3.exp(self._state.rotation_error @ self._carry.T),
        )
        return SO3Samples((gained @ carried).log(), self._ended_noise(self._carry))

    def _linear(self) -> tuple[Array, Array]:
        return self._carry, self._by_twist

    def _ended_noise(self, carry: Array) -> Array:
        return carry @ self._state.noise_cov @ carry.T + self._elapsed_s * self._errors.white_per_s

    def _exact(self) -> SO3Samples:
        return SO3Samples(np.zeros((len(self._biases), 3)), np.zeros((3, 3)))

    def _given(self, errors: PoseErrors) -> SO3Samples:
        return SO3Samples(self._biases @ errors.bias_jacobian.T, errors.noise_cov)

    def _coordinates(self, state: SO3Samples) -> Array:
        return state.rotation_error


SPREADS: dict[type[Any], type[PoseUncertainty[Any, Any]]] = {
    SE2: SE2Uncertainty,
    SO3: SO3Uncertainty,
}
"""Uncertainty class for each pose type."""


REGION_SIGMAS = 2.0
"""Radius of the position region, in standard deviations."""
REGION_SHARE = 1.0 - math.exp(-0.5 * REGION_SIGMAS**2)
"""Probability of the position and heading regions: 86 %."""
HEADING_SIGMAS = NormalDist().inv_cdf(0.5 * (1.0 + REGION_SHARE))
"""Half-width of the heading region, in standard deviations, for the same probability."""
_SIDES = 48


def position_region(covariance: Array) -> Array:
    """Return the outline (n, 2) of the position region, relative to the estimated position.

    `covariance` (3, 3) is the pose covariance in exponential coordinates, axes of `odom`, where the
    region is an ellipse. On the floor it is bent, because each point has a different most likely
    heading.
    """
    angles = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    variances = np.maximum(variances, 0.0)
    errors = REGION_SIGMAS * np.sqrt(variances) * circle @ axes.T
    # Regression of the heading on the position along the principal axes; zero along an axis without
    # extent.
    along = np.where(variances > 0.0, 1.0 / np.maximum(variances, 1e-300), 0.0)
    turned = errors @ (axes * along) @ axes.T @ covariance[:2, 2]
    bent = (errors[:, 0] + 1j * errors[:, 1]) * chord(turned)
    return np.stack([bent.real, bent.imag], axis=-1)


def heading_region_rad(covariance: Array) -> float:
    """Return the half-width of the heading region, at most half a turn."""
    return min(HEADING_SIGMAS * math.sqrt(max(float(covariance[2, 2]), 0.0)), math.pi)
