"""Parts and URDF as files: writing them, reading them, finding those that come with the program.

A folder holds one binary STL for each part, `parts.json` with their materials, and the URDF.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import msgspec
import trimesh

from tsd_twin.description.look import draw, tree
from tsd_twin.description.part import Link, Material, Part, Parts
from tsd_twin.description.urdf import urdf
from tsd_twin.errors import MeshError
from tsd_twin.robots import Robot
from tsd_twin.robots.robot import Colour, Positive, Share

_LIST = "parts.json"
_Word: TypeAlias = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9_]+\Z")]


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an STL file does not say about a part."""

    link: _Word
    name: _Word
    rgba: Colour
    metallic: Share
    roughness: Share
    density_kg_per_m3: Positive


def parts(robot: Robot) -> Parts:
    """Return the parts of each kind of link: those in the folder `body.meshes`, or else drawn.

    Raises:
        RobotFileError: there is no room for what the drive needs.
        MeshError: the folder lacks a file, or a mesh in it is not a closed solid.
    """
    if robot.body.meshes is None:
        return draw(robot)
    return read(Path(robot.body.meshes), tree(robot).kinds)


def read(folder: Path, kinds: Sequence[Link]) -> Parts:
    """Return the parts in a folder, for a robot with these kinds of links.

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
        found[entry.link].append(Part.of(entry.name, entry.link, _load(path), material))
    bare = [link for link, several in found.items() if not several]
    if bare:
        raise MeshError(f"{folder / _LIST} has no part for {', '.join(bare)}")
    return {link: tuple(several) for link, several in found.items()}


def write(robot: Robot, folder: Path) -> None:
    """Write parts, list and URDF into `folder`, the same bytes for the same description.

    Raises:
        RobotFileError: there is no room for what the drive needs, or the masses do not add up.
        MeshError: as in `parts`.
    """
    look = parts(robot)
    text = urdf(robot, look)
    folder.mkdir(parents=True, exist_ok=True)
    entries: list[_Entry] = []
    for part in (part for several in look.values() for part in several):
        mesh: Any = part.mesh
        (folder / part.file).write_bytes(mesh.export(file_type="stl"))
        entries.append(
            _Entry(
                part.link,
                part.name,
                part.rgba,
                part.metallic,
                part.roughness,
                part.density_kg_per_m3,
            )
        )
    (folder / _LIST).write_bytes(
        msgspec.json.format(msgspec.json.encode(entries), indent=1) + b"\n"
    )
    (folder / f"{robot.name}.urdf").write_text(text, "utf-8")


def shipped(name: str) -> Path:
    """Return the folder of the generated files of a shipped robot.

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
    try:
        loader: Any = trimesh
        return loader.load_mesh(path)
    except (OSError, ValueError) as error:
        raise MeshError(f"{path} cannot be read: {error}") from error
