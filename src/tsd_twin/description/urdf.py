"""The robot as URDF, for other people's tools.

Links: `base_footprint`, on the floor; `base_link`, above it and as high as the gimbal centres, with
the chassis; and for each module `module1_outer`, `module1_inner`, `module1_wheel`, ... Joints have
the names, signs and zeros of `SingularityDrive`, so a joint vector of the kinematics poses it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as ET

from tsd_twin.description.inertia import Inertia, inertia, masses_kg
from tsd_twin.description.look import Parts
from tsd_twin.description.part import Link, Part
from tsd_twin.robots import RPM, Robot

_AXES = {"beta": "0 1 0", "alpha": "-1 0 0", "wheel": "0 0 1"}
"""Of the joints: l = Ry(beta) Rx(-alpha) z, Eq. 24 and 25 of the thesis."""
_MODULE_REACH = 1.6
"""Inboard reach of a module from its pivot, in wheel radii; the drawings keep to it."""


def urdf(robot: Robot, parts: Parts, mesh_uri: str = "") -> str:
    """Return the URDF text.

    Wheels collide as spheres, which is what they are where they touch; the chassis as a cylinder
    between them, as far above the gimbal centres as its underside is below; frames not at all.

    Args:
        robot: its description.
        parts: its look, of each kind of link; also gives the inertias.
        mesh_uri: what goes before the name of each mesh file, for example
            `package://tsd_description/meshes/tsd/`. Nothing means beside the URDF.

    Raises:
        RobotFileError: the masses do not add up.
    """
    inertias = {kind: inertia(parts[kind], mass) for kind, mass in masses_kg(robot).items()}
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
    _collision_cylinder(link("base_link", "chassis"), robot, parts["chassis"])
    footprint = _joint(root, "base_joint", "fixed", ("base_footprint", "base_link"))
    _origin(footprint, (0.0, 0.0, robot.drive.wheel_radius_m))
    for i, azimuth_deg in enumerate(robot.drive.azimuths_deg):
        module, azimuth = f"module{i + 1}", math.radians(azimuth_deg)
        outer, inner, wheel = (f"{module}_{kind}" for kind in ("outer", "inner", "wheel"))
        link(outer, "outer")
        link(inner, "inner")
        _collision_sphere(link(wheel, "wheel"), robot.drive.wheel_radius_m)
        beta = _joint(root, f"{module}_beta", "revolute", ("base_link", outer))
        radius = robot.drive.pivot_radius_m
        at = (radius * math.cos(azimuth), radius * math.sin(azimuth), 0.0)
        _origin(beta, at, yaw=azimuth - 0.5 * math.pi)
        alpha = _joint(root, f"{module}_alpha", "revolute", (outer, inner))
        spin = _joint(root, f"{module}_wheel", "continuous", (inner, wheel))
        for joint, name in ((beta, "beta"), (alpha, "alpha"), (spin, "wheel")):
            ET.SubElement(joint, "axis", xyz=_AXES[name])
        for joint in (beta, alpha):
            _limit(joint, robot)
    ET.indent(root)
    # No encoding in the declaration: parsers refuse to take one from a text.
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


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
        # MuJoCo wants names that are unique in the whole file.
        visual = ET.SubElement(link, "visual", name=f"{link.get('name')}_{part.name}")
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", filename=mesh_uri + part.file)
        material = ET.SubElement(visual, "material", name=f"{part.link}_{part.name}")
        ET.SubElement(material, "color", rgba=" ".join(_text(c) for c in part.rgba))


def _collision_sphere(link: ET.Element, radius_m: float) -> None:
    geometry = ET.SubElement(ET.SubElement(link, "collision"), "geometry")
    ET.SubElement(geometry, "sphere", radius=_text(radius_m))


def _collision_cylinder(link: ET.Element, robot: Robot, chassis: Iterable[Part]) -> None:
    radius_m = robot.drive.pivot_radius_m - _MODULE_REACH * robot.drive.wheel_radius_m
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


def _limit(joint: ET.Element, robot: Robot) -> None:
    tilt = _text(math.radians(robot.drive.max_tilt_deg))
    ET.SubElement(
        joint,
        "limit",
        lower=f"-{tilt}",
        upper=tilt,
        effort=_text(robot.servo.stall_torque_nm),
        velocity=_text(robot.servo.no_load_speed_rpm * RPM),
    )


def _origin(element: ET.Element, xyz_m: Iterable[float], yaw: float = 0.0) -> None:
    xyz = " ".join(_text(value) for value in xyz_m)
    ET.SubElement(element, "origin", xyz=xyz, rpy=f"0 0 {_text(yaw)}")


def _text(value: float) -> str:
    """Return a number with the digits that matter, and without minus zero."""
    return f"{round(float(value), 12) + 0.0:.9g}"
