"""Kinematics of wheels with rollers: omni and Mecanum platforms, and a sphere on omni wheels.

Platforms: Savnani et al. 2019, Eq. 4 for one wheel and Eq. 8 to 11 for four wheels. One class
covers any number of wheels and any roller angle; see `docs/kinematics.md` for symbols and a
drawing.

Atlas platform, a sphere turned in place by three omni wheels: Weiss, Langlois and Hayes 2008. The
wheels have two rows of rollers, and the contact alternates between the rows as a wheel turns; the
ideal kinematics place it midway. Corrected: Eq. 29 omits the cosine of the offset that Eq. 27
contains, and Eq. 24 has +d^2 instead of -d^2 in three places.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.kinematics.base import ContactLayout, PlanarMotion, WheelKinematics
from tsd_twin.lie import SO3, Array

_SINGULAR = 1e-3
"""Minimum ratio of singular values of a layout; below it, a motion counts as impossible."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniKinematics(PlanarMotion, WheelKinematics):
    """Kinematics of three or more driven wheels with rollers.

    A wheel drives forward along its `direction`. The axle of the roller on the floor is parallel to
    that direction, rotated by the `roller` angle about Z: 0 for an omni wheel, 45 degrees for
    Mecanum. A roller grips along its axle and rolls freely across it. In the paper's symbols, the
    direction is `lambda + alpha - 90 degrees` and the roller angle `psi`. The joint vector contains
    the wheel speeds.
    """

    positions_m: Array
    """(k, 2): wheel positions in the robot frame, X forward and Y left."""
    directions_rad: Array
    """(k,): driving direction of each wheel, from X towards Y."""
    rollers_rad: Array
    """(k,): axle angle of the roller on the floor, relative to the wheel's direction."""
    grip_from_twist: Array = field(init=False)
    """(k, 3): maps a twist to the ground velocity of each wheel along its roller axle."""

    def __post_init__(self) -> None:
        """Build the matrices.

        Raises:
            ValueError: If some motion is impossible or a wheel has no grip forward.
        """
        problem = layout_problem(self.positions_m, self.directions_rad, self.rollers_rad)
        if problem:
            raise ValueError(problem)
        grip = _grip(self.positions_m, self.directions_rad, self.rollers_rad)
        # Eq. 4 divided by r cos psi.
        rows = grip / (self.wheel_radius_m * np.cos(self.rollers_rad))[:, None]
        self._set_wheel_matrices(rows, grip_from_twist=grip)

    @property
    def contact_layout(self) -> ContactLayout:
        """Wheels grip along the axles of their rollers."""
        grip = self.grip_from_twist
        inverse = np.asarray(np.linalg.pinv(grip), dtype=float)
        return ContactLayout(
            self.positions_m, grip[:, None, :2], inverse[..., None], self.rollers_rad
        )


