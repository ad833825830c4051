"""Wheels in gimbals as rigid bodies in three dimensions: rotation matrices and cross products."""

from __future__ import annotations

import numpy as np

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array


def rotation(axis: int, angle: float) -> Array:
    """The matrix that turns by `angle` about the x, y or z axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(3)
    matrix[[i, j, i, j], [i, j, j, i]] = c, c, -s, s
    return matrix


def gimbals(kinematics: SingularityKinematics, joints: Array) -> list[Array]:
    """Orientation of each inner gimbal in the robot frame: pivot, then outer, then inner."""
    return [
        rotation(2, azimuth - np.pi / 2) @ rotation(1, beta) @ rotation(0, -alpha)
        for azimuth, (alpha, beta, _) in zip(
            kinematics.azimuths_rad, joints.reshape(-1, 3), strict=True
        )
    ]


def pivots(kinematics: SingularityKinematics) -> Array:
    r, azimuths = kinematics.pivot_radius_m, kinematics.azimuths_rad
    return np.stack([r * np.cos(azimuths), r * np.sin(azimuths), 0.0 * azimuths], axis=-1)


def slip(
    kinematics: SingularityKinematics, twist: Array, joints: Array, gimbal_rates: Array
) -> Array:
    """Velocity (k, 3) over the ground of the lowest point of each sphere, in the robot frame.

    The pivot moves with the chassis; the wheel turns with the chassis, with its gimbals
    (`gimbal_rates` (k, 3), in the robot frame) and about its axle.
    """
    yaw = np.array([0.0, 0.0, twist[2]])
    pivot = np.array([twist[0], twist[1], 0.0]) + np.cross(yaw, pivots(kinematics))
    axles = np.array([gimbal[:, 2] for gimbal in gimbals(kinematics, joints)])
    turning = yaw + gimbal_rates + joints.reshape(-1, 3)[:, 2:] * axles
    return pivot + np.cross(turning, [0.0, 0.0, -kinematics.wheel_radius_m])


def in_robot_frame(kinematics: SingularityKinematics, vectors: Array) -> Array:
    """Turn (k, 2), each in its `W_i`, into the robot frame."""
    return np.array(
        [
            rotation(2, azimuth - np.pi / 2)[:2, :2] @ vector
            for azimuth, vector in zip(kinematics.azimuths_rad, vectors, strict=True)
        ]
    )
