"""Shape of an external ROS robot from its URDF, and its keys in a description.

URDFs are untrusted: their size, numbers and link count are bounded, and they must not declare
entities. Meshes are not fetched.
"""

from __future__ import annotations

import itertools
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from xml.parsers import expat

import msgspec
import numpy as np
from msgspec.structs import replace

from tsd_twin.lie import SO3, Array
from tsd_twin.messages.errors import MessageError
from tsd_twin.models.external import FramePose, frame_pose
from tsd_twin.models.links import from_roll_pitch_yaw, roll_pitch_yaw, three_numbers
from tsd_twin.robots.external import (
    JOINT_NAME,
    MOST_JOINTS,
    MOST_PARTS,
    RESERVED,
    ExternalGeometry,
    ExternalJoint,
    ExternalPart,
    Triple,
)
from tsd_twin.robots.loader import MAX_FILE_CHARS

MOST_BYTES = 1_000_000
"""Maximum URDF size; large robots have 200,000 bytes."""
_MAX_LINKS = 2000
_MIN_SIZE_M, _MAX_DISTANCE_M = 0.001, 20.0
"""Minimum thickness of a part, and maximum distance from the base."""
_MOVING = frozenset({"revolute", "continuous", "prismatic"})
_BOX = ExternalPart(shape="box", size_m=(0.4, 0.3, 0.15), at_m=(0.0, 0.0, 0.075))
_HERE = FramePose(np.zeros(3), SO3.identity())


def stand_in(reason: str) -> tuple[ExternalGeometry, tuple[str, ...]]:
    """Return a box for a robot of unknown shape, and a sentence about it."""
    return ExternalGeometry(parts=[_BOX]), (f"Its shape: {reason}, so it is drawn as a box.",)


def read_urdf(text: str) -> tuple[ExternalGeometry, tuple[str, ...]]:
    """Return the shape in a URDF, and sentences about deviations from it.

    Raises:
        MessageError: If the text is not a URDF or too large (reason `shape`).
    """
    if len(text) > MOST_BYTES:
        raise MessageError("shape", f"a URDF of {len(text)} characters is too long")
    try:
        _refuse_doctype(text.encode())
        # Entities cannot be declared, and expat reads no external files.
        root = ET.fromstring(text.encode())  # noqa: S314
        return _UrdfReader(root).read()
    except (
        ET.ParseError,
        expat.ExpatError,
        ValueError,
        KeyError,
        RecursionError,
        OverflowError,
    ) as error:
        raise MessageError("shape", f"not a URDF: {str(error)[:200]}") from error


def _refuse_doctype(text: bytes) -> None:
    """Parse up to a document type, which may declare entities, and reject it."""

    def refuse(*_: object) -> None:
        raise MessageError("shape", "a URDF that declares a document type or entities is refused")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(text, True)


