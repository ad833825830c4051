"""Calibration fit: nonlinear least squares of gimbal zeros, radii and wheel speeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize

from tsd_twin.calibration.drive_log import Recording
from tsd_twin.errors import TwinError
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.status import BiasStatus
from tsd_twin.robots import JointErrors
from tsd_twin.sensors.pose import CameraNoise

PRIOR_OFFSET_RAD, PRIOR_SHARE, PRIOR_DELAY_S = float(np.radians(1.0)), 0.05, 0.05
"""Standard deviations of the prior, which keeps unobservable parameters near zero."""
_STEP = 1e-4
"""Finite-difference step, relative to the prior: about 1e-4 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """Corrections of a robot's parameters relative to its description."""

    offset_rad: Array
    """(k, 2): alpha, beta."""
    wheel_radius: float
    """Factor on the wheel radius."""
    pivot_radius: float
    """Factor on the pivot radius."""
    spin: Array
    """(k,): factors on the wheel-speed setpoints."""
    layers: Array
    """(k, 2): sine and cosine of the periodic error of each printed wheel's radius, relative."""
    delay_s: float
    """Delay of joint measurements relative to the camera: clock offset and actuator bus."""


class CalibrationProblem:
    """Least-squares problem for gimbal zeros, both radii, wheel-speed differences and delay.

    Printed wheels with layers of `layer_m` have a radius that depends on their tilt
    (`WheelSurface`), by as much as a wrong zero of 0.02° or a pivot radius that is off by 0.3 %.
    Amplitude and phase of each wheel are unknowns as well.
    """

    def __init__(
        self, drive: SingularityKinematics, recordings: Sequence[Recording], layer_m: float = 0.0
    ) -> None:
        self.drive = drive
        self._layers_per_radius = drive.wheel_radius_m / layer_m if layer_m > 0.0 else 0.0
        self.modules = k = drive.modules
        self._drives: dict[float, SingularityKinematics] = {}
        self.measured = all(bool(np.isfinite(run.spin_rad_per_s).all()) for run in recordings)
        # Use differences, because a camera cannot separate a common speed factor from the wheel
        # radius.
        differences = np.linalg.svd(np.ones((1, k)))[2][1:].T
        self._spins = np.zeros((k, 0)) if self.measured else differences
        spins = self._spins.shape[1]
        layers = 2 * k if layer_m > 0.0 else 0
        self._spin_part = slice(2 * k + 2, 2 * k + 2 + spins)
        self._layer_part = slice(self._spin_part.stop, self._spin_part.stop + layers)
        self.is_reported = np.ones(self._layer_part.stop + 1, dtype=bool)
        """Whether each unknown is a result, not only a disturbance."""
        self.is_reported[self._layer_part] = False
        self.prior = np.array(
            [PRIOR_OFFSET_RAD] * (2 * k)
            + [PRIOR_SHARE] * (2 + spins)
            + [0.5 * layer_m / drive.wheel_radius_m * np.sqrt(0.5)] * layers
            + [PRIOR_DELAY_S]
        )
        self.names = [f"module{i + 1}_{part}" for i in range(k) for part in ("alpha", "beta")]
        self.names += ["wheel radius", "pivot radius"]
        self.names += [f"spin difference {i + 1}" for i in range(spins)]
        self.names += [f"module{i // 2 + 1} layers" for i in range(layers)]
        self.names += ["lateness of the joints"]

    def corrections(self, unknowns: Array) -> Corrections:
        """Return the corrections for a vector (u,) of unknowns."""
        k = self.modules
        spin = 1.0 + self._spins @ unknowns[self._spin_part]
        layers = np.resize(unknowns[self._layer_part], (k, 2))
        offset = unknowns[: 2 * k].reshape(k, 2)
        radii = 1.0 + unknowns[2 * k : 2 * k + 2]
        return Corrections(
            offset, float(radii[0]), float(radii[1]), spin, layers, float(unknowns[-1])
        )

    def start(self, learned: Mapping[str, BiasStatus]) -> Array:
        """Return the vector (u,) of the biases estimated by the robot, named as in its status.

        If wheel speeds are measured, a wheel that is too fast is one that is too large.
        """
        start = np.zeros(len(self.prior))
        modules = range(1, self.modules + 1)
        names = [f"module{i}_{part}_rad" for i in modules for part in ("alpha", "beta")]
        shares = [f"module{i}_wheel_share" for i in modules]
        found = {name: each.value for name, each in learned.items()}
        start[: 2 * self.modules] = [found.get(name, 0.0) for name in names]
        faster = np.array([found.get(name, 0.0) for name in shares])
        start[2 * self.modules] = faster.mean()
        start[self._spin_part] = self._spins.T @ faster
        return start

    def sigma(self, covariance: Array) -> Corrections:
        """Return the standard deviation of each correction, from the covariance (u, u)."""
        k = self.modules
        own = np.sqrt(np.diag(covariance))
        spins = covariance[self._spin_part, self._spin_part]
        spread = np.sqrt(np.einsum("ij,jk,ik->i", self._spins, spins, self._spins))
        radii, late_s = own[2 * k : 2 * k + 2], float(own[-1])
        layers = np.resize(own[self._layer_part], (k, 2))
        return Corrections(
            own[: 2 * k].reshape(k, 2), float(radii[0]), float(radii[1]), spread, layers, late_s
        )

    def residual(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return the residuals (m, 3): camera poses minus predicted poses."""
        return run.camera_poses - self.poses(run, unknowns, start)

    def poses(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return the predicted poses (m, 3) at the times of the camera."""
        right = self.corrections(unknowns)
        drive = self._with_pivots(right.pivot_radius)
        speeds = run.spin_rad_per_s if self.measured else run.commanded_rad_per_s * right.spin
        joints = np.empty((len(run.t_s), self.modules, 3))
        joints[..., :2] = run.angles_rad.reshape(-1, self.modules, 2) + right.offset_rad
        joints[..., 2] = speeds * self._surface(joints[..., :2], right.layers)
        flat = joints.reshape(len(joints), -1)
        dt_s = np.diff(run.t_s)[:, None]
        middle, rates = 0.5 * (flat[1:] + flat[:-1]), np.diff(flat, axis=0) / dt_s
        twists = right.wheel_radius * drive.forward(middle, rates).twist
        steps = SE2.exp(twists * dt_s).xy_heading
        heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
        turned = SE2(np.column_stack([np.zeros((len(steps), 2)), heading[:-1]]))
        xy = np.concatenate([np.zeros((1, 2)), np.cumsum(turned.rotate(steps[:, :2]), axis=0)])
        poses = (SE2(start) @ SE2(np.column_stack([xy, heading]))).xy_heading
        there = np.empty((len(run.camera_s), 3))
        for i in range(3):
            there[:, i] = np.interp(run.camera_s + right.delay_s, run.t_s, poses[:, i])
        return there

    def _surface(self, angles_rad: Array, layers: Array) -> Array | float:
        """Return the radius (n, k) of printed wheels at gimbal angles (n, k, 2), relative."""
        if self._layers_per_radius == 0.0:
            return 1.0
        lowered = 1.0 - np.cos(angles_rad).prod(axis=-1)
        phase = 2.0 * np.pi * self._layers_per_radius * lowered
        return 1.0 + layers[:, 0] * np.sin(phase) + layers[:, 1] * np.cos(phase)

    def by_unknowns(self, run: Recording, unknowns: Array, start: Array) -> Array:
        """Return the Jacobian (m, 3, u + 3) of the residuals w.r.t. scaled unknowns and start."""
        here = self.poses(run, unknowns, start)
        changes = np.zeros((*here.shape, len(unknowns) + 3))
        for i, step in enumerate(_STEP * self.prior):
            there = self.poses(run, unknowns + step * (np.arange(len(unknowns)) == i), start)
            changes[..., i] = (here - there) / _STEP
        changes[:, 0, -3] = changes[:, 1, -2] = changes[:, 2, -1] = -1.0
        changes[:, 0, -1], changes[:, 1, -1] = here[:, 1] - start[1], start[0] - here[:, 0]
        return changes

    def _with_pivots(self, factor: float) -> SingularityKinematics:
        """Return the kinematics with another pivot radius, from a cache."""
        if factor not in self._drives:
            pivot_radius_m = self.drive.pivot_radius_m * factor
            self._drives = {factor: replace(self.drive, pivot_radius_m=pivot_radius_m)}
        return self._drives[factor]


_KNOT_SPACING_S = 0.2
"""Step of the pose's random walk in the noise model."""
_MAX_MEANS = 120
"""Maximum number of frames per run; neighbours are redundant, and the cost is cubic."""


def whitening(
    drive: SingularityKinematics, run: Recording, camera: CameraNoise, joints: JointErrors
) -> Callable[[Array], Array]:
    """Return the whitening of a run's residuals (3 m,), or columns (3 m, c), to unit variance.

    Camera noise is independent between frames, but odometry errors are not: a heading error rotates
    all later displacements. Without whitening, the fit underestimates its variance.
    """
    frames = len(run.camera_s)
    each = -(-frames // _MAX_MEANS)
    groups = frames // each

    def means(values: Array) -> Array:
        # Over neighbouring frames, without an incomplete last group.
        by_frame = values[: 3 * groups * each].reshape(groups, each, 3, *values.shape[1:])
        return by_frame.mean(axis=1).reshape(3 * groups, *values.shape[1:])

    walk = means(_random_walk_effect(drive, run, joints.angle_rad))
    sigma = np.array([camera.sigma_m, camera.sigma_m, camera.sigma_rad])
    own = np.tile(np.square(sigma) / each, groups)
    unmix = np.linalg.inv(np.linalg.cholesky(walk @ walk.T + np.diag(own)))
    return lambda residual: unmix @ means(residual)


def _random_walk_effect(drive: SingularityKinematics, run: Recording, angle_rad: float) -> Array:
    """Return the effect (3 m, 3 g) on the poses of unit-variance steps at each of g knots."""
    knots = np.arange(run.t_s[0], run.t_s[-1], _KNOT_SPACING_S)
    here = np.column_stack([np.interp(knots, run.camera_s, run.camera_poses[:, i]) for i in (0, 1)])
    rim_mps = drive.wheel_radius_m * np.abs(run.commanded_rad_per_s).max(axis=0)
    by_angle = drive.twist_from_contacts * np.repeat(rim_mps, 2) * angle_rad
    dt_s = float(np.median(np.diff(run.t_s)))
    # Samples are independent, so their errors within a knot add up with the root of their
    # number.
    x, y, heading = np.sqrt(np.square(by_angle).sum(axis=1) * dt_s * _KNOT_SPACING_S)
    later = (run.camera_s[:, None] > knots).astype(float)
    steps = np.zeros((len(run.camera_s), 3, len(knots), 3))
    steps[:, 0, :, 0] = steps[:, 1, :, 1] = later * max(x, y)
    steps[:, 0, :, 2] = -later * heading * (run.camera_poses[:, None, 1] - here[:, 1])
    steps[:, 1, :, 2] = later * heading * (run.camera_poses[:, None, 0] - here[:, 0])
    steps[:, 2, :, 2] = later * heading
    return steps.reshape(3 * len(run.camera_s), -1)


_least_squares: Any = optimize.least_squares  # pyright: ignore  scipy is untyped.
_SEGMENT_S = 1.5
_ROBUST: Any = {"loss": "soft_l1", "f_scale": 5.0}
_UNOBSERVABLE = 1.0
"""A direction is unobservable if the data contain less information on it than the prior."""
_MIN_COMPONENT = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFit:
    """Result of the calibration fit."""

    found: Corrections
    sigma: Corrections
    """Standard deviations of the corrections."""
    common_spin_known: bool
    """If false, only the product of wheel radius and common speed is known, reported as the
    radius."""
    unobservable: list[str]
    """Unobservable directions, as combinations of unknowns."""
    before: list[Array]
    """Residuals (m, 3) of each run before the correction, metres and radians."""
    after: list[Array]
    """Residuals after the correction."""


def fit_calibration(
    drive: SingularityKinematics,
    recordings: Sequence[Recording],
    noise: CameraNoise,
    joints: JointErrors,
    speed_share: float = 0.0,
    learned: Mapping[str, BiasStatus] | None = None,
    layer_m: float = 0.0,
) -> CalibrationFit:
    """Fit the corrections to camera poses, weighted by camera and joint noise.

    The start pose of each run is unknown too. The initial guess comes from short parts of the runs,
    each started at a camera pose, because a gimbal error of 1° rotates a whole run many times over.
    That first fit starts from the biases `learned` by the robot.

    `speed_share` is the relative standard deviation of a common factor on all wheel speeds, due to
    the battery voltage. `layer_m` is the height of the layers of printed wheels.

    Raises:
        TwinError: If the fit does not converge.
    """
    problem = CalibrationProblem(drive, recordings, layer_m)
    weights = 1.0 / np.array([noise.sigma_m, noise.sigma_m, noise.sigma_rad])
    whitenings = [whitening(drive, run, noise, joints) for run in recordings]
    count = len(problem.prior)
    parts = [
        part
        for run in recordings
        for first_s in np.arange(run.t_s[0], run.t_s[-1] - _SEGMENT_S, 2.0 * _SEGMENT_S)
        if len((part := run.part(first_s, first_s + _SEGMENT_S)).camera_s) > 2
    ]
    at_frame = [part.part(part.camera_s[0], part.t_s[-1]) for part in parts]

    def rough(scaled: Array) -> Array:
        own = scaled * problem.prior
        each = [(problem.residual(p, own, p.camera_poses[0]) * weights).ravel() for p in at_frame]
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

    first_guess = problem.start(learned or {}) / problem.prior
    guess: Any = _least_squares(rough, first_guess, ftol=1e-3, **_ROBUST)
    starts = np.array([run.camera_poses[0] for run in recordings])
    first = np.concatenate([guess.x, (starts * weights).ravel()])
    best: Any = _least_squares(whole, first, jac=slopes, x_scale="jac", ftol=1e-8)
    if not best.success:
        raise TwinError("the calibration does not converge: was the camera on the same clock?")
    found = _make_fit(problem, recordings, weights, best.x, best.jac, starts)
    return replace(found, sigma=_with_speed_share(found, speed_share))


def _make_fit(
    problem: CalibrationProblem,
    recordings: Sequence[Recording],
    weights: Array,
    scaled: Array,
    jacobian: Array,
    seen_starts: Array,
) -> CalibrationFit:
    count = len(problem.prior)
    unknowns, starts = scaled[:count] * problem.prior, scaled[count:].reshape(-1, 3) / weights
    covariance: Array = np.linalg.inv(jacobian.T @ jacobian)[:count, :count].astype(float)
    covariance = covariance * np.outer(problem.prior, problem.prior)
    # Start poses are free, and so are disturbances within their prior.
    known = problem.is_reported
    rows = np.r_[: len(jacobian) - count, len(jacobian) - count + np.flatnonzero(~known)]
    data = jacobian[np.ix_(rows, np.flatnonzero(known))]
    free = jacobian[np.ix_(rows, np.r_[np.flatnonzero(~known), count : jacobian.shape[1]])]
    observed = data - free @ np.linalg.lstsq(free, data, rcond=None)[0]
    _, strengths, directions = np.linalg.svd(observed, full_matrices=False)
    unseen = [
        _combination(direction, [n for n, k in zip(problem.names, known, strict=True) if k])
        for strength, direction in zip(strengths, directions, strict=True)
        if strength < _UNOBSERVABLE
    ]
    found, sigma = problem.corrections(unknowns), problem.sigma(covariance)
    if problem.measured:
        found, sigma = _with_measured_spin(found, sigma, recordings)
    nothing = np.zeros(count)
    return CalibrationFit(
        found,
        sigma,
        problem.measured,
        unseen,
        [problem.residual(r, nothing, s) for r, s in zip(recordings, seen_starts, strict=True)],
        [problem.residual(r, unknowns, s) for r, s in zip(recordings, starts, strict=True)],
    )


def _with_speed_share(fit: CalibrationFit, share: float) -> Corrections:
    """Return the standard deviations including a common relative error of all wheel speeds."""
    if fit.common_spin_known:
        return replace(fit.sigma, spin=np.hypot(fit.sigma.spin, share))
    return replace(fit.sigma, wheel_radius=float(np.hypot(fit.sigma.wheel_radius, share)))


def _with_measured_spin(
    found: Corrections, sigma: Corrections, recordings: Sequence[Recording]
) -> tuple[Corrections, Corrections]:
    """Return both with the median ratio of measured to commanded speed, robust to the spin-up."""
    shares = np.concatenate(
        [
            run.spin_rad_per_s[turns] / run.commanded_rad_per_s[turns]
            for run in recordings
            if (turns := (run.commanded_rad_per_s > 0.0).all(axis=1)).any()
        ]
    )
    # Ratio of the standard deviations of median and mean, for normal noise.
    spread = np.sqrt(0.5 * np.pi / len(shares)) * shares[len(shares) // 10 :].std(axis=0)
    return replace(found, spin=np.median(shares, axis=0)), replace(sigma, spin=spread)


def _combination(direction: Array, names: Sequence[str]) -> str:
    """Format the largest components of a direction."""
    sign = np.sign(direction[np.argmax(np.abs(direction))])
    parts = [
        f"{sign * part:+.1f} {name}"
        for part, name in zip(direction, names, strict=True)
        if abs(part) >= _MIN_COMPONENT
    ]
    return " ".join(parts)
