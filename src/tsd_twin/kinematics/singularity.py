"""Kinematics of the singularity drive: continuously spinning hemispheres on two-axis gimbals.

Source: Carothers, MIT thesis 2014, chapter 3. Used as printed, the equations cause 1 m/s of slip
per 1 m/s of commanded speed; each correction is named where it is used and derived in
`docs/kinematics.md`.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from tsd_twin.kinematics.base import (
    ContactLayout,
    Joint,
    JointKind,
    PlanarMotion,
    TwistSolution,
    set_matrices,
)
from tsd_twin.lie import Array

_BLOCK = 4096
"""Batch size whose arrays fit into the CPU cache, which is 15 times as fast."""
_SMALL_SIZE = 27
"""Up to this number of joint values (nine modules), plain floats are faster than numpy."""


@cache
def _joints(modules: int) -> tuple[Joint, ...]:
    parts = (
        ("alpha", JointKind.POSITION),
        ("beta", JointKind.POSITION),
        ("wheel", JointKind.VELOCITY),
    )
    return tuple(
        Joint(f"module{i + 1}_{part}", kind) for i in range(modules) for part, kind in parts
    )


@dataclass(frozen=True, slots=True, eq=False)
class SingularityKinematics(PlanarMotion):
    """Kinematics of any number of spinning hemispheres on gimbals (three in the thesis).

    Module frame `W_i` at each pivot: `Y_W` radially outward, `Z_W` up, `X_W = Y_W x Z_W`, so it is
    the robot frame rotated by `azimuth - pi/2` (corrected: Eq. 7 prints a rotation by the azimuth;
    text and Fig. 12 agree with this one). For each module, the joint vector contains `alpha` (inner
    gimbal, about the rotated X_W, positive tips the axle outward), `beta` (outer gimbal, about Y_W)
    and the wheel's speed about its axle, counter-clockwise seen from above.
    """

    azimuths_rad: Array
    """(k,): direction of each pivot from the robot's centre, from X forward towards Y left."""
    pivot_radius_m: float | Array
    """Distance of the pivots from the robot's centre: one for all, or (k,)."""
    wheel_radius_m: float
    """Sphere radius of the hemispherical wheels."""
    spin_rad_per_s: float
    """Wheel speed that the inverse kinematics assume for all wheels."""
    max_tilt_rad: float
    """Mechanical tilt limit, in any direction."""
    max_tilt_rate_rad_per_s: float
    """Speed limit of a gimbal servo."""
    spin_ratio: Array = field(default_factory=lambda: np.ones(1))
    """(k,) or (1,): speed of each wheel relative to `spin_rad_per_s`."""
    contact_from_twist: Array = field(init=False)
    """(k, 2, 3): maps a body twist to each pivot's ground velocity in `W_i`: H."""
    twist_from_contacts: Array = field(init=False)
    """(3, 2k): pseudo-inverse of H (corrected: Eq. 33 prints [H^T + H]^-1 H^T for (H^T H)^-1
    H^T)."""
    _axles_by_part: Array = field(init=False, repr=False)
    """(2k, 3): maps a body twist to the horizontal axle parts, all l_x first, then all l_y."""
    _leave_one_out_gain: Array = field(init=False, repr=False)
    """(k, 2, 2): inverse of each module's diagonal block of the residual projection."""

    def __post_init__(self) -> None:
        azimuths = np.array(self.azimuths_rad, dtype=float)
        # Rows of Eq. 9 without its world-to-robot rotation: Rot(-(azimuth - pi/2)) [1 0 -Ry; 0 1
        # Rx], where the thesis omits the signs and the factor R (Eq. 2, 3, 4).
        c, s = np.cos(azimuths - np.pi / 2), np.sin(azimuths - np.pi / 2)
        x, y = self.pivot_radius_m * np.cos(azimuths), self.pivot_radius_m * np.sin(azimuths)
        h = np.stack(
            [np.stack([c, s, s * x - c * y], -1), np.stack([-s, c, c * x + s * y], -1)], axis=1
        )
        # (l_x, l_y) = (-v_y, v_x) / (r_w spin): the rolling constraint, solved for the axle.
        ratio = np.broadcast_to(np.array(self.spin_ratio, dtype=float), len(h)).copy()
        rims_mps = self.wheel_radius_m * self.spin_rad_per_s * np.tile(ratio, 2)
        axles = np.concatenate([-h[:, 1], h[:, 0]]) / rims_mps[:, None]
        flat = h.reshape(-1, 3)
        projection = np.eye(len(flat)) - flat @ np.linalg.pinv(flat)
        blocks = projection.reshape(len(h), 2, len(h), 2)
        own_blocks = np.stack([blocks[i, :, i] for i in range(len(h))])
        matrices = {
            "azimuths_rad": azimuths,
            "spin_ratio": ratio,
            "contact_from_twist": h,
            "twist_from_contacts": np.linalg.pinv(flat),
            "_axles_by_part": axles,
            # With two modules, a single one measures only one direction: its block has rank one,
            # and rounding in the other direction must not be inverted.
            "_leave_one_out_gain": np.linalg.pinv(own_blocks, 1e-9, hermitian=True),
        }
        set_matrices(self, matrices)

    @property
    def modules(self) -> int:
        """Number of wheels."""
        return len(self.azimuths_rad)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`module1_alpha`, `module1_beta`, `module1_wheel`, `module2_alpha`, ..."""
        return _joints(self.modules)

    @property
    def actuators(self) -> tuple[str, ...]:
        """`module1`, `module2`, ..."""
        return tuple(f"module{i + 1}" for i in range(self.modules))

    @property
    def pivots_m(self) -> Array:
        """(k, 2): positions of the pivots in the robot frame."""
        return np.asarray(self.pivot_radius_m)[..., None] * np.stack(
            [np.cos(self.azimuths_rad), np.sin(self.azimuths_rad)], axis=-1
        )

    @property
    def contact_layout(self) -> ContactLayout:
        """Wheels grip in both directions."""
        by_grips = self.twist_from_contacts.reshape(3, self.modules, 2)
        rollers = np.zeros(self.modules)
        return ContactLayout(self.pivots_m, self.contact_from_twist[..., :2], by_grips, rollers)

    def with_spin(self, spin_rad_per_s: float) -> SingularityKinematics:
        """Return these kinematics for another wheel speed; fast enough for every control period.

        Only the axles depend on the wheel speed; they scale with its inverse.
        """
        geared = copy(self)
        axles = self._axles_by_part * (self.spin_rad_per_s / spin_rad_per_s)
        axles.setflags(write=False)
        object.__setattr__(geared, "spin_rad_per_s", spin_rad_per_s)
        object.__setattr__(geared, "_axles_by_part", axles)
        return geared

    def axles(self, twist: Array) -> Array:
        """Return the horizontal parts (..., k, 2) of the unit axles for `twist` (..., 3).

        Linear in the twist, even beyond the tilt limit. Uses no steer angle, in which Eq. 14, 17,
        18, 27 and 28 are singular at zero tilt.
        """
        by_part = twist @ self._axles_by_part.T
        return np.swapaxes(by_part.reshape(*by_part.shape[:-1], 2, self.modules), -1, -2)

    def joint_utilization(self, twist: Array) -> Array:
        """Return the largest sin(tilt) of all modules relative to its limit, (...)."""
        return self._worst_sine(twist) / math.sin(self.max_tilt_rad)

    def rate_utilization(self, step: Array, dt_s: float) -> Array:
        """Return the largest gimbal rate relative to its limit, (...), for a twist `step`.

        This is the worst case over all tilts within the limit. There, the horizontal part l of the
        axle moves beta by (l_x' + l_x l_y l_y' / (1 - l_y^2)) / l_z, at most |l'| (1 + c^2) / (2
        c^2) with c = cos(max tilt); alpha, at most |l'| / c, is never faster.
        """
        c_squared = math.cos(self.max_tilt_rad) ** 2
        growth = (1.0 + c_squared) / (2.0 * c_squared)
        return self._worst_sine(step) * (growth / (self.max_tilt_rate_rad_per_s * dt_s))

    def _worst_sine(self, twist: Array) -> Array:
        """Return the largest sin(tilt) of all modules, (...), for `twist` (..., 3)."""
        axles = twist @ self._axles_by_part.T
        k = self.modules
        if axles.ndim == 1:
            numbers = axles.tolist()
            pairs = zip(numbers[:k], numbers[k:], strict=True)
            return np.sqrt(max(x * x + y * y for x, y in pairs))
        squared = axles * axles
        return np.sqrt(np.maximum.reduce(squared[..., :k] + squared[..., k:], axis=-1))

    def limit(self, twist: Array) -> Array:
        """Scale `twist` (..., 3) uniformly until all modules are within their tilt limit."""
        return twist / np.maximum(1.0, self.joint_utilization(twist))[..., None]

    def inverse(self, twist: Array) -> Array:
        """Return the joints (..., 3k) for body `twist` (..., 3), scaled to the tilt limit.

        alpha = asin(l_y), beta = atan2(l_x, l_z) = asin(l_x / cos(alpha)): Eq. 24 and 25 solved for
        the gimbal angles.
        """
        k, limit = self.modules, math.sin(self.max_tilt_rad)
        flat = twist.reshape(-1, 3)
        if len(flat) == 1:
            return self._inverse_of_one(flat, limit).reshape(*twist.shape[:-1], 3 * k)
        joints = np.empty((len(flat), k, 3))
        joints[..., 2] = self.spin_rad_per_s * self.spin_ratio
        for start in range(0, len(flat), _BLOCK):
            axles = self._axles_by_part @ flat[start : start + _BLOCK].T
            lx, ly = axles[:k], axles[k:]
            worst = np.sqrt(np.maximum.reduce(lx * lx + ly * ly))
            axles *= limit / np.maximum(worst, limit)
            block = joints[start : start + _BLOCK]
            block[..., 0] = np.arcsin(ly).T
            block[..., 1] = np.arcsin(lx / np.sqrt(1.0 - ly * ly)).T
        return joints.reshape(*twist.shape[:-1], 3 * k)

    def _inverse_of_one(self, twist: Array, limit: float) -> Array:
        """Compute `inverse` (k, 3) for a single `twist` (1, 3) in plain floats."""
        k = self.modules
        axles = (self._axles_by_part @ twist.T).ravel().tolist()
        worst = math.sqrt(max(x * x + y * y for x, y in zip(axles[:k], axles[k:], strict=True)))
        scale = limit / max(worst, limit)
        ly = [y * scale for y in axles[k:]]
        lx = [x * scale for x in axles[:k]]
        across = [x / math.sqrt(1.0 - y * y) for x, y in zip(lx, ly, strict=True)]
        joints = np.empty((k, 3))
        joints[:, :2] = np.arcsin(np.array(ly + across)).reshape(2, k).T
        joints[:, 2] = self.spin_rad_per_s * self.spin_ratio
        return joints

    def contacts(self, joints: Array, rates: Array | None = None) -> Array:
        """Return the ground velocity (..., k, 2) of each pivot from rolling, in `W_i`.

        v = r_w Omega x z with Omega = spin l + gimbal rate and l = (cos a sin b, sin a, cos a cos
        b). Corrected: the thesis lacks the gimbal-rate terms.
        """
        flat = self._flat_contacts(joints, rates)
        return flat.reshape(*flat.shape[:-1], self.modules, 2)

    def _flat_contacts(self, joints: Array, rates: Array | None) -> Array:
        """Return `contacts` as one vector (..., 2k) for all modules."""
        if joints.size <= _SMALL_SIZE:
            numbers = joints.ravel().tolist()
            if math.isfinite(sum(numbers)):  # math.sin raises for infinite angles.
                turning = None if rates is None else rates.ravel().tolist()
                few = np.array(self._few_contacts(numbers, turning))
                return few.reshape(*joints.shape[:-1], 2 * self.modules)
        alpha, beta, spin = joints[..., 0::3], joints[..., 1::3], joints[..., 2::3]
        v_x = spin * np.sin(alpha)
        v_y = -spin * np.cos(alpha) * np.sin(beta)
        if rates is not None:
            v_x += rates[..., 1::3]
            v_y += rates[..., 0::3] * np.cos(beta)
        v = np.empty((*alpha.shape, 2))
        v[..., 0], v[..., 1] = v_x, v_y
        v *= self.wheel_radius_m
        return v.reshape(*v.shape[:-2], 2 * self.modules)

    def _few_contacts(self, joints: list[float], rates: list[float] | None) -> list[float]:
        """Compute `contacts` in plain floats: faster for a few modules, and bit-identical."""
        radius_m, v, sin, cos = self.wheel_radius_m, list[float](), math.sin, math.cos
        modules = zip(joints[0::3], joints[1::3], joints[2::3], strict=True)
        if rates is None:
            for alpha, beta, spin in modules:
                v += (spin * sin(alpha) * radius_m, -spin * cos(alpha) * sin(beta) * radius_m)
            return v
        turning = zip(modules, rates[0::3], rates[1::3], strict=True)
        for (alpha, beta, spin), alpha_rate, beta_rate in turning:
            v_x = spin * sin(alpha) + beta_rate
            v_y = -spin * cos(alpha) * sin(beta) + alpha_rate * cos(beta)
            v += (v_x * radius_m, v_y * radius_m)
        return v

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:
        """Return the least-squares twist, and the unexplained residual (..., 2k) in m/s.

        The residual is zero if the modules are consistent, and grows as one deviates. Wheel slip
        and equal loss of all wheel speeds are not observable.
        """
        flat = self._flat_contacts(joints, rates)
        twist = flat @ self.twist_from_contacts.T
        return TwistSolution(twist, flat - twist @ self.contact_from_twist.reshape(-1, 3).T)

    def twist(self, joints: Array, rates: Array | None = None) -> Array:
        """Return the twist (..., 3) of `forward`, without its residual."""
        return self._flat_contacts(joints, rates) @ self.twist_from_contacts.T

    def fault_contribution(self, residual: Array) -> Array:
        """Return the fraction (..., k) of the squared `residual` (..., 2k) due to each module.

        It equals the decrease of the squared residual when the module's two equations are omitted.
        """
        own = residual.reshape(*residual.shape[:-1], self.modules, 1, 2)
        return (own @ self._leave_one_out_gain @ np.swapaxes(own, -1, -2))[..., 0, 0]

    def tilt(self, joints: Array) -> Array:
        """Return the tilt (..., k) of each axle from upright, radians, accurate near zero."""
        modules = joints.reshape(*joints.shape[:-1], self.modules, 3)
        alpha, beta = modules[..., 0], modules[..., 1]
        sine = np.hypot(np.cos(alpha) * np.sin(beta), np.sin(alpha))
        return np.arctan2(sine, np.cos(alpha) * np.cos(beta))

    def effective_radius_m(self, joints: Array) -> Array:
        """Return the effective wheel radius (..., k), ground speed / wheel speed: r_w sin(tilt)."""
        return self.wheel_radius_m * np.sin(self.tilt(joints))
