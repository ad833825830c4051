"""The filter passes only messages that viser reads and the role permits."""

from __future__ import annotations

import contextlib
import math
from typing import Any, cast

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages as messages

from tests.support.viser_client import CAMERA
from tsd_twin.dashboard.gateway.viewport import MAX_MESSAGE_BYTES, filter_message
from tsd_twin.messages.errors import MessageError
from tsd_twin.security import Role

ROLES = [Role.OPERATOR, Role.VIEWER]
ALL_KINDS = sorted(kind.__name__ for kind in messages.Message.get_subclasses())
values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**31), 2**31) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


def through(message: Any, role: Role) -> Any:
    frame = filter_message(msgspec.msgpack.encode(message), role)
    return None if frame is None else msgspec.msgpack.decode(frame)


@pytest.mark.parametrize("role", ROLES)
def test_everybody_may_look_around(role: Role) -> None:
    assert through(CAMERA, role) == CAMERA


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("kind", [k for k in ALL_KINDS if k != CAMERA["type"]])
def test_of_all_that_viser_knows_nothing_else_passes(kind: str, role: Role) -> None:
    with contextlib.suppress(MessageError):  # Messages that no page sends end the connection.
        assert filter_message(msgspec.msgpack.encode({"type": kind, "uuid": "u"}), role) is None


@pytest.mark.parametrize("role", ROLES)
@given(st.sampled_from(sorted(CAMERA)), values)
def test_a_camera_passes_as_browsers_send_it_or_not_at_all(
    role: Role, field: str, value: Any
) -> None:
    if field == "type":
        return
    result = through({**CAMERA, field: value}, role)
    if result is None:
        return
    assert set(result) == set(CAMERA)
    shapes = [[type(n) for n in flat(each)] for each in (result, CAMERA)]
    assert shapes[0] == shapes[1]
    assert all(math.isfinite(number) for number in flat(result))


def flat(camera: dict[str, Any]) -> list[float]:
    """Return all numbers of a camera, in field order."""
    values: list[Any] = [camera[field] for field in sorted(camera) if field != "type"]
    return [
        number
        for value in values
        for number in (cast("list[float]", value) if isinstance(value, list) else [value])
    ]


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(
    "wrong",
    [
        {"look_at": "x" * 4000},
        {"look_at": [0.0, 0.0]},
        {"look_at": [0.0] * 4},
        {"position": [math.nan, 0.0, 0.0]},
        {"position": [0.0, 0.0, math.inf]},
        {"position": [0.0, 0.0, 1e300]},
        {"position": [0.0, 0.0, "1"]},
        {"position": [0.0, 0.0, True]},
        {"up_direction": {"x": 0.0}},
        {"wxyz": [0.0, 0.0, 0.0, 0.0]},
        {"wxyz": [1e200, 0.0, 0.0, 0.0]},
        {"fov": 0.0},
        {"fov": math.nan},
        {"near": None},
        {"image_height": -1},
        {"image_width": 2**63},
        {"image_width": "1280"},
        {"more": 0},
    ],
)
def test_a_camera_with_one_wrong_field_is_dropped(wrong: dict[str, Any], role: Role) -> None:
    assert through({**CAMERA, **wrong}, role) is None


@pytest.mark.parametrize("missing", [field for field in CAMERA if field != "type"])
def test_a_camera_without_a_field_is_dropped(missing: str) -> None:
    assert through({k: v for k, v in CAMERA.items() if k != missing}, Role.VIEWER) is None


CLICK = {
    "type": "SceneNodeClickMessage",
    "name": "/w/r/ball-1/x",
    "ray_origin": [0.0, 0.0, 1.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "instance_index": None,
    "screen_pos": [0.5, 0.5],
    "modifier": None,
    "owner": "",
}


def test_a_click_on_a_sphere_passes_for_an_operator() -> None:
    assert through(CLICK, Role.OPERATOR) == CLICK
    assert through(CLICK, Role.VIEWER) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": "/w/r/ball-1"},
        {"name": "/w/r/ball-1/x\n"},
        {"name": "x/w/r/ball-1/x"},
        {"ray_origin": [math.nan, 0.0, 0.0]},
        {"ray_direction": [0.0]},
        {"screen_pos": ["x", "y"]},
        {"instance_index": 0.5},
        {"modifier": "hyper"},
        {"owner": "x" * 100},
        {"more": 1},
    ],
)
def test_a_click_with_one_wrong_field_is_dropped(wrong: dict[str, Any]) -> None:
    assert through({**CLICK, **wrong}, Role.OPERATOR) is None


@given(st.sampled_from(["ViewerCameraMessage", "SceneNodeClickMessage"]), values)
def test_a_type_that_is_said_twice_is_judged_as_viser_reads_it(first: str, value: Any) -> None:
    """With two `type` keys in one map, a check of the first one would be bypassed."""
    packed = msgspec.msgpack.encode
    for kinds in ((first, "ShareUrlRequest"), ("ShareUrlRequest", first)):
        body = b"".join(packed("type") + packed(kind) for kind in kinds)
        frame = b"\x83" + body + packed("updates") + packed({"value": value})
        result = filter_message(frame, Role.OPERATOR)
        if result is not None:
            read = msgspec.msgpack.decode(result)
            assert read["type"] == first
            assert result.count(b"type") == 1


@pytest.mark.parametrize("role", ROLES)
@given(st.binary(max_size=300))
def test_whatever_is_sent_passes_is_dropped_or_is_an_error_of_theirs(
    role: Role, frame: bytes
) -> None:
    try:
        result = filter_message(frame, role)
    except MessageError:
        return
    assert result is None or msgspec.msgpack.decode(result)["type"] == CAMERA["type"]


def test_deep_and_large_frames_are_errors_of_theirs() -> None:
    for frame in (b"\x91" * 10_000, b"\x81\xa4type" * 3000, bytes(MAX_MESSAGE_BYTES + 1)):
        with pytest.raises(MessageError):
            filter_message(frame, Role.OPERATOR)
