"""Robot shape from a third-party URDF, against another reader, and from hostile text."""

from __future__ import annotations

import io
import math
import xml.etree.ElementTree as ET

import msgspec
import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.adapters.frames import parse_urdf
from tsd_twin.adapters.ros.external_robot import ExternalLimits, describe
from tsd_twin.adapters.ros_messages import RobotMapping
from tsd_twin.adapters.ros_topics import RosNames
from tsd_twin.dashboard.scene.robot_geometry import RobotShape
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages.errors import MessageError
from tsd_twin.models import robot_urdf
from tsd_twin.models.external_urdf import MOST_BYTES, read_urdf
from tsd_twin.robots import ExternalDescription
from tsd_twin.robots.external import MOST_JOINTS, NOT_PROMISED

calm = settings(max_examples=25)
TOLERANCE_M = 2e-3
"""Positions have four decimals, angles two of a degree; errors add up along a chain."""
ONE_LINK = '<link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'


def described(urdf: str, limits: ExternalLimits | None = None) -> ExternalDescription:
    text = describe("cart", urdf, limits or ExternalLimits())
    robot = robots.parse_description(text, "cart")
    assert isinstance(robot, ExternalDescription)
    return robot


def urdf_of(rng: np.random.Generator, links: int) -> str:
    """URDF of a random tree with a shape on each link."""
    root = ET.Element("robot", name="random")

    def numbers(count: int, size: float) -> str:
        return " ".join(f"{value:.5f}" for value in rng.uniform(-size, size, count))

    for i in range(links):
        link = ET.SubElement(root, "link", name=f"l{i}")
        visual = ET.SubElement(link, "visual")
        ET.SubElement(visual, "origin", xyz=numbers(3, 0.3), rpy=numbers(3, 3.0))
        geometry = ET.SubElement(visual, "geometry")
        size = " ".join(f"{value:.4f}" for value in rng.uniform(0.02, 0.4, 3))
        match rng.integers(3):
            case 0:
                ET.SubElement(geometry, "box", size=size)
            case 1:
                radius, length, _ = size.split()
                ET.SubElement(geometry, "cylinder", radius=radius, length=length)
            case _:
                ET.SubElement(geometry, "sphere", radius=size.split()[0])
        if not i:
            continue
        kind = str(rng.choice(["fixed", "revolute", "continuous", "prismatic"]))
        joint = ET.SubElement(root, "joint", name=f"j{i}", type=kind)
        ET.SubElement(joint, "parent", link=f"l{rng.integers(i)}")
        ET.SubElement(joint, "child", link=f"l{i}")
        ET.SubElement(joint, "origin", xyz=numbers(3, 0.5), rpy=numbers(3, 3.0))
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)  # The other reader multiplies by the length of an axis.
        ET.SubElement(joint, "axis", xyz=" ".join(map(str, axis)))
        ET.SubElement(joint, "limit", lower="-9", upper="9", effort="1", velocity="1")
    return ET.tostring(root, encoding="unicode")


@calm
@given(seed=st.integers(0, 2**32), links=st.integers(1, 9))
def test_every_shape_is_where_another_reader_has_it_at_any_joints(seed: int, links: int) -> None:
    rng = np.random.default_rng(seed)
    text = urdf_of(rng, links)
    robot = described(text)
    names = [joint.name for joint in robot.drive.joints]
    values = rng.uniform(-1.5, 1.5, len(names))
    other = yourdfpy.URDF.load(io.StringIO(text), load_meshes=False, build_scene_graph=True)
    other.update_cfg(dict(zip(names, values, strict=True)))
    shape = RobotShape(robot)
    assert [joint.name for joint in shape.joints[2:]] == names
    poses = shape.skeleton.poses(
        SE2.identity(), SO3.identity(), np.concatenate([np.zeros(2), values])
    )
    kinds = {"": "chassis"} | {name: f"link{i + 1}" for i, name in enumerate(names)}
    ours = []
    for part in robot.drive.parts:
        frame = poses[kinds[part.on]]
        place = frame.position[0] + SO3(frame.wxyz[0]).rotate(np.array(part.at_m))
        ours.append([*place, *sorted(part.size_m)])
    theirs = []
    for link in other.robot.links:
        visual = link.visuals[0]
        pose = other.get_transform(link.name) @ visual.origin
        geometry = visual.geometry
        if geometry.box is not None:
            size = list(geometry.box.size)
        elif geometry.cylinder is not None:
            size = [2.0 * geometry.cylinder.radius] * 2 + [geometry.cylinder.length]
        else:
            size = [2.0 * geometry.sphere.radius] * 3
        height = np.array([0.0, 0.0, robot.drive.height_m])
        theirs.append([*(pose[:3, 3] + height), *sorted(size)])
    assert len(ours) == len(theirs) == links
    ends = np.array(ours)
    for row in np.array(theirs):
        assert np.abs(ends - row).max(axis=1).min() < TOLERANCE_M
    # No part is below the floor, with joints at zero.
    assert shape.collision.vertices[:, 2].min() > -TOLERANCE_M


