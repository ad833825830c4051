"""Camera messages, against rosbags."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages import ros_types
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pictures import (
    IMAGE_TYPE,
    INFO_TYPE,
    CameraInfo,
    CameraName,
    CompressedImage,
    GroundGrid,
    decode_clock,
    decode_ground,
    decode_picture,
    encode_camera_info,
    encode_clock,
    encode_ground,
    encode_picture,
)

PLACE = st.tuples(st.floats(-10, 11), st.floats(-10, 11))


@given(st.binary(max_size=50), st.integers(0, 2**60), st.text("abc", max_size=9))
def test_pictures_are_encoded_as_rosbags_does(data, stamp_ns, frame):
    message = CompressedImage(frame, b"\xff\xd8" + data, stamp_ns)
    payload = encode_picture(message)
    assert ros_types.encode_cdr(ros_types.decode_cdr(payload, IMAGE_TYPE)) == payload
    assert decode_picture(payload) == message


def test_camera_info_is_encoded_as_rosbags_does():
    info = CameraInfo("ceiling", 1280, 720, np.arange(9.0).reshape(3, 3), np.arange(5.0), 7)
    payload = encode_camera_info(info)
    decoded = ros_types.decode_cdr(payload, INFO_TYPE)
    assert ros_types.encode_cdr(decoded) == payload
    assert decoded.k.tolist() == info.matrix.ravel().tolist()


@pytest.mark.parametrize("data", [b"GIF89a", b""])
def test_what_is_not_jpeg_is_refused(data):
    with pytest.raises(MessageError):
        decode_picture(encode_picture(CompressedImage("a", data, 0)))


@pytest.mark.parametrize("robot", [None, "tsd"])
def test_a_camera_is_found_from_each_of_its_keys(robot):
    name = CameraName("front", robot)
    assert all(
        CameraName.of(key) == name
        for key in (name.key, name.info_key, name.ground_key, name.alive_key, name.clock_key)
    )
    assert CameraName.of("twin/tsd/state/odom") is None


@given(st.integers(0, 2**63 - 1), st.binary())
def test_a_clock_is_decoded_as_it_was_encoded(time_ns, data):
    assert decode_clock(encode_clock(time_ns)) == time_ns
    if not data.strip().isdigit():
        with pytest.raises(MessageError):
            decode_clock(data)


@given(
    st.integers(2, 33).flatmap(
        lambda n: st.lists(st.lists(PLACE, min_size=n, max_size=n), min_size=2, max_size=5)
    )
)
def test_a_grid_of_the_floor_is_decoded_as_it_was_encoded(places):
    grid = GroundGrid((-1.0, 2.0), (3.0, 0.5), places)
    assert decode_ground(encode_ground(grid)) == grid


SQUARE = [[(0.0, 0.0), (1.0, 0.0)], [(0.0, 1.0), (1.0, 1.0)]]


@pytest.mark.parametrize(
    "grid",
    [
        GroundGrid((0.0, 0.0), (0.0, 1.0), SQUARE),
        GroundGrid((0.0, 0.0), (1.0, 1e9), SQUARE),
        GroundGrid((0.0, 1e9), (1.0, 1.0), SQUARE),
        GroundGrid((0.0, 0.0), (1.0, 1.0), SQUARE[:1]),
        GroundGrid((0.0, 0.0), (1.0, 1.0), [SQUARE[0], SQUARE[1][:1]]),
        GroundGrid((0.0, 0.0), (1.0, 1.0), [SQUARE[0] * 40] * 2),
        GroundGrid((0.0, 0.0), (1.0, 1.0), [[(0.0, 1e6)] * 2] * 2),
    ],
)
def test_an_impossible_grid_of_the_floor_is_refused(grid):
    with pytest.raises(MessageError):
        decode_ground(encode_ground(grid))


@given(st.binary(max_size=30))
def test_what_is_no_grid_of_the_floor_is_refused(payload):
    with pytest.raises(MessageError):
        decode_ground(payload)
