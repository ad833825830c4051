"""Conversion to ROS messages for every built-in robot: frames, units, REP 103 and 105."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from yourdfpy import URDF

from tsd_twin import robots
from tsd_twin.adapters.frames import (
    FOOTPRINT,
    WheelAngles,
    parse_urdf,
)
from tsd_twin.adapters.ros_messages import RobotMapping, RosMessage
from tsd_twin.adapters.ros_topics import PUBLISHED, SERVICES, SOURCES, RosNames, namespaces
from tsd_twin.lie import SO3
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, ODOM, JointState, Odometry, encode_joints, encode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import (
    ConsistencyStatus,
    LeaseStatus,
    LoopStatus,
    RobotStatus,
    encode_status,
)
from tsd_twin.messages.topics import Topic
from tsd_twin.models import shipped_model
from tsd_twin.models.links import from_roll_pitch_yaw, roll_pitch_yaw

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP_NS = 1_700_000_000_123_456_789
ALL = robots.robot_names()
BALLS = [name for name in ALL if robots.load_robot(name).kinematics().pose_type is SO3]
FLOOR = [name for name in ALL if name not in BALLS]
ALONE, ONE_OF_MANY = RosNames("left", shared=False), RosNames("left", shared=True)
EYE = np.eye(3)


def urdf_file(name: str) -> Path:
    return shipped_model(name) / f"{name}.urdf"


def mapping(name: str, names: RosNames = ALONE) -> RobotMapping:
    return RobotMapping("left", names, urdf_file(name).read_text("utf-8"), "package://left/")


def decoded(messages: Iterator[RosMessage] | list[RosMessage]) -> dict[str, Any]:
    return {each.name: STORE.deserialize_cdr(each.payload, each.topic.type) for each in messages}


def odometry(pose: tuple[float, float, float], wxyz: Any = None) -> bytes:
    twist = np.array([0.1, 0.2, 0.3])
    return encode_odometry(Odometry(np.array(pose), twist, EYE, EYE, STAMP_NS, wxyz))


def stamp_ns(header: Any) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def matrix(transform: Any) -> Any:
    """(4, 4) matrix of a `geometry_msgs/msg/Transform`."""
    turn, move = transform.rotation, transform.translation
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    found[:3, 3] = move.x, move.y, move.z
    return found


def tree_of(it: RobotMapping, payloads: dict[Topic, bytes]) -> dict[str, tuple[str, Any]]:
    """Parent and pose of each frame after these messages; each frame has one parent."""
    messages = [
        *it.static(),
        *(m for topic, data in payloads.items() for m in it.convert(topic, data)),
    ]
    frames: dict[str, tuple[str, Any]] = {}
    for message in messages:
        if message.name in ("/tf", "/tf_static"):
            for each in STORE.deserialize_cdr(message.payload, message.topic.type).transforms:
                assert each.child_frame_id not in frames, "REP 105: one parent for each frame"
                frames[each.child_frame_id] = (each.header.frame_id, matrix(each.transform))
    return frames


def pose_in(root: str, frame: str, frames: dict[str, tuple[str, Any]]) -> Any:
    pose = np.eye(4)
    while frame != root:
        parent, step = frames[frame]
        pose, frame = step @ pose, parent
    return pose


def measured(name: str, angle: float) -> tuple[dict[str, float], bytes]:
    """Measured angles of all URDF joints for a robot on the floor, and their message."""
    joints = [j.name for j in parse_urdf(urdf_file(name).read_text()).joints.values() if j.axis]
    angles = {joint: angle * (0.3 + 0.1 * i) for i, joint in enumerate(joints)}
    values = np.array(list(angles.values()))
    message = JointState(tuple(angles), values, np.zeros(len(values)), STAMP_NS)
    return angles, encode_joints(message)


@pytest.mark.parametrize("name", FLOOR)
@pytest.mark.parametrize("angle", [0.0, 0.4, -0.7])
def test_every_link_stands_where_another_reader_of_the_urdf_puts_it(
    name: str, angle: float
) -> None:
    """Compares the tree of `/tf`, from `odom` down, with yourdfpy."""
    angles, joints = measured(name, angle)
    frames = tree_of(
        mapping(name), {topics.JOINTS: joints, topics.ODOM: odometry((1.0, -2.0, 0.5))}
    )
    oracle: Any = URDF.load(str(urdf_file(name)), load_meshes=False, build_scene_graph=True)
    oracle.update_cfg(angles)
    at = np.eye(4)
    at[:3, :3] = Rotation.from_euler("z", 0.5).as_matrix()
    at[:3, 3] = 1.0, -2.0, 0.0
    for link in oracle.link_map:
        expected = at @ oracle.get_transform(link, FOOTPRINT)
        assert np.allclose(pose_in(ODOM, link, frames), expected, atol=1e-9), link


@pytest.mark.parametrize("name", BALLS)
@given(turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_sphere_has_its_orientation_in_tf_and_in_odom(
    name: str, turn: tuple[float, float, float]
) -> None:
    wxyz = SO3.exp(np.array(turn)).wxyz
    it = mapping(name)
    message = decoded(it.convert(topics.ODOM, odometry((0.0, 0.0, 0.0), wxyz)))["/odom"]
    frames = tree_of(it, {topics.ODOM: odometry((0.0, 0.0, 0.0), wxyz)})
    expected = Rotation.from_quat(wxyz[[1, 2, 3, 0]])
    found = pose_in(ODOM, message.child_frame_id, frames)[:3, :3]
    assert np.allclose(found, expected.as_matrix(), atol=1e-6)
    # The bus has the angular velocity in base axes, ROS in the child's axes.
    spin = message.twist.twist.angular
    assert np.allclose(expected.apply([spin.x, spin.y, spin.z]), [0.1, 0.2, 0.3], atol=1e-9)


@pytest.mark.parametrize("names", [ALONE, ONE_OF_MANY])
def test_names_and_frames_have_the_namespace_when_there_are_several_robots(names: RosNames) -> None:
    it = mapping("tsd", names)
    prefix = "left/" if names.shared else ""
    message = decoded(it.convert(topics.ODOM, odometry((1.0, 2.0, 0.5))))[f"/{prefix}odom"]
    assert message.header.frame_id == f"{prefix}{ODOM}"
    assert message.child_frame_id == f"{prefix}{FOOTPRINT}"
    assert stamp_ns(message.header) == STAMP_NS
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    assert (at.x, at.y, at.z) == (1.0, 2.0, 0.0)
    assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(0.5)
    _, joints = measured("tsd", 0.1)
    for frame, (parent, _) in tree_of(
        it, {topics.JOINTS: joints, topics.ODOM: odometry((0, 0, 0))}
    ).items():
        assert frame.startswith(prefix)
        assert parent.startswith(prefix)


@given(st.lists(st.from_regex(r"\A[a-z0-9_-]{1,32}\Z"), unique=True, max_size=8))
def test_every_id_becomes_a_ros_name_of_its_own(ids: list[str]) -> None:
    names = namespaces(ids)
    words = [each.namespace for each in names.values()]
    assert len(set(words)) == len(ids)
    for word in words:
        assert word[0].isalpha()
        assert word.replace("_", "a").isalnum()
    assert all(each.shared == (len(ids) > 1) for each in names.values())


def test_joints_that_are_no_joints_of_the_urdf_are_left_out_and_wheels_have_an_angle() -> None:
    names = ("module1_alpha", "module1_wheel", "gyro")
    it = mapping("tsd")
    for i in range(11):
        position = np.array([0.1, math.nan, math.nan])
        velocity = np.array([0.0, 3.0, 1.0])
        data = encode_joints(JointState(names, position, velocity, STAMP_NS + i * 20_000_000))
        message = decoded(it.convert(topics.JOINTS, data))["/joint_states"]
    assert message.name == ["module1_alpha", "module1_wheel"]
    assert message.position.tolist() == pytest.approx([0.1, 3.0 * 0.2])
    assert message.velocity.tolist() == [0.0, 3.0]
    assert len(message.effort) == 0


@given(st.lists(st.tuples(st.floats(-1e4, 1e4), st.integers(-(10**9), 10**9)), max_size=20))
def test_the_angle_of_a_wheel_stays_within_a_turn_whatever_the_stamps(
    steps: list[tuple[float, int]],
) -> None:
    wheels, at_ns = WheelAngles(), STAMP_NS
    for velocity, step_ns in steps:
        at_ns += step_ns
        angle = wheels.update(("wheel",), (math.nan,), (velocity,), at_ns)["wheel"]
        assert abs(angle) <= math.pi + 1e-9


@given(st.tuples(*[st.floats(-math.pi, math.pi)] * 3))
def test_angles_about_axes_are_those_of_scipy(angles: tuple[float, float, float]) -> None:
    turn = from_roll_pitch_yaw(np.array(angles)).wxyz
    ours = Rotation.from_quat(turn, scalar_first=True)
    assert np.allclose(ours.as_matrix(), Rotation.from_euler("xyz", angles).as_matrix())
    again = Rotation.from_euler("xyz", roll_pitch_yaw(turn))
    assert np.allclose(again.as_matrix(), ours.as_matrix(), atol=1e-6)


def test_status_becomes_diagnostics_and_battery_once_a_second_and_when_the_mode_changes() -> None:
    it = mapping("tsd")
    counted: defaultdict[str, int] = defaultdict(int)
    newest: dict[str, Any] = {}
    for period in range(100):  # Five seconds.
        mode = "ready" if period < 50 else "fault"
        at_ns = STAMP_NS + period * 50_000_000
        odom = encode_odometry(Odometry(np.zeros(3), np.zeros(3), EYE, EYE, at_ns))
        list(it.convert(topics.ODOM, odom))
        status = RobotStatus(
            mode,
            stop_reason="a gimbal is stuck" if mode == "fault" else "",
            lease=LeaseStatus(holder="alice"),
            consistency=ConsistencyStatus(suspect="module2", level=1.5),
            hardware={"battery_v": 11.5},
            loop=LoopStatus(99.2, 3, 12.5, 140.0 if mode == "fault" else 20.0),
        )
        for name, message in decoded(it.convert(topics.STATUS, encode_status(status))).items():
            counted[name] += 1
            newest[name] = message
    assert counted["/status"] == 100
    assert counted["/diagnostics"] == counted["/battery_state"] == 7
    assert newest["/battery_state"].voltage == 11.5
    assert math.isnan(newest["/battery_state"].percentage)
    by_name = {each.name: each for each in newest["/diagnostics"].status}
    assert by_name["left: mode"].level == 2
    assert by_name["left: mode"].message == "a gimbal is stuck"
    assert by_name["left: consistency"].level == 1
    assert by_name["left: loop"].level == 1
    assert by_name["left: loop"].message == "99 Hz, longest period 140 ms"
    assert {"holder": "alice"}.items() <= {
        value.key: value.value for value in by_name["left: mode"].values
    }.items()


def test_twists_that_are_refused_are_an_error_of_the_diagnostics_at_once() -> None:
    problem = ""
    urdf = urdf_file("tsd").read_text("utf-8")
    it = RobotMapping("left", ALONE, urdf, "package://left/", lambda: problem)
    status = encode_status(RobotStatus("ready"))
    levels: list[tuple[int, str]] = []
    for problem in ("", "it must pause", "it must pause", ""):  # noqa: B007  The function reads it.
        for message in decoded(it.convert(topics.STATUS, status)).values():
            found = getattr(message, "status", [])
            levels += [(each.level, each.message) for each in found if "cmd_vel" in each.name]
    assert levels == [(0, "ok"), (2, "it must pause"), (0, "ok")]


def test_an_event_becomes_a_line_of_the_log() -> None:
    it = mapping("tsd")
    list(it.convert(topics.ODOM, odometry((0, 0, 0))))
    event = msgspec.json.encode(Event("drop", "1 command is too old.", rule="stale"))
    line = decoded(it.convert(topics.EVENT, event))["/events"]
    assert (line.level, line.name, line.msg) == (30, "left.drop", "1 command is too old.")
    assert line.stamp.sec == STAMP_NS // 10**9


def test_the_description_names_its_meshes_by_package() -> None:
    text = decoded(mapping("tsd").static())["/robot_description"].data
    oracle: Any = URDF.load(str(urdf_file("tsd")), load_meshes=False)
    expected = {
        f"package://left/{visual.geometry.mesh.filename}"
        for link in oracle.link_map.values()
        for visual in link.visuals
    }
    assert expected
    assert all(f'filename="{uri}"' in text for uri in expected)
    assert 'filename="chassis' not in text


@pytest.mark.parametrize("text", ["", "<robot", "<robot><joint name='a'/></robot>"])
def test_what_is_no_urdf_is_refused(text: str) -> None:
    with pytest.raises(MessageError):
        RobotMapping("left", ALONE, text, "")


@given(st.sampled_from(sorted(SOURCES, key=lambda topic: topic.path)), st.binary(max_size=200))
def test_any_bytes_on_a_stream_are_converted_or_refused(topic: Topic, payload: bytes) -> None:
    try:
        list(mapping("tsd").convert(topic, payload))
    except MessageError:
        return


def test_a_pose_that_is_not_finite_reaches_no_tree_of_frames() -> None:
    with pytest.raises(MessageError):
        list(mapping("tsd").convert(topics.ODOM, odometry((math.nan, 0.0, 0.0))))


def test_nothing_is_made_for_topics_that_no_client_wants() -> None:
    it = mapping("tsd")
    _, joints = measured("tsd", 0.1)
    streams = ((topics.JOINTS, joints), (topics.ODOM, odometry((0, 0, 0))))
    for topic, payload in streams:
        assert not list(it.convert(topic, payload, lambda _name: False))
    made = [
        message
        for topic, payload in streams
        for message in it.convert(topic, payload, lambda name: name == "/tf")
    ]
    assert [message.name for message in made] == ["/tf"], "pose and joints in one message"


def test_joints_that_come_no_more_are_not_sent_again_with_a_new_pose() -> None:
    it = mapping("tsd")
    _, joints = measured("tsd", 0.1)
    list(it.convert(topics.JOINTS, joints))
    sizes = [
        len(decoded(it.convert(topics.ODOM, odometry((0, 0, 0))))["/tf"].transforms)
        for _ in range(2)
    ]
    assert sizes == [10, 1]


def test_the_table_is_whole() -> None:
    made = {row for rows in SOURCES.values() for row in rows}
    assert {row for row in PUBLISHED if row.source != "desc"} == made
    assert len({row.name for row in PUBLISHED}) == len(PUBLISHED)
    known = {topic.path for topic in topics.TOPICS} | {"desc"}
    for row in PUBLISHED:
        assert set(row.source.split(", ")) <= known
        assert row.type in STORE.types
    assert SERVICES == ("arm", "disarm", "stop", "reset", "resume")
    assert BASE == "base_link"
