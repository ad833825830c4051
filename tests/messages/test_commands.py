"""Decoding of command samples, and the drop counter of invalid ones."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.lie import Array
from tsd_twin.messages.cdr import TwistStamped, encode_twist
from tsd_twin.messages.commands import decode_command, encode_attachment
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import Sample

KEY = "twin/tsd/cmd/alice/twist"
LEASE = bytes(range(16))
ATTACHMENT = encode_attachment(3, LEASE, 9)
uint64 = st.integers(0, 2**64 - 1)


def payload(twist: Array | None = None, frame: str = "base_link") -> bytes:
    return encode_twist(TwistStamped(frame, np.arange(6.0) if twist is None else twist))


def reason(sample: Sample) -> str:
    with pytest.raises(MessageError) as caught:
        decode_command(sample)
    return caught.value.reason


@given(seq=uint64, lease=st.binary(min_size=16, max_size=16), status_seq=uint64)
def test_an_attachment_is_number_lease_and_status_in_32_little_endian_bytes(
    seq: int, lease: bytes, status_seq: int
) -> None:
    attachment = encode_attachment(seq, lease, status_seq)
    assert len(attachment) == 32
    assert attachment == struct.pack("<Q", seq) + lease + struct.pack("<Q", status_seq)
    command = decode_command(Sample(KEY, payload(), attachment))
    assert (command.seq, command.lease, command.status_seq) == (seq, lease, status_seq)


@pytest.mark.parametrize("frame", ["base_link", "odom"])
def test_a_command_says_who_sent_it_and_in_which_frame(frame: str) -> None:
    command = decode_command(Sample(KEY, payload(frame=frame), ATTACHMENT))
    assert (command.operator, command.frame) == ("alice", frame)
    np.testing.assert_array_equal(command.twist, np.arange(6.0))


@pytest.mark.parametrize(
    "key",
    [
        "twin/tsd/cmd/*/twist",
        "twin/*/cmd/alice/twist",
        "twin/tsd/cmd/a*/twist",
        "twin/tsd/cmd/**",
        "twin/tsd/cmd/alice/twist/more",
        "twin/tsd/cmd/twist",
        "",
    ],
)
def test_a_key_that_is_not_that_of_one_operator_is_a_key_error(key: str) -> None:
    assert reason(Sample(key, payload(), ATTACHMENT)) == "key"


def test_a_deletion_is_a_key_error() -> None:
    assert reason(Sample(KEY, b"", b"", is_put=False)) == "key"


@pytest.mark.parametrize("size", [0, 1, 16, 31, 33, 64])
def test_an_attachment_of_another_size_is_a_shape_error(size: int) -> None:
    assert reason(Sample(KEY, payload(), bytes(size))) == "shape"


@pytest.mark.parametrize("frame", ["", "map", "base_link\n", "BASE_LINK"])
def test_another_frame_is_a_shape_error(frame: str) -> None:
    assert reason(Sample(KEY, payload(frame=frame), ATTACHMENT)) == "shape"


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("component", range(6))
def test_any_number_that_is_not_finite_is_a_nonfinite_error(component: int, number: float) -> None:
    twist = np.zeros(6)
    twist[component] = number
    assert reason(Sample(KEY, payload(twist), ATTACHMENT)) == "nonfinite"


@given(
    key=st.just(KEY) | st.text(max_size=40),
    body=st.binary(max_size=120) | st.just(payload()),
    attachment=st.binary(max_size=40) | st.just(ATTACHMENT),
    is_put=st.booleans(),
)
def test_a_sample_is_a_finite_command_or_has_one_of_three_reasons(
    key: str, body: bytes, attachment: bytes, is_put: bool
) -> None:
    try:
        command = decode_command(Sample(key, body, attachment, is_put))
    except MessageError as error:
        assert error.reason in ("key", "shape", "nonfinite")  # noqa: PT017  Either is right.
    else:
        assert np.isfinite(command.twist).all()
        assert command.twist.shape == (6,)


@given(
    twists=st.lists(st.sampled_from([0.0, -0.0, 0.1, 0.2]), min_size=2, max_size=6),
    frame=st.sampled_from(["base_link", "odom"]),
)
def test_commands_that_come_again_are_the_same_to_the_bit(twists: list[float], frame: str) -> None:
    for vx in [*twists, *twists]:
        twist = np.array([vx, 0.0, 0.0, 0.0, 0.0, -vx])
        command = decode_command(Sample(KEY, payload(twist, frame), ATTACHMENT))
        assert command.twist.tobytes() == twist.tobytes()
        assert command.frame == frame
        with pytest.raises(ValueError, match="read-only"):
            command.twist[0] = 1.0
