"""How a platform on wheels with rollers looks, hangs together and weighs."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.description import omni_wheel, platform
from tsd_twin.description.bay import Bay, Mount
from tsd_twin.description.omni_wheel import WheelPlan
from tsd_twin.description.part import Link, Parts, drawn
from tsd_twin.description.tree import Cylinder, Hinge, Limbs, Tree, about_z
from tsd_twin.errors import RobotFileError
from tsd_twin.robots import OmniRobot


def draw(robot: OmniRobot) -> Parts:
    """Return the parts; wheels whose rollers slant alike are alike."""
    bay = Bay.of(_mounts(robot), 1e3 * robot.body.plate_thickness_m)
    dead = robot.dead_wheels
    trackers = (
        []
        if dead is None
        else [
            platform.Tracker(1e3 * one.x_m, 1e3 * one.y_m, one.direction_deg, 1e3 * dead.radius_m)
            for one in dead.wheels
        ]
    )
    parts: Parts = {"chassis": drawn("chassis", platform.drawings(bay, robot.body, trackers))}
    for kind, rows in _kinds(robot).items():
        plan = bay.mounts[rows[0]].plan
        parts[kind] = drawn(kind, omni_wheel.drawings(plan, robot.body))
    return parts


def tree(robot: OmniRobot) -> Tree:
    """Return wheels on the chassis: Y outboard along the axle, Z up.

    A wheel turns forward about the axis that is left of where it drives to. Wheels collide as
    cylinders, the chassis as one between them.
    """
    mounts = _mounts(robot)
    radius_m = robot.drive.wheel_radius_m
    limbs: list[Limbs] = []
    for kind, rows in _kinds(robot).items():
        own = [mounts[row] for row in rows]
        names = tuple(f"wheel{row + 1}" for row in rows)
        limbs.append(
            Limbs(
                kind,
                tuple(f"{name}_link" for name in names),
                names,
                "chassis",
                np.array([[1e-3 * mount.x, 1e-3 * mount.y, 0.0] for mount in own]),
                about_z(np.radians([mount.axle_deg - 90.0 for mount in own])),
                Hinge.SPIN,
                np.array([[0.0, _outboard(robot, row), 0.0] for row in rows]),
                hull=Cylinder(radius_m, 2e-3 * own[0].plan.half_width),
            )
        )
    inside = min(math.hypot(mount.x, mount.y) - mount.plan.half_width for mount in mounts)
    return Tree(radius_m, tuple(limbs), max(0.0, 1e-3 * 0.7 * (inside - mounts[0].plan.radius)))


def masses_kg(robot: OmniRobot) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis weighs what the wheels leave.

    Raises:
        RobotFileError: the wheels alone are heavier than the robot.
    """
    mass, count = robot.mass, len(robot.drive.wheels)
    if count * mass.wheel_kg >= mass.total_kg:
        raise RobotFileError(
            robot.name,
            f"mass.total_kg is {mass.total_kg:g}, the wheels alone weigh {count * mass.wheel_kg:g}",
            "more than mass.wheel_kg for each wheel",
        )
    return {
        "chassis": mass.total_kg - count * mass.wheel_kg,
        **dict.fromkeys(_kinds(robot), mass.wheel_kg),
    }


def _kinds(robot: OmniRobot) -> dict[Link, list[int]]:
    """Return the kinds of wheels, and which wheels are of each: one kind for each roller angle."""
    angles = list(dict.fromkeys(wheel.roller_deg for wheel in robot.drive.wheels))
    return {
        "wheel" if number == 0 else f"wheel_{chr(ord('a') + number)}": [
            i for i, wheel in enumerate(robot.drive.wheels) if wheel.roller_deg == angle
        ]
        for number, angle in enumerate(angles)
    }


def _outboard(robot: OmniRobot, row: int) -> float:
    """Return 1 if a wheel turns forward about the axis that points away from the centre, or -1."""
    wheel = robot.drive.wheels[row]
    left = math.radians(wheel.direction_deg + 90.0)
    away = wheel.x_m * math.cos(left) + wheel.y_m * math.sin(left)
    return 1.0 if away >= 0.0 else -1.0


def _mounts(robot: OmniRobot) -> list[Mount]:
    return [
        Mount(
            1e3 * wheel.x_m,
            1e3 * wheel.y_m,
            wheel.direction_deg + 90.0 * _outboard(robot, row),
            WheelPlan.usual(1e3 * robot.drive.wheel_radius_m, math.radians(wheel.roller_deg)),
        )
        for row, wheel in enumerate(robot.drive.wheels)
    ]
