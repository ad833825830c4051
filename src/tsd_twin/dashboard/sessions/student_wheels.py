"""Wheels at joint values by robot kind, for the Student tab."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.dashboard.sessions.joint_poses import GimbalDisplay
from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.student import StudentWheel
from tsd_twin.kinematics import TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import (
    RPM,
    OmniDescription,
    SingularityDescription,
    SphereDescription,
)


def gimbal_wheels(
    robot: SingularityDescription, joints: Array, solution: TwistSolution
) -> list[StudentWheel]:
    """Return the modules of a singularity drive at joints (3k,), as they roll."""
    drive = robot.kinematics()
    display = GimbalDisplay(drive)
    tilts, radii = drive.tilt(joints), drive.effective_radius_m(joints)
    axles, pushes = display.axles(joints), display.pushes(joints)
    residuals = np.linalg.norm(solution.residual.reshape(-1, 2), axis=-1)
    return [
        StudentWheel(
            at=pair(drive.pivots_m[i]),
            push=pair(pushes[i]),
            direction_deg=None,
            rpm=short(spin / RPM),
            gimbal=(degrees(alpha), degrees(beta), degrees(tilts[i])),
            axle=pair(axles[i]),
            effective_radius_mm=short(1000.0 * float(radii[i])),
            residual_mps=short(residuals[i]),
        )
        for i, (alpha, beta, spin) in enumerate(joints.reshape(-1, 3).tolist())
    ]


def roller_wheels(
    robot: OmniDescription, joints: Array, solution: TwistSolution
) -> list[StudentWheel]:
    """Return the wheels of a platform on rollers at joints (k,)."""
    drive = robot.kinematics()
    pushes = pivot_velocities(drive.positions_m, solution.twist)
    return _rolling_wheels(joints, drive.positions_m, pushes, drive.directions_rad, solution)


def sphere_wheels(
    robot: SphereDescription, joints: Array, solution: TwistSolution
) -> list[StudentWheel]:
    """Return the wheels below a sphere at joints (k,), seen from above."""
    drive = robot.kinematics()
    contacts = drive.sphere_radius_m * drive.contacts
    directions_rad = np.arctan2(drive.actuations[:, 1], drive.actuations[:, 0])
    pushes = np.cross(solution.twist, contacts)
    return _rolling_wheels(joints, contacts, pushes, directions_rad, solution)


def _rolling_wheels(
    spins: Array, at_m: Array, pushes: Array, directions_rad: Array, solution: TwistSolution
) -> list[StudentWheel]:
    return [
        StudentWheel(
            at=pair(at_m[i]),
            push=pair(pushes[i]),
            direction_deg=degrees(directions_rad[i]),
            rpm=short(float(spins[i]) / RPM),
            residual_mps=short(abs(float(solution.residual[i]))),
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