@calm
@given(seed=st.integers(0, 2**32))
def test_what_is_shown_to_other_tools_is_a_urdf_with_the_same_joints(seed: int) -> None:
    robot = described(urdf_of(np.random.default_rng(seed), 6))
    text = robot_urdf(robot)
    names = {joint.name for joint in robot.drive.joints}
    assert names <= parse_urdf(text).joints.keys()
    mapping = RobotMapping("cart", RosNames("cart", False), text, "")
    assert len(mapping.static()) == 2


def test_meshes_are_drawn_as_their_collisions_or_by_their_inertia_and_said() -> None:
    mesh = '<visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual>'
    text = f"""<robot name="r">
      <link name="a">{mesh}
        <collision><geometry><box size="0.2 0.3 0.4"/></geometry></collision></link>
      <link name="b">{mesh}<inertial><mass value="12"/>
        <inertia ixx="1.25" iyy="1.0" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="c">{mesh}</link>
      <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
      <joint name="bc" type="floating"><parent link="b"/><child link="c"/></joint>
    </robot>"""
    shape, said = read_urdf(text)
    sizes = [part.size_m for part in shape.parts]
    assert sizes[0] == (0.2, 0.3, 0.4)
    # m / 12 (y^2 + z^2) and so on.
    x, y, z = sizes[1]
    assert (y * y + z * z, x * x + z * z, x * x + y * y) == pytest.approx(
        (1.25, 1.0, 0.5), abs=1e-3
    )
    assert len(sizes) == 2
    text = " ".join(said)
    for instead in ("the shapes of their collisions", "boxes of the same inertia", "nothing"):
        assert instead in text
    assert "1 of the URDF are drawn as if they stood still" in text


def test_colours_are_those_of_the_urdf() -> None:
    shape, _ = read_urdf(
        '<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>'
        '<link name="a"><visual><geometry><box size="1 1 1"/></geometry><material name="red"/>'
        '</visual><visual><geometry><box size="1 1 1"/></geometry>'
        '<material name="x"><color rgba="0 1 0 0"/></material></visual></link></robot>'
    )
    assert [part.colour_rgba for part in shape.parts] == [
        (1.0, 0.0, 0.0, 1.0),
        (0.0, 1.0, 0.0, 0.1),
    ]


def test_a_robot_with_too_many_parts_is_drawn_as_boxes_within_a_description() -> None:
    many = "".join(
        f'<visual><origin xyz="{0.01 * i} 0 0.1"/>'
        '<geometry><sphere radius="0.1"/></geometry></visual>'
        for i in range(900)
    )
    links = "".join(f'<link name="x{i}"/>' for i in range(90))
    joints = "".join(
        f'<joint name="a_joint_with_a_name_that_is_rather_long_{i}" type="revolute">'
        f'<parent link="{"a" if not i else f"x{i - 1}"}"/><child link="x{i}"/>'
        f'<origin xyz="0.123456 0.234567 0.1" rpy="0.1234 0.2345 0.3456"/>'
        f'<axis xyz="0.123 0.456 0.789"/></joint>'
        for i in range(90)
    )
    robot = described(f'<robot name="r"><link name="a">{many}</link>{links}{joints}</robot>')
    assert len(robot.drive.joints) == MOST_JOINTS
    (box,) = robot.drive.parts
    assert box.size_m == pytest.approx((9.19, 0.2, 0.2), abs=1e-3)
    assert any("900 parts" in text for text in robot.not_promised)


def deep(count: int) -> str:
    return f'<robot name="r">{"<a>" * count}{"</a>" * count}{ONE_LINK}</robot>'


