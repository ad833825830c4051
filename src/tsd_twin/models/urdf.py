"""URDF of a robot: links with inertia, visuals and collision shapes, and joints with limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.models.links import (
    BASE,
    CollisionShape,
    Cylinder,
    JointLimits,
    JointType,
    LinkGroup,
    kinematic_tree,
    masses_kg,
    roll_pitch_yaw,
)
from tsd_twin.models.solids import Link, Part, Parts
from tsd_twin.robots import RobotDescription


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """A rigid body, in the frame of its link."""

    mass_kg: float
    centre_m: Array
    """(3,): centre of mass."""
    tensor_kg_m2: Array
    """(3, 3): about the centre of mass, axes as those of the link."""


def inertia(parts: Iterable[Part], mass_kg: float) -> Inertia:
    """Inertia of `parts` that are rigidly connected and together weigh `mass_kg`.

    Densities only say how the mass is shared out: parts are solid here that are hollow in truth.
    """
    bodies: list[tuple[float, Array, Array]] = []
    for part in parts:
        mesh: Any = part.mesh
        density = part.material.density_kg_per_m3
        bodies.append(
            (density * mesh.volume, np.array(mesh.center_mass), density * mesh.moment_inertia)
        )
    total = sum(mass for mass, _, _ in bodies)
    centre = sum((mass * at for mass, at, _ in bodies), start=np.zeros(3)) / total
    tensor = np.zeros((3, 3))
    for mass, at, own in bodies:
        arm = at - centre
        # Parallel axis theorem.
        tensor += own + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertia(mass_kg, centre, tensor * (mass_kg / total))


_RINGS = (("yaw", "0 0 1"), ("pitch", "0 1 0"), ("roll", "1 0 0"))
"""Rings of a ball joint: turns about Z, then the new Y, then the new X."""
_RING_KG, _RING_KG_M2 = 1e-6, 1e-9
"""Mass and inertia of a virtual ring: URDF readers require them of every moving link."""


def urdf(robot: RobotDescription, parts: Parts, mesh_uri: str = "") -> str:
    """URDF text.

    Args:
        robot: its description.
        parts: of each kind of link; they also give the inertias.
        mesh_uri: what goes before the name of each mesh file, for example
            `package://tsd_description/meshes/tsd/`. Nothing means beside the URDF.

    Raises:
        RobotFileError: the masses do not add up.
    """
    inertias = {kind: inertia(parts[kind], mass) for kind, mass in masses_kg(robot).items()}
    tree = kinematic_tree(robot)
    root = ET.Element("robot", name=robot.name)
    # MuJoCo alone reads this: show visuals, keep base_link, and look for meshes beside the file.
    extension = ET.SubElement(root, "mujoco")
    ET.SubElement(
        extension, "compiler", discardvisual="false", fusestatic="false", strippath="true"
    )

    def link(name: str, kind: Link) -> ET.Element:
        element = ET.SubElement(root, "link", name=name)
        _inertial(element, inertias[kind])
        _visuals(element, parts[kind], mesh_uri)
        return element

    ET.SubElement(root, "link", name="base_footprint")
    _collision_core(link(BASE, "chassis"), tree.core_m, parts["chassis"])
    footprint = _joint(root, "base_joint", "fixed", ("base_footprint", BASE))
    _origin(footprint, (0.0, 0.0, tree.height_m))
    for i in range(max(group.count for group in tree.link_groups)):
        for group in (group for group in tree.link_groups if i < group.count):
            _collision(link(group.names[i], group.kind), group.collision)
            above = BASE if group.parent == "chassis" else tree.link_group(group.parent).names[i]
            if group.joint_type is JointType.BALL:
                above = _rings(root, group, i, above)
            _add_joint(root, group, i, above)
    ET.indent(root)
    # No encoding in the declaration: parsers refuse to take one from a text.
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_joint(root: ET.Element, group: LinkGroup, i: int, above: str) -> None:
    """Add the joint of a link; the innermost ring of a ball joint has a fixed one."""
    kind = "fixed" if group.joint_type is JointType.BALL else str(group.joint_type)
    joint = _joint(root, group.joints[i], kind, (above, group.names[i]))
    if group.joint_type is not JointType.BALL:
        _origin(joint, group.at_m[i], roll_pitch_yaw(group.turn.wxyz[i]))
    if group.joint_type in (JointType.ANGLE, JointType.SPIN):
        ET.SubElement(joint, "axis", xyz=" ".join(_text(part) for part in group.axes[i]))
    if group.range is not None:
        _limit(joint, group.range)


def _rings(root: ET.Element, group: LinkGroup, i: int, above: str) -> str:
    """Add the gimbal rings that represent a ball joint, and return the innermost."""
    for number, (name, axis) in enumerate(_RINGS):
        ring = f"{group.names[i]}_{name}"
        element = ET.SubElement(ET.SubElement(root, "link", name=ring), "inertial")
        _origin(element, (0.0, 0.0, 0.0))
        ET.SubElement(element, "mass", value=_text(_RING_KG))
        moments = {at: _text(_RING_KG_M2) for at in ("ixx", "iyy", "izz")}
        ET.SubElement(element, "inertia", ixy="0", ixz="0", iyz="0", attrib=moments)
        joint = _joint(root, f"{group.joints[i]}_{name}", str(JointType.SPIN), (above, ring))
        if number == 0:
            _origin(joint, group.at_m[i], roll_pitch_yaw(group.turn.wxyz[i]))
        ET.SubElement(joint, "axis", xyz=axis)
        above = ring
    return above


def _inertial(link: ET.Element, body: Inertia) -> None:
    element = ET.SubElement(link, "inertial")
    _origin(element, body.centre_m)
    ET.SubElement(element, "mass", value=_text(body.mass_kg))
    t = body.tensor_kg_m2
    names: Mapping[str, tuple[int, int]] = {
        "ixx": (0, 0),
        "ixy": (0, 1),
        "ixz": (0, 2),
        "iyy": (1, 1),
        "iyz": (1, 2),
        "izz": (2, 2),
    }
    # Products of symmetric parts are noise; a thousandth of a gram square millimetre is nothing.
    values = {name: _text(round(float(t[at]), 12)) for name, at in names.items()}
    ET.SubElement(element, "inertia", attrib=values)


def _visuals(link: ET.Element, parts: Iterable[Part], mesh_uri: str) -> None:
    for part in parts:
        # MuJoCo requires names that are unique in the whole file.
        visual = ET.SubElement(link, "visual", name=f"{link.get('name')}_{part.name}")
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", filename=mesh_uri + part.file)
        material = ET.SubElement(visual, "material", name=f"{part.link}_{part.name}")
        ET.SubElement(material, "color", rgba=" ".join(_text(c) for c in part.material.rgba))


def _collision(link: ET.Element, shape: CollisionShape) -> None:
    if shape is None:
        return
    collision = ET.SubElement(link, "collision")
    if isinstance(shape, Cylinder):
        # Theirs are about Z.
        _origin(collision, (0.0, 0.0, 0.0), (0.5 * math.pi, 0.0, 0.0))
        size = {"radius": _text(shape.radius_m), "length": _text(shape.length_m)}
        ET.SubElement(ET.SubElement(collision, "geometry"), "cylinder", attrib=size)
    else:
        geometry = ET.SubElement(collision, "geometry")
        ET.SubElement(geometry, "sphere", radius=_text(shape.radius_m))


def _collision_core(link: ET.Element, radius_m: float, chassis: Iterable[Part]) -> None:
    if radius_m <= 0.0:
        return
    below_m = -min(float(part.mesh.vertices[:, 2].min()) for part in chassis)
    geometry = ET.SubElement(ET.SubElement(link, "collision"), "geometry")
    ET.SubElement(geometry, "cylinder", radius=_text(radius_m), length=_text(2.0 * below_m))


def _joint(root: ET.Element, name: str, kind: str, links: tuple[str, str]) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    return joint


def _limit(joint: ET.Element, limits: JointLimits) -> None:
    angle = _text(limits.angle_rad)
    ET.SubElement(
        joint,
        "limit",
        lower=f"-{angle}",
        upper=angle,
        effort=_text(limits.torque_nm),
        velocity=_text(limits.speed_rad_per_s),
    )


def _origin(
    element: ET.Element, xyz_m: Iterable[float], rpy: Iterable[float] = (0.0, 0.0, 0.0)
) -> None:
    xyz, angles = (" ".join(_text(value) for value in three) for three in (xyz_m, rpy))
    ET.SubElement(element, "origin", xyz=xyz, rpy=angles)


def _text(value: float) -> str:
    """Number with the digits that matter, and without minus zero."""
    return f"{round(float(value), 12) + 0.0:.9g}"
