"""How a singularity drive looks, hangs together and weighs."""

from __future__ import annotations

import numpy as np

from tsd_twin.description import chassis, inner, outer, wheel
from tsd_twin.description.layout import Layout
from tsd_twin.description.part import Drawing, Link, Parts, drawn
from tsd_twin.description.tree import Hinge, Limbs, Range, Sphere, Tree, about_z, alike
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SO3
from tsd_twin.robots import RPM, SingularityRobot

_AXES = {"beta": (0.0, 1.0, 0.0), "alpha": (-1.0, 0.0, 0.0), "wheel": (0.0, 0.0, 1.0)}
_REACH = 1.6
"""Inboard reach of a module from its pivot, in wheel radii; the drawings keep to it."""


def draw(robot: SingularityRobot) -> Parts:
    """Return the parts; modules are alike, so `outer`, `inner` and `wheel` are there once.

    Raises:
        RobotFileError: there is no room for the modules.
    """
    layout, body = Layout.of(robot), robot.body
    modules: dict[Link, list[Drawing]] = {
        "outer": outer.drawings(layout, body),
        "inner": inner.drawings(body),
        "wheel": wheel.drawings(body),
    }
    parts: Parts = {"chassis": drawn("chassis", chassis.drawings(layout, body))}
    m = layout.scale
    for link, drawings in modules.items():
        scaled = [drawing._replace(solid=drawing.solid.scale([m, m, m])) for drawing in drawings]
        parts[link] = drawn(link, scaled)
    return parts


def tree(robot: SingularityRobot) -> Tree:
    """Return gimbals in the pivots: Y outward, X tangential, Z up at neutral tilt.

    l = Ry(beta) Rx(-alpha) z: Eq. 24 and 25 of the thesis. Wheels collide as spheres, which is what
    they are where they touch; frames not at all.
    """
    g = robot.drive
    azimuths = np.radians(g.azimuths_deg)
    k = len(azimuths)
    pivots = g.pivot_radius_m * np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(k)], axis=-1)
    tilt = Range(
        float(np.radians(g.max_tilt_deg)),
        robot.servo.no_load_speed_rpm * RPM,
        robot.servo.stall_torque_nm,
    )

    def limbs(kind: Link, joint: str, parent: Link, hinge: Hinge) -> Limbs:
        own = parent == "chassis"
        return Limbs(
            kind,
            tuple(f"module{i + 1}_{kind}" for i in range(k)),
            tuple(f"module{i + 1}_{joint}" for i in range(k)),
            parent,
            pivots if own else np.zeros((k, 3)),
            about_z(azimuths - 0.5 * np.pi) if own else SO3.identity((k,)),
            hinge,
            alike(_AXES[joint], k),
            tilt if hinge is Hinge.ANGLE else None,
            Sphere(g.wheel_radius_m) if kind == "wheel" else None,
        )

    inside = g.pivot_radius_m - _REACH * g.wheel_radius_m
    return Tree(
        g.wheel_radius_m,
        (
            limbs("outer", "beta", "chassis", Hinge.ANGLE),
            limbs("inner", "alpha", "outer", Hinge.ANGLE),
            limbs("wheel", "wheel", "inner", Hinge.SPIN),
        ),
        max(0.0, inside),
    )


def masses_kg(robot: SingularityRobot) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis weighs what the modules leave.

    Raises:
        RobotFileError: the modules alone are heavier than the robot.
    """
    mass = robot.mass
    modules = robot.drive.modules * (mass.wheel_kg + 2.0 * mass.gimbal_kg)
    if modules >= mass.total_kg:
        raise RobotFileError(
            robot.name,
            f"mass.total_kg is {mass.total_kg:g}, the modules alone weigh {modules:g}",
            "more than mass.wheel_kg and twice mass.gimbal_kg for each wheel",
        )
    return {
        "chassis": mass.total_kg - modules,
        "outer": mass.gimbal_kg,
        "inner": mass.gimbal_kg,
        "wheel": mass.wheel_kg,
    }
