"""Lie groups of the poses: SE(2) for planar robots, SO(3) for the sphere.

Elements contain plain arrays with leading batch dimensions. `a @ b` composes poses. Formulas follow
Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (arXiv 1812.01537),
appendices A and B.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
"""Array of floats; docstrings give the shapes, batch dimensions first."""


def sinc(x: Array) -> Array:
    """Return sin(x) / x for x in radians, exact at and near zero."""
    # The function is even; the tiny offset avoids 0 / 0 without affecting other values.
    away = np.abs(x) + 1e-200
    return np.sin(away) / away


def _arc(vx: float, vy: float, half: float, middle: float) -> tuple[float, float]:
    """Return the displacement of a twist in unit time, for a single pose.

    `half` is half the rotation angle, `middle` the mean heading. Plain floats are faster than numpy
    here, and bit-identical.
    """
    away = abs(half) + 1e-200
    chord = math.sin(away) / away
    c, s = chord * math.cos(middle), chord * math.sin(middle)
    return c * vx - s * vy, s * vx + c * vy


def wrap(angle: Array) -> Array:
    """Wrap `angle` (radians, any shape) to (-pi, pi].

    Angles in that range are returned bit by bit, NaN as NaN.
    """
    turned = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    # The product is rounded, so the difference may be just out of range near half a turn.
    return np.where(turned <= -np.pi, np.pi, np.minimum(turned, np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class SE2:
    """Planar pose `xy_heading` (..., 3), metres and radians, with p_parent = R p_local + t.

    The heading is not wrapped, so that full turns can be counted. The tangent is (vx, vy, omega) in
    the local frame.
    """

    xy_heading: Array

    @staticmethod
    def identity(batch: tuple[int, ...] = ()) -> SE2:
        """Return the identity with batch dimensions `batch`."""
        return SE2(np.zeros((*batch, 3)))

    @staticmethod
    def exp(tangent: Array) -> SE2:
        """Return the pose reached by constant twist `tangent` (..., 3) in unit time; Eq. 156."""
        if tangent.ndim == 1 and math.isfinite(tangent[2]):
            vx, vy, omega = tangent.tolist()
            return SE2(np.array([*_arc(vx, vy, 0.5 * omega, 0.5 * omega), omega]))
        half = 0.5 * tangent[..., 2]
        # The left Jacobian is a rotation by half the angle, scaled by sinc, so zero needs no
        # branch.
        chord = sinc(half)
        c, s = chord * np.cos(half), chord * np.sin(half)
        out = np.empty(np.shape(tangent))
        out[..., 0] = c * tangent[..., 0] - s * tangent[..., 1]
        out[..., 1] = s * tangent[..., 0] + c * tangent[..., 1]
        out[..., 2] = tangent[..., 2]
        return SE2(out)

    def log(self) -> Array:
        """Return the tangent (..., 3) whose `exp` is this pose; heading in (-2 pi, 2 pi)."""
        half = 0.5 * self.xy_heading[..., 2]
        chord = sinc(half)
        c, s = np.cos(half) / chord, np.sin(half) / chord
        out = np.empty(np.shape(self.xy_heading))
        out[..., 0] = c * self.xy_heading[..., 0] + s * self.xy_heading[..., 1]
        out[..., 1] = -s * self.xy_heading[..., 0] + c * self.xy_heading[..., 1]
        out[..., 2] = self.xy_heading[..., 2]
        return out

    def inverse(self) -> SE2:
        """Return the pose of the parent in the local frame."""
        c, s = np.cos(self.xy_heading[..., 2]), np.sin(self.xy_heading[..., 2])
        out = np.empty(np.shape(self.xy_heading))
        out[..., 0] = -c * self.xy_heading[..., 0] - s * self.xy_heading[..., 1]
        out[..., 1] = s * self.xy_heading[..., 0] - c * self.xy_heading[..., 1]
        out[..., 2] = -self.xy_heading[..., 2]
        return SE2(out)

    def __matmul__(self, other: SE2) -> SE2:
        """Compose: T_ac = T_ab @ T_bc."""
        if self.xy_heading.ndim == other.xy_heading.ndim == 1 and math.isfinite(self.xy_heading[2]):
            x, y, angle = self.xy_heading.tolist()
            dx, dy, turned = other.xy_heading.tolist()
            c, s = math.cos(angle), math.sin(angle)
            return SE2(np.array([c * dx - s * dy + x, s * dx + c * dy + y, angle + turned]))
        heading = self.xy_heading[..., 2] + other.xy_heading[..., 2]
        out = np.empty((*np.shape(heading), 3))
        out[..., :2] = self.transform(other.xy_heading[..., :2])
        out[..., 2] = heading
        return SE2(out)

    def plus(self, tangent: Array) -> SE2:
        """Return the pose reached from here by constant twist `tangent` (..., 3); Eq. 25.

        Equals `self @ SE2.exp(tangent)`, but rotates once by the summed angle.
        """
        if self.xy_heading.ndim == tangent.ndim == 1:
            x, y, heading = self.xy_heading.tolist()
            vx, vy, omega = tangent.tolist()
            if math.isfinite(heading + omega):
                dx, dy = _arc(vx, vy, 0.5 * omega, heading + 0.5 * omega)
                return SE2(np.array([dx + x, dy + y, omega + heading]))
        half = 0.5 * tangent[..., 2]
        chord, middle = sinc(half), self.xy_heading[..., 2] + half
        c, s = chord * np.cos(middle), chord * np.sin(middle)
        vx, vy = tangent[..., 0], tangent[..., 1]
        out = np.empty((*np.shape(middle), 3))
        out[..., 0] = c * vx - s * vy
        out[..., 1] = s * vx + c * vy
        out[..., 2] = tangent[..., 2]
        out += self.xy_heading
        return SE2(out)

    def transform(self, points: Array) -> Array:
        """Map local `points` (..., 2), metres, into the parent frame."""
        return self.rotate(points) + self.xy_heading[..., :2]

    def rotate(self, vectors: Array) -> Array:
        """Rotate local `vectors` (..., 2) into the parent's axes."""
        c, s = np.cos(self.xy_heading[..., 2]), np.sin(self.xy_heading[..., 2])
        x, y = vectors[..., 0], vectors[..., 1]
        turned_x = c * x - s * y
        out = np.empty((*np.shape(turned_x), 2))
        out[..., 0] = turned_x
        out[..., 1] = s * x + c * y
        return out


