"""Mesh and URDF files: generating, reading and finding shipped ones; binary glTF for renderers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import msgspec
import numpy as np
from manifold3d import Manifold, Mesh

from tsd_twin.errors import MeshError
from tsd_twin.models.links import draw_parts, kinematic_tree
from tsd_twin.models.solids import Link, Material, Part, Parts
from tsd_twin.models.urdf import urdf
from tsd_twin.robots import RobotDescription, SphereDescription, load_robot, robot_names
from tsd_twin.robots.description import Colour, Positive, Share

if TYPE_CHECKING:
    import trimesh  # Imported where it is used, as in `solids`.

_CREASE_DEG = 32.0
"""Edges sharper than this stay sharp: more than a facet of 12 sides has, less than a chamfer."""


def glb(parts: Iterable[Part]) -> bytes:
    """Return one scene with a mesh for each of `parts`, metres, in the frame of their link."""
    import trimesh

    scene: Any = trimesh.Scene()
    for part in parts:
        scene.add_geometry(_shaded(part), node_name=part.name, geom_name=part.name)
    return scene.export(file_type="glb", include_normals=True)


def _shaded(part: Part) -> trimesh.Trimesh:
    """Mesh with a normal for each corner, vertices split where edges are sharp."""
    import trimesh
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
    """Linear colour channel of an sRGB one, for glTF; IEC 61966-2-1."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4


_LIST = "parts.json"
_Word: TypeAlias = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9_]+\Z")]


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Data of a part that an STL file lacks."""

    link: _Word
    name: _Word
    rgba: Colour
    metallic: Share
    roughness: Share
    density_kg_per_m3: Positive


def load_parts(robot: RobotDescription) -> Parts:
    """Parts of each kind of link: those in the folder `body.meshes`, or else drawn.

    Raises:
        RobotFileError: there is no room for what the drive needs.
        MeshError: the folder lacks a file, or a mesh in it is not a closed solid.
    """
    if robot.body.meshes is None:
        return draw_parts(robot)
    return read_model(Path(robot.body.meshes), kinematic_tree(robot).kinds)


_NOT_DRAWN = {
    "title", "sources", "assumptions", "limits", "battery", "pose_sensor",
    "calibration", "noise", "errors", "floor", "gyro",
}  # fmt: skip
"""Fields of descriptions that no model depends on; nor `motor`, but for a sphere, whose wheels turn
as fast as its motors can."""


def robot_urdf(robot: RobotDescription) -> str:
    """URDF text of a robot with meshes beside it; that of a shipped robot is a file.

    Drawing a robot takes most of a second, to load what draws. A robot is drawn only if it differs
    from the shipped one of its name in what a model depends on, not for its calibration.

    Raises:
        RobotFileError: as in `load_parts`, or the masses do not add up.
        MeshError: as in `load_parts`.
    """
    if robot.name in robot_names() and _drawn_alike(robot, load_robot(robot.name)):
        return (shipped_model(robot.name) / f"{robot.name}.urdf").read_text("utf-8")
    return urdf(robot, load_parts(robot))


def _drawn_alike(a: RobotDescription, b: RobotDescription) -> bool:
    """Whether two robots are of one kind and equal in all that their models depend on."""
    names = set(a.__struct_fields__) - _not_drawn(a)
    return type(a) is type(b) and all(getattr(a, name) == getattr(b, name) for name in names)


def _not_drawn(robot: RobotDescription) -> set[str]:
    return _NOT_DRAWN if isinstance(robot, SphereDescription) else {*_NOT_DRAWN, "motor"}


def read_model(folder: Path, kinds: Sequence[Link]) -> Parts:
    """Parts in a folder, for a robot with these kinds of links.

    Raises:
        MeshError: a file is missing or unreadable, a mesh is not a closed solid, a link is bare, or
            of no such kind.
    """
    try:
        entries = msgspec.json.decode((folder / _LIST).read_bytes(), type=list[_Entry])
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
    """Write parts, list and URDF into `folder`, the same bytes for the same description.

    Raises:
        RobotFileError: there is no room for what the drive needs, or the masses do not add up.
        MeshError: as in `parts`.
    """
    parts = load_parts(robot)
    text = urdf(robot, parts)
    folder.mkdir(parents=True, exist_ok=True)
    entries: list[_Entry] = []
    for part in (part for several in parts.values() for part in several):
        mesh: Any = part.mesh
        (folder / part.file).write_bytes(mesh.export(file_type="stl"))
        of = part.material
        entries.append(
            _Entry(part.link, part.name, of.rgba, of.metallic, of.roughness, of.density_kg_per_m3)
        )
    (folder / _LIST).write_bytes(
        msgspec.json.format(msgspec.json.encode(entries), indent=1) + b"\n"
    )
    (folder / f"{robot.name}.urdf").write_text(text, "utf-8")


def shipped_model(name: str) -> Path:
    """Folder of the generated files of a shipped robot.

    An installed package has them inside; an editable install beside its sources.

    Raises:
        MeshError: there is no such folder.
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