def layout_problem(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> str:
    """Return an error message about the wheel layout, or "" if it is valid.

    An omnidirectional platform needs a matrix of full rank: a twist that turns no wheel can be
    neither driven nor held.
    """
    weak = np.flatnonzero(np.abs(np.cos(rollers_rad)) < 0.1)
    if len(weak):
        return f"the rollers of wheel {weak[0] + 1} roll where it drives to: it has no grip forward"
    if len(directions_rad) < 3:
        return f"{len(directions_rad)} wheels cannot move a robot in all three ways"
    rows = _grip(positions_m, directions_rad, rollers_rad)
    reach_m = max(float(np.hypot(*positions_m.T).max()), 1e-9)
    _, strengths, motions = np.linalg.svd(rows / [1.0, 1.0, reach_m])
    if strengths[-1] > _SINGULAR * strengths[0]:
        return ""
    vx, vy, omega = motions[-1] / [1.0, 1.0, reach_m]
    if abs(omega) * reach_m < 1e-3:
        return f"no wheel can push the robot towards {math.degrees(math.atan2(vy, vx)):.0f} degrees"
    x, y = (round(float(v), 6) + 0.0 for v in (-vy / omega, vx / omega))
    return f"no wheel can turn the robot about the point x = {x:.3g} m, y = {y:.3g} m"


def _grip(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> Array:
    """Return the matrix (k, 3) from twist to ground velocity along the roller axles.

    Eq. 4, left side: the roller axle is at lambda + alpha + psi - 90 degrees, and turning moves the
    wheel along it by -l cos(alpha + psi).
    """
    c, s = np.cos(directions_rad + rollers_rad), np.sin(directions_rad + rollers_rad)
    x, y = positions_m[:, 0], positions_m[:, 1]
    return np.stack([c, s, s * x - c * y], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class SphereKinematics(WheelKinematics):
    """Kinematics of a sphere on three or more omni wheels in any mounting (Eq. 31).

    The base is fixed; X forward, Y left, Z up, with the origin at the sphere's centre. A twist is
    the sphere's angular velocity in the base frame; the joint vector contains the wheel speeds.

    `inverse` and `forward` are ideal and used by the controller. `true_rows`, `true_inverse` and
    `true_twist` also model the rows: the wheel angle determines the supporting row.
    """

    contacts: Array
    """(k, 3): unit vectors to the contacts, midway between the rows of a wheel: R_i (Eq. 21)."""
    actuations: Array
    """(k, 3): unit driving directions at the contacts: v_i (Eq. 23)."""
    sphere_radius_m: float
    row_offset_rad: float
    """Offset of a row's contact from midway: arcsin d / (2 (R + r_r)) (Eq. 12); 0 is ideal."""
    row_rad: float
    """Wheel angle covered by one row: pi / N with N rollers per row (Eq. 8 to 11)."""
    axes: Array = field(init=False)
    """(k, 3): axes about which each wheel turns the sphere: Omega_i = R_i x v_i (Eq. 5)."""

    def __post_init__(self) -> None:
        """Build the matrices.

        Raises:
            ValueError: If the wheels cannot turn the sphere about every axis.
        """
        problem = sphere_layout_problem(self.contacts, self.actuations)
        if problem:
            raise ValueError(problem)
        axes = np.cross(self.contacts, self.actuations)
        # Ideal: (R / r) Omega_i (Eq. 26).
        self._set_wheel_matrices(self.sphere_radius_m / self.wheel_radius_m * axes, axes=axes)

    @property
    def twist_axes(self) -> tuple[int, int, int]:
        """The sphere turns in place: wx, wy, wz."""
        return (3, 4, 5)

    @property
    def pose_type(self) -> type[SO3]:
        """Poses are orientations of the sphere."""
        return SO3

    @property
    def twist_scale_m(self) -> float:
        """Rotation about X or Y moves the top of the sphere by its radius."""
        return self.sphere_radius_m

    def integrate(self, pose: SO3, twist: Array, dt_s: float) -> SO3:
        """Return `pose` after `dt_s` of constant `twist` (..., 3), in base axes."""
        return SO3.exp(twist * dt_s) @ pose

    # Dual-row model.

    def side(self, angles_rad: Array) -> Array:
        """Return (-1)^l for wheels at `angles_rad` (..., k): -1 on the first row, 1 on the second.

        l = floor(N phi / pi mod 2) + 1 (Eq. 8 to 11). On the first row, the contact is offset
        towards `axes`, which is towards the equator in the paper's mounting.
        """
        return 2.0 * np.mod(np.floor(angles_rad / self.row_rad), 2.0) - 1.0

    def mean_side(self, before_rad: Array, after_rad: Array) -> Array:
        """Return the exact mean of `side` between two wheel angles (..., k)."""
        way = after_rad - before_rad
        hops = self.row_rad * (self._fold(after_rad) - self._fold(before_rad))
        still = np.abs(way) < 1e-9 * self.row_rad
        return np.where(still, self.side(before_rad), hops / np.where(still, 1.0, way))

    def _fold(self, angles_rad: Array) -> Array:
        """Integrate `side` over N phi / pi: a triangle wave from 0 to -1 and back."""
        return np.abs(np.mod(angles_rad / self.row_rad, 2.0) - 1.0) - 1.0

    def wrong_side(self, angles_rad: Array, sigmas_rad: Array) -> Array:
        """Return the probability (k,) that `side` is wrong, from the two nearest changes of rows.

        Angles (k,) have normally distributed errors with standard deviations (k,).
        """
        before = np.mod(angles_rad, self.row_rad)
        spreads = math.sqrt(2.0) * np.maximum(sigmas_rad, 1e-9)
        edges = np.stack([before, self.row_rad - before]) / spreads
        beyond = [[0.5 * math.erfc(ratio) for ratio in edge] for edge in edges.tolist()]
        return np.minimum(np.sum(beyond, axis=0), 0.5)

    def true_rows(self, side: Array) -> Array:
        """Return the matrix (..., k, 3) from twist to wheel speeds; contacts on `side` (..., k).

        (R / r) (cos dtheta Omega_i + side sin dtheta R_i): the contact R_i, rotated by dtheta
        towards or away from Omega_i, crossed with v_i. This is Eq. 25 with the cosine that Eq. 29
        omits, for any mounting (Eq. 31). A side between -1 and 1 is the mean over a step.
        """
        ratio = self.sphere_radius_m / self.wheel_radius_m
        offset = math.sin(self.row_offset_rad) * side[..., None] * self.contacts
        return ratio * (math.cos(self.row_offset_rad) * self.axes + offset)

    def true_inverse(self, twist: Array, side: Array) -> Array:
        """Return the wheel speeds (..., k) for the sphere's `twist` (..., 3)."""
        return (self.true_rows(side) @ twist[..., None])[..., 0]

    def true_twist(self, joints: Array, side: Array) -> Array:
        """Return the sphere's twist (..., 3) for wheel speeds `joints` (..., k)."""
        rows = self.true_rows(side)
        back = np.linalg.inv(rows) if self.wheels == 3 else np.linalg.pinv(rows)
        return np.asarray((back @ joints[..., None])[..., 0], dtype=float)


def contacts_and_directions(
    azimuths_rad: Array, below_equator_rad: Array, turns_rad: Array
) -> tuple[Array, Array]:
    """Return contacts R_i and actuations v_i, (k, 3) each, of wheels given by angles (k,).

    Contact by azimuth and angle below the equator (Eq. 21). A wheel pushes horizontally,
    counter-clockwise seen from above (Eq. 23), rotated about the outward normal by its turn.
    """
    c, s = np.cos(azimuths_rad), np.sin(azimuths_rad)
    up, down = np.cos(below_equator_rad), np.sin(below_equator_rad)
    contacts = np.stack([up * c, up * s, -down], axis=-1)
    along = np.stack([-s, c, 0.0 * c], axis=-1)
    across = np.cross(contacts, along)
    turns = turns_rad[:, None]
    return contacts, np.cos(turns) * along + np.sin(turns) * across


def sphere_layout_problem(contacts: Array, actuations: Array) -> str:
    """Return a message that names a rotation the wheels (k, 3) cannot produce, or ""."""
    if len(contacts) < 3:
        return f"{len(contacts)} wheels cannot turn a sphere about all three axes"
    _, strengths, turns = np.linalg.svd(np.cross(contacts, actuations))
    if strengths[-1] > _SINGULAR * strengths[0]:
        return ""
    x, y, z = turns[-1] + 0.0
    return f"no wheel can turn the sphere about the axis ({x:.2f}, {y:.2f}, {z:.2f})"
