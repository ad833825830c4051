"""Pose uncertainty of odometry: accumulated biases and white noise.

`joint_errors.py` gives the errors of joints and floor, `wheel_odometry.py` turns them into the
twist errors integrated here. Also computes confidence regions of the pose. Derived in
`docs/estimation.md`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from statistics import NormalDist
from typing import Generic, TypeVar

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


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of an estimated pose: `bias_jacobian @ u` with the biases `u`, plus noise."""

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


SamplesT = TypeVar("SamplesT")


class PoseUncertainty(ABC, Generic[PoseT, SamplesT]):
    """Pose uncertainty in exponential coordinates about the axes of `odom`.

    Each sample is a robot with its own biases. All samples follow the measured twists, each with
    the error caused by its biases. The covariance is their second moment plus the covariance of the
    white noise. Samples advance by blocks of steps.
    """

    def __init__(self, biases: int) -> None:
        self._biases = bias_samples(biases)
        self._errors = TwistErrors.none(biases)
        self._twist_errors: Array = np.zeros((len(self._biases), 3))
        """(n, 3): twist error of each sample."""
        self._is_exact = True
        self.set(None)

    def _begin(self) -> None:
        """Begin a block of steps."""
        self._elapsed_s = 0.0
        self._covariance: Array | None = None
        self._initial: Array | None = None
        """(n, 3): errors at the start of the block, in exponential coordinates."""
        self._clear()

    @property
    def bias_count(self) -> int:
        """Number of biases, m."""
        return self._biases.shape[1]

    @property
    def state(self) -> tuple[SamplesT, Array] | None:
        """Samples and noise covariance for `errors_at`, or None in the middle of a block."""
        return (self._samples, self._noise_cov) if self._elapsed_s == 0.0 else None

    @property
    def covariance(self) -> Array:
        """(3, 3): covariance of the pose error."""
        if self._covariance is None:
            if self._initial is None:
                self._initial = self._coordinates(self._samples)
            errors, noise_cov = self._initial, self._noise_cov
            if self._elapsed_s > 0.0:
                # Within a block, linearize in the additional error.
                carry, by_twist = self._linear()
                errors = errors @ carry.T + self._twist_errors @ by_twist.T
                noise_cov = self._ended_noise(carry)
            self._covariance = errors.T @ errors / len(errors) + noise_cov
        return self._covariance

    def errors_at(self, state: tuple[SamplesT, Array]) -> PoseErrors:
        """Return the pose errors of a `state`, linear in the biases by regression."""
        samples, noise_cov = state
        errors = self._coordinates(samples)
        bias_jacobian = errors.T @ self._biases / len(errors)
        bent = errors.T @ errors / len(errors) - bias_jacobian @ bias_jacobian.T
        return PoseErrors(bias_jacobian, bent + noise_cov)

    def set(self, errors: PoseErrors | None) -> None:
        """Set the pose errors; None means zero."""
        if errors is None:
            errors = PoseErrors(np.zeros((3, self.bias_count)), np.zeros((3, 3)))
        self._samples: SamplesT = self._displaced(self._biases @ errors.bias_jacobian.T)
        self._noise_cov: Array = errors.noise_cov
        self._begin()

    def refresh(self, errors: TwistErrors) -> None:
        """End the block, assuming that twist errors changed linearly to `errors`."""
        twist_errors = self._twist_errors
        if errors is not self._errors:
            twist_errors = self._biases @ errors.bias_jacobian.T
        if self._elapsed_s > 0.0:
            noise_cov = self._ended_noise(self._linear()[0])
            self._samples = self._ended(0.5 * (self._twist_errors + twist_errors))
            self._noise_cov = noise_cov
            self._begin()
        self._errors, self._twist_errors = errors, twist_errors
        self._is_exact = not (errors.bias_jacobian.any() or errors.white_per_s.any())

    def step(self, before: PoseT, after: PoseT, twist: Array, dt_s: float) -> None:
        """Advance from one estimated pose to another by `twist` (3,)."""
        if self._is_exact and not twist.any():
            return  # All samples are at rest.
        self._advance(before, after, twist, dt_s)
        self._elapsed_s += dt_s
        self._covariance = None

    def _ended_noise(self, carry: Array) -> Array:
        """Return the covariance (3, 3) of the white noise at the end of the block."""
        return carry @ self._noise_cov @ carry.T + self._block_noise()

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
    def _block_noise(self) -> Array:
        """Return the covariance (3, 3) that white noise adds over the block."""

    @abstractmethod
    def _ended(self, twist_errors: Array) -> SamplesT:
        """Return the samples at the end of the block, given their twist errors (n, 3)."""

    @abstractmethod
    def _displaced(self, errors: Array) -> SamplesT:
        """Return samples with errors (n, 3) in exponential coordinates."""

    @abstractmethod
    def _coordinates(self, samples: SamplesT) -> Array:
        """Return the errors (n, 3) of the samples in exponential coordinates."""


