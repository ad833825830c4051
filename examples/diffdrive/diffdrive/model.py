"""Model of a differential drive: body, two wheels and a caster; kinematic tree and masses."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from diffdrive.kind import DiffDriveDescription
from diffdrive.kinematics import WHEELS
from tsd_twin.lie import SO3
from tsd_twin.models import JointType, KinematicTree, LinkGroup, solids
from tsd_twin.models.links import Cylinder, alike, chassis_mass_kg
from tsd_twin.models.solids import Drawing, Link, Parts, drawn

_GAP = 4.0
"""Gap between body and wheel, millimetres."""


def draw(robot: DiffDriveDescription) -> Parts:
    """Parts of body and wheel, in the frame of their link."""
    radius, track, width = _sizes(robot)
    inside, body = 0.5 * (track - width) - _GAP, robot.body
    caster = 0.25 * radius
    case = solids.box((-1.5 * radius, 1.5 * radius), (-inside, inside), (-0.4 * radius, radius))
    stem = solids.rod(0.5 * caster, (-radius + caster, -0.3 * radius), at=(-1.2 * radius, 0.0, 0.0))
    ball = Manifold.sphere(caster, 48).translate((-1.2 * radius, 0.0, caster - radius))
    arrow = solids.slab(
        solids.polygon([(0.0, -0.5 * radius), (radius, 0.0), (0.0, 0.5 * radius)]),
        (radius, radius + 2.0),
    )
    chassis = [
        Drawing("case", case, solids.frame_material(body)),
        Drawing("caster", stem + ball, solids.BLACK),
        Drawing("arrow", arrow, solids.front_material(body)),
    ]
    tyre = solids.rod(radius, (-0.5 * width, 0.5 * width), axis="y")
    return {
        "chassis": drawn("chassis", chassis),
        "wheel": drawn("wheel", [Drawing("tyre", tyre, solids.RUBBER)]),
    }


def tree(robot: DiffDriveDescription) -> KinematicTree:
    """Return both wheels on the chassis; `base_link` is in the middle of the axle."""
    radius, track, width = _sizes(robot)
    wheels = LinkGroup(
        kind="wheel",
        names=tuple(f"{name}_link" for name in WHEELS),
        joints=WHEELS,
        parent="chassis",
        at_m=5e-4 * track * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]),
        turn=SO3.identity((2,)),
        joint_type=JointType.SPIN,
        axes=alike((0.0, 1.0, 0.0), 2),
        collision=Cylinder(1e-3 * radius, 1e-3 * width),
    )
    return KinematicTree(1e-3 * radius, (wheels,), core_m=0.0)


def masses_kg(robot: DiffDriveDescription) -> dict[Link, float]:
    """Return the mass of body and wheel."""
    mass = robot.mass
    wheels_kg = 2.0 * mass.wheel_kg
    needed = "twice mass.wheel_kg"
    body_kg = chassis_mass_kg(robot, mass.total_kg, wheels_kg, "wheels", needed)
    return {"chassis": body_kg, "wheel": mass.wheel_kg}


def _sizes(robot: DiffDriveDescription) -> tuple[float, float, float]:
    """Wheel radius, track and width of a tyre, millimetres."""
    radius, track = 1e3 * robot.drive.wheel_radius_m, 1e3 * robot.drive.track_m
    return radius, track, min(0.4 * radius, 0.3 * track)