HOSTILE = {
    "empty": " ",
    "no XML": "what?",
    "another root": "<svg/>",
    "no links": '<robot name="r"/>',
    "entities": '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>',
    "a file": '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>',
    "hidden": "<!-- --><!DOCTYPE r><robot/><!-- -->",
    "in an instruction": '<?x <!-- ?><!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "-->">]>'
    f'<robot name="&a;">{ONE_LINK}</robot>',
    "in another encoding": '<?xml version="1.0" encoding="utf-8"?><!DOCTYPE r><robot name="r"/>',
    "10 MB": "<robot>" + " " * 10_000_000 + "</robot>",
    "nan": f'<robot name="r">{ONE_LINK}<link name="b"/><joint name="j" type="fixed">'
    '<parent link="a"/><child link="b"/><origin xyz="nan 0 0"/></joint></robot>',
    "infinite": ONE_LINK.join(['<robot name="r">', "</robot>"]).replace("1 1 1", "1 1 inf"),
    "negative": ONE_LINK.join(['<robot name="r">', "</robot>"]).replace("1 1 1", "1 1 -1"),
    "far": f'<robot name="r">{ONE_LINK}<link name="b"/><joint name="j" type="fixed">'
    '<parent link="a"/><child link="b"/><origin xyz="1e9 0 0"/></joint></robot>',
    "two roots": f'<robot name="r">{ONE_LINK}<link name="b"/></robot>',
    "circle": f'<robot name="r">{ONE_LINK}<link name="b"/><link name="c"/>'
    '<joint name="j" type="fixed"><parent link="b"/><child link="c"/></joint>'
    '<joint name="k" type="fixed"><parent link="c"/><child link="b"/></joint></robot>',
    "two parents": f'<robot name="r">{ONE_LINK}<link name="b"/>'
    '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    '<joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint></robot>',
    "no axis": f'<robot name="r">{ONE_LINK}<link name="b"/><joint name="j" type="revolute">'
    '<parent link="a"/><child link="b"/><axis xyz="0 0 0"/></joint></robot>',
    "words": ONE_LINK.join(['<robot name="r">', "</robot>"]).replace("1 1 1", "wide"),
    "5,000 links": "<robot>" + "".join(f'<link name="{i}"/>' for i in range(5000)) + "</robot>",
    "surrogate": f'<robot name="r">{ONE_LINK}\ud800</robot>',
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_what_is_no_urdf_is_refused_and_the_robot_is_a_box_that_says_so(text: str) -> None:
    with pytest.raises(MessageError):
        read_urdf(text)
    robot = described(text)
    assert len(robot.drive.parts) == 1
    assert robot.not_promised[: len(NOT_PROMISED)] == NOT_PROMISED
    assert any("it is drawn as a box" in sentence for sentence in robot.not_promised)
    assert all(len(sentence) <= 300 for sentence in robot.assumptions)


def test_nesting_and_length_up_to_the_limit_take_no_long_time() -> None:
    text = deep(20_000)
    assert len(read_urdf(text)[0].parts) == 1
    assert len(text) < MOST_BYTES


@calm
@given(st.text(max_size=200), st.text(max_size=60))
def test_any_text_and_any_names_make_a_description(text: str, name: str) -> None:
    root = ET.Element("robot", name="r")
    for link in ("a", "b"):
        ET.SubElement(root, "link", name=link)
    joint = ET.SubElement(root, "joint", name=name, type="continuous")
    ET.SubElement(joint, "parent", link="a")
    ET.SubElement(joint, "child", link="b")
    for urdf in (text, ET.tostring(root, encoding="unicode")):
        robot = described(urdf)
        assert robot.drive.parts
        assert msgspec.to_builtins(robot)


@given(st.floats(0.01, 5.0), st.floats(0.01, 5.0), st.floats(0.2, 5.0), st.booleans())
def test_limits_are_those_of_the_flags(speed: float, turn: float, gain: float, omni: bool) -> None:
    robot = described("", ExternalLimits(speed, turn, gain, sideways=omni))
    assert (robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s) == (speed, turn)
    assert robot.limits.acceleration_mps2 == robot.limits.deceleration_mps2 == gain
    drive = robot.kinematics()
    twist = np.array([0.5 * speed, 0.25 * speed, -0.5 * turn])
    assert drive.forward(drive.inverse(twist)).twist == pytest.approx(twist * [1.0, omni, 1.0])
    assert float(drive.joint_utilization(2.0 * twist)) == pytest.approx(1.0)
    assert math.isfinite(robot.limits.stop_allowance_m)
