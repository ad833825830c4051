"""Mesh and URDF files: generating, reading and finding shipped ones; binary glTF for renderers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple
from itertools import chain, combinations_with_replacement
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias
from xml.etree import ElementTree as ET

import msgspec
import numpy as np

from tsd_twin.errors import MeshError
from tsd_twin.lie import Array
from tsd_twin.models.kinds import draw_parts, kinematic_tree, masses_kg
from tsd_twin.models.links import (
    BASE,
    CollisionShape,
    Cylinder,
    JointType,
    Link,
    LinkGroup,
    roll_pitch_yaw,
)
from tsd_twin.robots import RobotDescription, load_robot, robot_names
from tsd_twin.tables import Colour, Positive, Share

if TYPE_CHECKING:
    import trimesh  # Imported at use, as in `solids`.

    from tsd_twin.models.solids import Part, Parts


def inertia(parts: Iterable[Part], mass_kg: float) -> tuple[Array, Array]:
    """Return the centre of mass (3,) and the inertia tensor (3, 3) of rigidly connected `parts`.

    In metres and kg m², in link axes; the tensor is about the centre of mass. Densities only
    determine the distribution of `mass_kg`, because some solid parts are hollow in reality.
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
    return centre, tensor * (mass_kg / total)


_RINGS = (("yaw", "0 0 1"), ("pitch", "0 1 0"), ("roll", "1 0 0"))
"""Rings of a ball joint: rotations about Z, then the new Y, then the new X."""
_RING_KG, _RING_KG_M2 = 1e-6, 1e-9
"""Mass and inertia of a virtual ring, which URDF readers require for every moving link."""