@dataclass(frozen=True, slots=True, eq=False)
class SO3:
    """Rotation: unit quaternion `wxyz` of shape (..., 4), with p_parent = R p_local.

    The tangent is a rotation vector (..., 3) in radians.
    """

    wxyz: Array

    @staticmethod
    def identity(batch: tuple[int, ...] = ()) -> SO3:
        """Return the identity with batch dimensions `batch`."""
        wxyz = np.zeros((*batch, 4))
        wxyz[..., 0] = 1.0
        return SO3(wxyz)

    @staticmethod
    def exp(tangent: Array) -> SO3:
        """Return the rotation about `tangent` (..., 3) by its length; Eq. 101."""
        half = 0.5 * np.sqrt(np.add.reduce(np.square(tangent), axis=-1))
        wxyz = np.empty((*np.shape(tangent)[:-1], 4))
        wxyz[..., 0] = np.cos(half)
        wxyz[..., 1:] = 0.5 * sinc(half)[..., None] * tangent
        return SO3(wxyz)

    def log(self) -> Array:
        """Return the shortest rotation vector (..., 3) whose `exp` is this rotation; Eq. 105."""
        # q and -q are the same rotation; w >= 0 limits the angle to pi.
        wxyz = np.where(self.wxyz[..., :1] < 0.0, -self.wxyz, self.wxyz)
        w, xyz = wxyz[..., 0], wxyz[..., 1:]
        half = np.arctan2(np.linalg.norm(xyz, axis=-1), w)
        return 2.0 * xyz / sinc(half)[..., None]

    def inverse(self) -> SO3:
        """Return the inverse rotation."""
        return SO3(self.wxyz * np.array([1.0, -1.0, -1.0, -1.0]))

    def __matmul__(self, other: SO3) -> SO3:
        """Compose: R_ac = R_ab @ R_bc, normalised."""
        a, b = self.wxyz, other.wxyz
        w1, x1, y1, z1 = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
        w2, x2, y2, z2 = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
        w = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
        wxyz = np.empty((*np.shape(w), 4))
        wxyz[..., 0] = w
        wxyz[..., 1] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
        wxyz[..., 2] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
        wxyz[..., 3] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
        wxyz /= np.sqrt(np.add.reduce(np.square(wxyz), axis=-1, keepdims=True))
        return SO3(wxyz)

    def rotate(self, vectors: Array) -> Array:
        """Rotate local `vectors` (..., 3) into the parent's axes."""
        return np.asarray((self.as_matrix() @ vectors[..., None])[..., 0], dtype=float)

    def as_matrix(self) -> Array:
        """Return rotation matrices (..., 3, 3)."""
        q = self.wxyz
        w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
        out = np.empty((*np.shape(w), 3, 3))
        out[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        out[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
        out[..., 0, 1], out[..., 1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
        out[..., 0, 2], out[..., 2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
        out[..., 1, 2], out[..., 2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
        return out
