"""Wheels at a twist by robot kind, for the Student tab."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.to_page import StudentWheel
from tsd_twin.lie import Array
from tsd_twin.robots import (
    RPM,
    OmniDescription,
    SingularityDescription,
    SphereDescription,
)


def gimbal_wheels(robot: SingularityDescription, twist: Array) -> list[StudentWheel]:
    """Return the modules of a singularity drive at a twist (3,)."""
    drive = robot.kinematics()
    joints = drive.inverse(twist)
    tilts, radii = drive.tilt(joints), drive.effective_radius_m(joints)
    pushes = pivot_velocities(drive.pivots_m, twist)
    wheels: list[StudentWheel] = []
    for i, (alpha, beta, spin) in enumerate(joints.reshape(-1, 3)):
        rim_mps = drive.wheel_radius_m * float(spin)
        # Rolling, v = r_w spin l x z: the axle leans to the left of the push.
        axle = (-pushes[i, 1] / rim_mps, pushes[i, 0] / rim_mps)
        wheels.append(
            StudentWheel(
                at=pair(drive.pivots_m[i]),
                push=pair(pushes[i]),
                direction_deg=None,
                rpm=short(float(spin) / RPM),
                gimbal=(degrees(alpha), degrees(beta), degrees(tilts[i])),
                axle=(short(axle[0]), short(axle[1])),
                effective_radius_mm=short(1000.0 * float(radii[i])),
            )
        )
    return wheels


def roller_wheels(robot: OmniDescription, twist: Array) -> list[StudentWheel]:
    """Return the wheels of a platform on rollers at a twist (3,)."""
    drive = robot.kinematics()
    pushes = pivot_velocities(drive.positions_m, twist)
    return _rolling_wheels(drive.inverse(twist), drive.positions_m, pushes, drive.directions_rad)


def sphere_wheels(robot: SphereDescription, twist: Array) -> list[StudentWheel]:
    """Return the wheels below a sphere that turns at a twist (3,), seen from above."""
    drive = robot.kinematics()
    contacts = drive.sphere_radius_m * drive.contacts
    directions_rad = np.arctan2(drive.actuations[:, 1], drive.actuations[:, 0])
    return _rolling_wheels(
        drive.inverse(twist), contacts, np.cross(twist, contacts), directions_rad
    )


def _rolling_wheels(
    spins: Array, at_m: Array, pushes: Array, directions_rad: Array
) -> list[StudentWheel]:
    return [
        StudentWheel(
            at=pair(at_m[i]),
            push=pair(pushes[i]),
            direction_deg=degrees(directions_rad[i]),
            rpm=short(float(spins[i]) / RPM),
        )
        for i in range(len(spins))
    ]


def pivot_velocities(at_m: Array, twist: Array) -> Array:
    """Return the velocities (k, 2) of points (k, 2) on a body that moves at `twist` (3,)."""
    vx, vy, omega = (float(part) for part in twist)
    return np.stack([vx - omega * at_m[:, 1], vy + omega * at_m[:, 0]], axis=-1)


def short(value: float) -> float:
    """Round a number to six digits, and tiny numbers to zero."""
    return float(f"{round(float(value), 12):.6g}") + 0.0


def degrees(angle_rad: float) -> float:
    """Return an angle in degrees, with six digits."""
    return short(math.degrees(float(angle_rad)))


def pair(point: Array) -> tuple[float, float]:
    """Return a point with six digits."""
    return short(point[0]), short(point[1])


def triple(values: Array) -> Triple:
    """Return three numbers with six digits."""
    a, b, c = (short(value) for value in values)
    return a, b, c