class _UrdfReader:
    """Parser for a URDF."""

    def __init__(self, root: ET.Element) -> None:
        if root.tag != "robot":
            raise ValueError(f"its root is <{root.tag[:40]}>, not <robot>")
        self._links = {link.attrib["name"]: link for link in root.findall("link")}
        if not 0 < len(self._links) <= _MAX_LINKS:
            raise ValueError(f"it has {len(self._links)} links, not 1 to {_MAX_LINKS}")
        self._colours = {
            material.get("name", ""): colour
            for material in root.findall("material")
            if (colour := _colour(material)) is not None
        }
        self._children: dict[str, list[ET.Element]] = {name: [] for name in self._links}
        children: set[str] = set()
        for joint in root.findall("joint"):
            above, below = _end(joint, "parent"), _end(joint, "child")
            if above not in self._links or below not in self._links:
                raise ValueError(f"a joint hangs on a link that is not there: {above}, {below}")
            if below in children:
                raise ValueError(f"the link {below[:60]} has two parents")
            children.add(below)
            self._children[above].append(joint)
        roots = self._links.keys() - children
        if len(roots) != 1:
            raise ValueError(f"it has {len(roots)} root links, not one")
        (self._root,) = roots
        self._parts: list[ExternalPart] = []
        self._joints: list[ExternalJoint] = []
        self._meshes: dict[str, int] = {}
        self._stiff = 0

    def read(self) -> tuple[ExternalGeometry, tuple[str, ...]]:
        """Return the shape, and sentences about deviations from it."""
        waiting = [(self._root, "", _HERE)]
        seen = 0
        while waiting:
            name, on, pose = waiting.pop()
            seen += 1
            self._add_parts(self._links[name], on, pose)
            waiting += [self._follow(joint, on, pose) for joint in self._children[name]]
        if seen != len(self._links):
            raise ValueError("its links go round in a circle")
        return self._result()

    def _follow(self, joint: ET.Element, on: str, pose: FramePose) -> tuple[str, str, FramePose]:
        """Return the link below a joint, the joint that moves it, and its pose."""
        here, below = pose @ _origin(joint), _end(joint, "child")
        kind, name = joint.get("type"), joint.get("name", "")
        if kind == "fixed":
            return below, on, here
        taken = name in RESERVED or any(name == other.name for other in self._joints)
        if (
            kind not in _MOVING
            or len(self._joints) >= MOST_JOINTS
            or taken
            or not JOINT_NAME.fullmatch(name)
        ):
            self._stiff += 1
            return below, on, here
        element = joint.find("axis")
        axis = three_numbers(None if element is None else element.get("xyz"), (1.0, 0.0, 0.0))
        length = math.hypot(*axis)
        if not length > 1e-9:
            raise ValueError(f"the axis of {name} has no direction")
        x, y, z = (round(part / length, 6) for part in axis)
        self._joints.append(
            ExternalJoint(
                name=name,
                on=on,
                slides=kind == "prismatic",
                at_m=_written(here.at),
                rpy_deg=_degrees(here.turn),
                axis=(x, y, z),
            )
        )
        return below, name, _HERE

    def _add_parts(self, link: ET.Element, on: str, pose: FramePose) -> None:
        parts, meshes = self._shapes(link, link.findall("visual"))
        if meshes:
            simple, _ = self._shapes(link, link.findall("collision"))
            instead = simple or _inertia_box(link)
            how = "the shapes of their collisions" if simple else "boxes of the same inertia"
            how = how if instead else "nothing"
            self._meshes[how] = self._meshes.get(how, 0) + meshes
            parts += instead
        for part, where in parts:
            place = pose @ where
            if np.abs(place.at).max() > _MAX_DISTANCE_M:
                raise ValueError(f"a part is farther than {_MAX_DISTANCE_M:g} m from its joint")
            self._parts.append(
                replace(part, on=on, at_m=_written(place.at), rpy_deg=_degrees(place.turn))
            )

    def _shapes(
        self, link: ET.Element, elements: Iterable[ET.Element]
    ) -> tuple[list[tuple[ExternalPart, FramePose]], int]:
        """Return the parts of visuals or collisions, and how many of them are meshes."""
        found: list[tuple[ExternalPart, FramePose]] = []
        meshes = 0
        for element in elements:
            geometry = element.find("geometry")
            if geometry is None:
                raise ValueError(f"a shape of {link.attrib['name'][:60]} has no geometry")
            part = _part(geometry)
            if part is None:
                meshes += 1
                continue
            if (material := element.find("material")) is not None:
                colour = _colour(material) or self._colours.get(material.get("name", ""))
                if colour is not None:
                    part = replace(part, colour_rgba=colour)
            found.append((part, _origin(element)))
        return found, meshes

    def _result(self) -> tuple[ExternalGeometry, tuple[str, ...]]:
        said = [
            f"Its meshes: {count} of the URDF are not fetched, drawn instead: {how}."
            for how, count in self._meshes.items()
        ]
        if self._stiff:
            said.append(f"Its joints: {self._stiff} of the URDF are drawn as if they stood still.")
        if not self._parts:
            shape, sentences = stand_in("its URDF has no shape that can be drawn")
            return replace(shape, joints=[]), (*said, *sentences)
        shape = ExternalGeometry(parts=self._parts, joints=self._joints)
        if len(self._parts) > MOST_PARTS or len(geometry_toml(shape)) > MAX_FILE_CHARS - 4000:
            used = {part.on for part in self._parts}
            carriers = [on for on in ("", *(joint.name for joint in self._joints)) if on in used]
            shape = replace(shape, parts=[_bounding_box(shape, on) for on in carriers])
            said.append(f"Its shape: {len(self._parts)} parts are drawn as a box for each joint.")
        low_m = min(float(corner[2]) for corner in _corners(shape))
        return replace(shape, height_m=round(max(0.0, -low_m), 4)), tuple(said)


def _end(joint: ET.Element, which: str) -> str:
    end = joint.find(which)
    if end is None:
        raise ValueError(f"a joint has no {which}")
    return end.attrib["link"]


def _origin(element: ET.Element) -> FramePose:
    origin = element.find("origin")
    if origin is None:
        return _HERE
    at = np.array(three_numbers(origin.get("xyz")))
    if np.abs(at).max() > _MAX_DISTANCE_M:
        raise ValueError(f"an origin is farther than {_MAX_DISTANCE_M:g} m away")
    return FramePose(at, from_roll_pitch_yaw(np.array(three_numbers(origin.get("rpy")))))