def urdf(robot: RobotDescription, parts: Parts, mesh_uri: str = "") -> str:
    """Return the URDF text.

    Args:
        robot: Description of the robot.
        parts: Parts of each kind of link, which also determine the inertias.
        mesh_uri: Prefix of each mesh file, such as `package://tsd_description/meshes/tsd/`; empty
            if meshes are next to the URDF.

    Raises:
        RobotFileError: If the masses are inconsistent.
    """
    masses = masses_kg(robot)
    inertias = {kind: inertia(parts[kind], mass) for kind, mass in masses.items()}
    tree = kinematic_tree(robot)
    root = ET.Element("robot", name=robot.name)
    # Read only by MuJoCo: keep visuals and base_link, and look for meshes next to the file.
    settings = {"discardvisual": "false", "fusestatic": "false", "strippath": "true"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", settings)

    def link(name: str, kind: Link) -> ET.Element:
        element = ET.SubElement(root, "link", name=name)
        _inertial(element, masses[kind], *inertias[kind])
        _visuals(element, parts[kind], mesh_uri)
        return element

    ET.SubElement(root, "link", name="base_footprint")
    _collision_core(link(BASE, "chassis"), tree.core_m, parts["chassis"])
    footprint = _joint(root, "base_joint", "fixed", ("base_footprint", BASE))
    _origin(footprint, (0.0, 0.0, tree.height_m))
    for i in range(max((group.count for group in tree.link_groups), default=0)):
        for group in (group for group in tree.link_groups if i < group.count):
            _collision(link(group.names[i], group.kind), group.collision)
            above = BASE if group.parent == "chassis" else tree.link_group(group.parent).names[i]
            if group.joint_type is JointType.BALL:
                above = _rings(root, group, i, above)
            _add_joint(root, group, i, above)
    ET.indent(root)
    # Omit the encoding from the declaration, because parsers reject it in a str.
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_joint(root: ET.Element, group: LinkGroup, i: int, above: str) -> None:
    """Add the joint of a link; a fixed one for the innermost ring of a ball joint."""
    kind = "fixed" if group.joint_type is JointType.BALL else str(group.joint_type)
    joint = _joint(root, group.joints[i], kind, (above, group.names[i]))
    if group.joint_type is not JointType.BALL:
        _origin(joint, group.at_m[i], roll_pitch_yaw(group.turn.wxyz[i]))
    if group.joint_type in (JointType.ANGLE, JointType.SPIN, JointType.SLIDE):
        ET.SubElement(joint, "axis", xyz=_text(*group.axes[i]))
    if (limits := group.range) is not None:
        angle, torque = _text(limits.angle_rad), _text(limits.torque_nm)
        speed = _text(limits.speed_rad_per_s)
        ET.SubElement(joint, "limit", lower=f"-{angle}", upper=angle, effort=torque, velocity=speed)


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


def _inertial(link: ET.Element, mass_kg: float, centre_m: Array, tensor: Array) -> None:
    element = ET.SubElement(link, "inertial")
    _origin(element, centre_m)
    ET.SubElement(element, "mass", value=_text(mass_kg))
    # Round off the noise in the products of inertia of symmetric parts.
    values = {
        f"i{a}{b}": _text(round(float(tensor[i, j]), 12))
        for (i, a), (j, b) in combinations_with_replacement(enumerate("xyz"), 2)
    }
    ET.SubElement(element, "inertia", attrib=values)


def _visuals(link: ET.Element, parts: Iterable[Part], mesh_uri: str) -> None:
    for part in parts:
        # MuJoCo requires unique names in the whole file.
        visual = ET.SubElement(link, "visual", name=f"{link.get('name')}_{part.name}")
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", filename=mesh_uri + part.file)
        material = ET.SubElement(visual, "material", name=f"{part.link}_{part.name}")
        ET.SubElement(material, "color", rgba=_text(*part.material.rgba))


def _collision(link: ET.Element, shape: CollisionShape) -> None:
    if shape is None:
        return
    collision = ET.SubElement(link, "collision")
    if isinstance(shape, Cylinder):
        # URDF cylinders are along Z.
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


def _origin(
    element: ET.Element, xyz_m: Iterable[float], rpy: Iterable[float] = (0.0, 0.0, 0.0)
) -> None:
    ET.SubElement(element, "origin", xyz=_text(*xyz_m), rpy=_text(*rpy))


def _text(*values: float) -> str:
    """Format numbers with their significant digits, and without minus zero."""
    return " ".join(f"{round(float(value), 12) + 0.0:.9g}" for value in values)


_CREASE_DEG = 32.0
"""Edges sharper than this remain sharp: above the facets of a 12-sided circle, below a chamfer."""


def glb(parts: Iterable[Part]) -> bytes:
    """Return a scene with a mesh for each of `parts`, metres, in the frame of their link."""
    import trimesh

    scene: Any = trimesh.Scene()
    for part in parts:
        scene.add_geometry(_shaded(part), node_name=part.name, geom_name=part.name)
    return scene.export(file_type="glb", include_normals=True)


def _shaded(part: Part) -> trimesh.Trimesh:
    """Return a mesh with a normal per corner, with vertices split at sharp edges."""
    import trimesh
    from manifold3d import Manifold, Mesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    solid = Manifold(
        Mesh(
            np.asarray(1e3 * part.mesh.vertices, np.float32), np.asarray(part.mesh.faces, np.uint32)
        )
    )
    drawn: Any = solid.calculate_normals(0, _CREASE_DEG).to_mesh()
    corners = np.asarray(drawn.vert_properties, np.float64)
    r, g, b, opacity = part.material.rgba
    material = PBRMaterial(
        name=part.name,
        baseColorFactor=[round(255 * c) for c in (*(_linear(c) for c in (r, g, b)), opacity)],
        metallicFactor=part.material.metallic,
        roughnessFactor=part.material.roughness,
        alphaMode="BLEND" if opacity < 1.0 else "OPAQUE",
    )
    return trimesh.Trimesh(
        1e-3 * corners[:, :3],
        np.asarray(drawn.tri_verts),
        vertex_normals=corners[:, 3:6],
        visual=TextureVisuals(material=material),
        process=False,
    )


def _linear(srgb: float) -> float:
    """Convert an sRGB channel to linear, for glTF; IEC 61966-2-1."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4


_LIST = "parts.json"
_Word: TypeAlias = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9_]+\Z")]


class _PartMetadata(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Data of a part that an STL file lacks."""

    link: _Word
    name: _Word
    rgba: Colour
    metallic: Share
    roughness: Share
    density_kg_per_m3: Positive


def load_parts(robot: RobotDescription) -> Parts:
    """Load the parts of each kind of link from `body.meshes`, or draw them.

    Raises:
        RobotFileError: If there is no room for the drive.
        MeshError: If the folder lacks a file, or a mesh is not a closed solid.
    """
    if robot.body.meshes is None:
        return draw_parts(robot)
    return read_model(Path(robot.body.meshes), kinematic_tree(robot).kinds)


def robot_urdf(robot: RobotDescription) -> str:
    """Return the URDF text of a robot with meshes next to it; shipped robots have a file.

    Drawing takes almost a second, mostly to import libraries. A robot is therefore drawn only if it
    differs from the shipped robot of its name in a field that models depend on, unlike its
    calibration. It raises like `load_parts`, and a `RobotFileError` for inconsistent masses.
    """
    if robot.name in robot_names() and _same_drawing(robot, load_robot(robot.name)):
        return (shipped_model(robot.name) / f"{robot.name}.urdf").read_text("utf-8")
    return urdf(robot, load_parts(robot))


def _same_drawing(a: RobotDescription, b: RobotDescription) -> bool:
    """Return whether two robots have equal kinds and equal fields that models depend on."""
    names = set(a.__struct_fields__) - a.not_drawn
    return type(a) is type(b) and all(getattr(a, name) == getattr(b, name) for name in names)


def read_model(folder: Path, kinds: Sequence[Link]) -> Parts:
    """Read the parts in a folder, for a robot with these kinds of links.

    Raises:
        MeshError: If a file is missing or unreadable, a mesh is not a closed solid, or a link has
            no parts or an unknown kind.
    """
    from tsd_twin.models.solids import Material, Part  # Late, because it needs the extra `models`.

    try:
        entries = msgspec.json.decode((folder / _LIST).read_bytes(), type=list[_PartMetadata])
    except (OSError, msgspec.MsgspecError) as error:
        raise MeshError(f"{folder / _LIST} cannot be read: {error}") from error
    found: dict[Link, list[Part]] = {link: [] for link in kinds}
    for entry in entries:
        if entry.link not in found:
            raise MeshError(
                f"{folder / _LIST}: {entry.link} is no link of this robot, which has "
                + ", ".join(kinds)
            )
        material = Material(entry.rgba, entry.metallic, entry.roughness, entry.density_kg_per_m3)
        path = folder / f"{entry.link}_{entry.name}.stl"
        found[entry.link].append(Part(entry.name, entry.link, _load(path), material))
    bare = [link for link, several in found.items() if not several]
    if bare:
        raise MeshError(f"{folder / _LIST} has no part for {', '.join(bare)}")
    return {link: tuple(several) for link, several in found.items()}


def write_model(robot: RobotDescription, folder: Path) -> None:
    """Write parts, list and URDF into `folder`, byte-identical for equal descriptions."""
    parts = load_parts(robot)
    text = urdf(robot, parts)
    folder.mkdir(parents=True, exist_ok=True)
    entries: list[_PartMetadata] = []
    for part in chain.from_iterable(parts.values()):
        mesh: Any = part.mesh
        (folder / part.file).write_bytes(mesh.export(file_type="stl"))
        entries.append(_PartMetadata(part.link, part.name, *astuple(part.material)))
    (folder / _LIST).write_bytes(
        msgspec.json.format(msgspec.json.encode(entries), indent=1) + b"\n"
    )
    (folder / f"{robot.name}.urdf").write_text(text, "utf-8")


def shipped_model(name: str) -> Path:
    """Return the folder with the generated files of a shipped robot.

    It is inside an installed package, and next to the sources in an editable install.

    Raises:
        MeshError: If there is no such folder.
    """
    package = Path(__file__).parents[1]
    for meshes in (package / "meshes", package.parents[1] / "meshes"):
        if (meshes / name / _LIST).is_file():
            return meshes / name
    raise MeshError(f"no meshes of '{name}' come with this program")


def _load(path: Path) -> trimesh.Trimesh:
    import trimesh

    try:
        loader: Any = trimesh
        return loader.load_mesh(path)
    except (OSError, ValueError) as error:
        raise MeshError(f"{path} cannot be read: {error}") from error
