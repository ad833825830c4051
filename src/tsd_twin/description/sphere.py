"""How a spherical platform looks, hangs together and weighs."""

from __future__ import annotations

import numpy as np

from tsd_twin.description import ball, omni_wheel, stand
from tsd_twin.description.omni_wheel import WheelPlan
from tsd_twin.description.part import Link, Parts, drawn
from tsd_twin.description.tree import Cylinder, Hinge, Limbs, Sphere, Tree, alike, from_axes
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SO3, Array
from tsd_twin.robots import SphereRobot


def draw(robot: SphereRobot) -> Parts:
    """Return the parts of stand, sphere and wheel."""
    plan = _plan(robot)
    return {
        "chassis": drawn("chassis", stand.drawings(_stand(robot), robot.body)),
        "sphere": drawn("sphere", ball.drawings(1e3 * robot.drive.sphere_radius_m, robot.body)),
        "wheel": drawn("wheel", omni_wheel.drawings(plan, robot.body)),
    }


def tree(robot: SphereRobot) -> Tree:
    """Return a sphere about the origin of the base, and wheels on it: Z away from the sphere.

    A wheel and the sphere turn against each other, like two gears: the wheel about -Omega_i, which
    is its Y. Sphere and wheels collide as what they are, the stand not at all.
    """
    at, turn = _wheels(robot)
    k, g = len(at), robot.drive
    names = tuple(f"wheel{i + 1}" for i in range(k))
    return Tree(
        1e-3 * _stand(robot).floor,
        (
            Limbs(
                "sphere",
                ("sphere",),
                ("sphere_turn",),
                "chassis",
                np.zeros((1, 3)),
                SO3.identity((1,)),
                Hinge.BALL,
                alike((0.0, 0.0, 1.0), 1),
                hull=Sphere(g.sphere_radius_m),
            ),
            Limbs(
                "wheel",
                tuple(f"{name}_link" for name in names),
                names,
                "chassis",
                at,
                turn,
                Hinge.SPIN,
                alike((0.0, 1.0, 0.0), k),
                hull=Cylinder(g.wheel_radius_m, 2e-3 * _plan(robot).half_width),
            ),
        ),
        0.0,
    )


def masses_kg(robot: SphereRobot) -> dict[Link, float]:
    """Return the mass of each kind of link; the stand weighs what sphere and wheels leave.

    Raises:
        RobotFileError: they alone are heavier than the robot.
    """
    mass = robot.mass
    others = mass.sphere_kg + len(robot.drive.wheels) * mass.wheel_kg
    if others >= mass.total_kg:
        raise RobotFileError(
            robot.name,
            f"mass.total_kg is {mass.total_kg:g}, sphere and wheels alone weigh {others:g}",
            "more than mass.sphere_kg, and mass.wheel_kg for each wheel",
        )
    return {
        "chassis": mass.total_kg - others,
        "sphere": mass.sphere_kg,
        "wheel": mass.wheel_kg,
    }


def _plan(robot: SphereRobot) -> WheelPlan:
    """Return the wheels as described; those of one row are drawn as two that touch."""
    g = robot.drive
    apart = 500.0 * max(g.row_distance_m, 2.0 * g.roller_radius_m)
    return WheelPlan(
        1e3 * g.wheel_radius_m, 0.0, g.rollers // 2, 1e3 * g.roller_radius_m, (-apart, apart), 8
    )


def _wheels(robot: SphereRobot) -> tuple[Array, SO3]:
    """Return where the wheels are (k, 3), metres, and the turns (k, 4) of their frames."""
    drive = robot.kinematics()
    out, axle = drive.contacts, -drive.axes
    at = (drive.sphere_radius_m + drive.wheel_radius_m) * out
    return at, from_axes(np.cross(axle, out), axle, out)


def _stand(robot: SphereRobot) -> stand.Stand:
    at, turn = _wheels(robot)
    matrices = turn.as_matrix()
    leans = tuple(stand.Lean(1e3 * at[i], matrices[i]) for i in range(len(at)))
    return stand.Stand(_plan(robot), leans)