class PlanarBlock:
    """Displacement over a block of steps, and its derivatives w.r.t. constant twist errors."""

    def __init__(self) -> None:
        self.elapsed_s = 0.0
        self.displacement = 0j
        self.by_velocity = 0j
        """Derivative of the displacement w.r.t. an error of vx; for vy, rotate by 90°."""
        self.by_turn_rate = 0j
        """Derivative of the displacement w.r.t. an error of omega."""
        self._heading_s = 0.0

    def add(self, displacement: complex, direction: complex, heading: float, dt_s: float) -> None:
        """Add a step of `dt_s`; `heading` and its unit vector `direction` are at its midpoint."""
        self.by_turn_rate += 1j * displacement * (self.elapsed_s + 0.5 * dt_s)
        self.by_velocity += dt_s * direction
        self.displacement += displacement
        self._heading_s += dt_s * heading
        self.elapsed_s += dt_s

    def jacobians(self) -> tuple[Array, Array]:
        """Return the Jacobians (3, 3) of the final error w.r.t. the initial and the twist error."""
        x, y = self.displacement.real, self.displacement.imag
        c, s = self.by_velocity.real, self.by_velocity.imag
        far, left = self.by_turn_rate.real, self.by_turn_rate.imag
        carry = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
        return carry, np.array([[c, -s, far], [s, c, left], [0.0, 0.0, self.elapsed_s]])

    def axes(self) -> Array:
        """Return the rotation (3, 3) from base axes to the axes of `odom`, at the mean heading."""
        heading = self._heading_s / self.elapsed_s
        c, s = math.cos(heading), math.sin(heading)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class SE2Uncertainty(PoseUncertainty[SE2, tuple[_Complex, Array]]):
    """Uncertainty of a planar pose: x, y, heading.

    The samples are position errors x + i y and heading errors, (n,) each.
    """

    def _clear(self) -> None:
        self._block = PlanarBlock()

    def _advance(self, before: SE2, after: SE2, twist: Array, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        x, y, heading = before.xy_heading.tolist()
        x_after, y_after, heading_after = after.xy_heading.tolist()
        middle = 0.5 * (heading + heading_after)
        direction = complex(math.cos(middle), math.sin(middle))
        self._block.add(complex(x_after - x, y_after - y), direction, middle, dt_s)

    def _linear(self) -> tuple[Array, Array]:
        return self._block.jacobians()

    def _block_noise(self) -> Array:
        axes = self._block.axes()
        return axes @ (self._elapsed_s * self._errors.white_per_s) @ axes.T

    def _ended(self, twist_errors: Array) -> tuple[_Complex, Array]:
        (position_error, heading_error), block = self._samples, self._block
        added = block.by_velocity * (twist_errors[:, 0] + 1j * twist_errors[:, 1])
        added += block.by_turn_rate * twist_errors[:, 2]
        # A sample's heading error rotates its displacement in this block.
        rotated = np.exp(1j * heading_error) * (block.displacement + added)
        position_error = position_error + rotated - block.displacement
        return position_error, heading_error + self._elapsed_s * twist_errors[:, 2]

    def _displaced(self, errors: Array) -> tuple[_Complex, Array]:
        return (errors[:, 0] + 1j * errors[:, 1]) * chord(errors[:, 2]), errors[:, 2]

    def _coordinates(self, samples: tuple[_Complex, Array]) -> Array:
        position_error, heading_error = samples
        straight = position_error / chord(heading_error)
        return np.stack([straight.real, straight.imag, heading_error], axis=-1)


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


class SO3Uncertainty(PoseUncertainty[SO3, Array]):
    """Uncertainty of a sphere's orientation, as rotation vectors about the base axes.

    The samples are rotation vectors (n, 3) from the estimated orientation.
    """

    def _clear(self) -> None:
        self._carry: Array = np.eye(3)
        self._by_twist: Array = np.zeros((3, 3))

    def _advance(self, before: SO3, after: SO3, twist: Array, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        turn = SO3.exp(dt_s * twist).as_matrix()
        self._carry = turn @ self._carry
        self._by_twist = turn @ self._by_twist + dt_s * np.eye(3)

    def _linear(self) -> tuple[Array, Array]:
        return self._carry, self._by_twist

    def _block_noise(self) -> Array:
        return self._elapsed_s * self._errors.white_per_s

    def _ended(self, twist_errors: Array) -> Array:
        gained = SO3.exp(twist_errors @ self._by_twist.T)
        carried = SO3.exp(self._samples @ self._carry.T)
        return (gained @ carried).log()

    def _displaced(self, errors: Array) -> Array:
        return errors

    def _coordinates(self, samples: Array) -> Array:
        return samples


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