def _part(geometry: ET.Element) -> ExternalPart | None:
    """Return the part in a `<geometry>`, or None for a mesh or unknown element."""
    box, cylinder = geometry.find("box"), geometry.find("cylinder")
    sphere = geometry.find("sphere")
    if box is not None:
        return ExternalPart(shape="box", size_m=_sizes(*three_numbers(box.attrib["size"])))
    if cylinder is not None:
        wide = 2.0 * float(cylinder.attrib["radius"])
        size = _sizes(wide, wide, float(cylinder.attrib["length"]))
        return ExternalPart(shape="cylinder", size_m=size)
    if sphere is not None:
        wide = 2.0 * float(sphere.attrib["radius"])
        return ExternalPart(shape="sphere", size_m=_sizes(wide, wide, wide))
    return None


def _sizes(x: float, y: float, z: float) -> Triple:
    # False for NaN.
    if not all(0.0 <= size <= 2.0 * _MAX_DISTANCE_M for size in (x, y, z)):
        raise ValueError(f"a size is not 0 to {2.0 * _MAX_DISTANCE_M:g} m")
    a, b, c = (round(max(size, _MIN_SIZE_M), 4) for size in (x, y, z))
    return a, b, c


def _colour(material: ET.Element) -> tuple[float, float, float, float] | None:
    element = material.find("color")
    if element is None:
        return None
    numbers = [float(part) for part in element.attrib["rgba"].split()]
    if len(numbers) != 4 or not all(map(math.isfinite, numbers)):
        raise ValueError("a colour is not four numbers")
    r, g, b, a = (round(min(1.0, max(0.0, number)), 3) for number in numbers)
    return r, g, b, max(a, 0.1)


def _inertia_box(link: ET.Element) -> list[tuple[ExternalPart, FramePose]]:
    """Return a homogeneous box with the mass and moments of inertia of a link, if any."""
    inertial = link.find("inertial")
    if inertial is None:
        return []
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        return []
    kg = float(mass.attrib["value"])
    xx, yy, zz = (float(inertia.attrib[name]) for name in ("ixx", "iyy", "izz"))
    if not (kg > 0.0 and all(map(math.isfinite, (kg, xx, yy, zz)))):
        return []
    sizes = [
        math.sqrt(max(0.0, 6.0 * moment / kg))
        for moment in (yy + zz - xx, xx + zz - yy, xx + yy - zz)
    ]
    if max(sizes) > 2.0 * _MAX_DISTANCE_M:
        return []
    part = ExternalPart(shape="box", size_m=_sizes(*sizes))
    return [(part, _origin(inertial))]


def _written(at: Array) -> Triple:
    x, y, z = (round(float(part), 4) + 0.0 for part in at)
    return x, y, z


def _degrees(turn: SO3) -> Triple:
    x, y, z = (round(math.degrees(angle), 2) + 0.0 for angle in roll_pitch_yaw(turn.wxyz))
    return x, y, z


def _part_corners(part: ExternalPart) -> Array:
    """Return the corners (8, 3) of the box around a part, in the frame of its joint."""
    pose, half = frame_pose(part), 0.5 * np.array(part.size_m)
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return pose.at + np.array([pose.turn.rotate(corner) for corner in signs * half])


def _bounding_box(shape: ExternalGeometry, on: str) -> ExternalPart:
    """Return a box along the axes of a joint around all its parts."""
    parts = [part for part in shape.parts if part.on == on]
    corners = np.concatenate([_part_corners(part) for part in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return ExternalPart(
        shape="box",
        size_m=_sizes(*(high - low).clip(0.0, 2.0 * _MAX_DISTANCE_M)),
        on=on,
        at_m=_written(0.5 * (low + high)),
        colour_rgba=parts[0].colour_rgba,
    )


def _corners(shape: ExternalGeometry) -> Iterator[Array]:
    """Yield the corners of all parts in the base frame, with joints at zero."""
    frames = {"": _HERE}
    for joint in shape.joints:
        frames[joint.name] = frames[joint.on] @ frame_pose(joint)
    for part in shape.parts:
        frame = frames[part.on]
        yield from (frame.at + frame.turn.rotate(corner) for corner in _part_corners(part))


def geometry_toml(shape: ExternalGeometry) -> str:
    """Format the keys of `[drive]` as TOML, with a line per part and joint."""
    lines = [f"sideways = {json.dumps(shape.sideways)}", f"height_m = {shape.height_m!r}"]
    for key, entries in (("joints", shape.joints), ("parts", shape.parts)):
        lines.append(f"{key} = [")
        lines += [f"  {_inline(entry)}," for entry in entries]
        lines.append("]")
    return "\n".join(lines) + "\n"


def _inline(entry: ExternalPart | ExternalJoint) -> str:
    """Format a table on one line, without default values."""
    said = {
        field.name: value
        for field in msgspec.structs.fields(type(entry))
        if (value := getattr(entry, field.name)) != field.default
    }
    # JSON and TOML agree for all characters allowed in names.
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in said.items()) + " }"
