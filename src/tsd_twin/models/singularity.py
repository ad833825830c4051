"""Model of a singularity drive: parts, kinematic tree, masses."""

from __future__ import annotations

import numpy as np

from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SO3
from tsd_twin.models import singularity_chassis, singularity_gimbals
from tsd_twin.models.links import (
    JointLimits,
    JointType,
    KinematicTree,
    LinkGroup,
    Sphere,
    about_z,
    alike,
)
from tsd_twin.models.singularity_layout import Layout
from tsd_twin.models.solids import Drawing, Link, Parts, drawn
from tsd_twin.robots import RPM, SingularityDescription

_AXES = {"beta": (0.0, 1.0, 0.0), "alpha": (-1.0, 0.0, 0.0), "wheel": (0.0, 0.0, 1.0)}
_REACH = 1.6
"""Inboard reach of a module from its pivot, in wheel radii; the drawings keep to it."""


def draw(robot: SingularityDescription) -> Parts:
    """Return the parts; modules are alike, so `outer`, `inner` and `wheel` are there once.

    Raises:
        RobotFileError: there is no room for the modules.
    """
    layout, body = Layout.of(robot), robot.body
    modules: dict[Link, list[Drawing]] = {
        "outer": singularity_gimbals.outer_gimbal_drawings(layout, body),
        "inner": singularity_gimbals.inner_gimbal_drawings(body),
        "wheel": singularity_gimbals.wheel_drawings(body),
    }
    parts: Parts = {"chassis": drawn("chassis", singularity_chassis.chassis_drawings(layout, body))}
    m = layout.scale
    for link, drawings in modules.items():
        scaled = [drawing._replace(solid=drawing.solid.scale([m, m, m])) for drawing in drawings]
        parts[link] = drawn(link, scaled)
    return parts


def tree(robot: SingularityDescription) -> KinematicTree:
    """Return gimbals in the pivots: Y outward, X tangential, Z up at neutral tilt.

    l = Ry(beta) Rx(-alpha) z: Eq. 24 and 25 of the thesis. Wheels collide as spheres, which is what
    they are where they touch; frames not at all.
    """
    g = robot.drive
    azimuths = np.radians(g.azimuths_deg)
    k = len(azimuths)
    pivots = g.pivot_radius_m * np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(k)], axis=-1)
    tilt = JointLimits(
        float(np.radians(g.max_tilt_deg)),
        robot.servo.no_load_speed_rpm * RPM,
        robot.servo.stall_torque_nm,
    )

    def link_groups(kind: Link, joint: str, parent: Link, hinge: JointType) -> LinkGroup:
        own = parent == "chassis"
        return LinkGroup(
            kind,
            tuple(f"module{i + 1}_{kind}" for i in range(k)),
            tuple(f"module{i + 1}_{joint}" for i in range(k)),
            parent,
            pivots if own else np.zeros((k, 3)),
            about_z(azimuths - 0.5 * np.pi) if own else SO3.identity((k,)),
            hinge,
            alike(_AXES[joint], k),
            tilt if hinge is JointType.ANGLE else None,
            Sphere(g.wheel_radius_m) if kind == "wheel" else None,
        )

    inside = g.pivot_radius_m - _REACH * g.wheel_radius_m
    return KinematicTree(
        g.wheel_radius_m,
        (
            link_groups("outer", "beta", "chassis", JointType.ANGLE),
            link_groups("inner", "alpha", "outer", JointType.ANGLE),
            link_groups("wheel", "wheel", "inner", JointType.SPIN),
        ),
        max(0.0, inside),
    )


def masses_kg(robot: SingularityDescription) -> dict[Link, float]:
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
