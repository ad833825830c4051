"""The status as plain JSON, and the stamp on all messages of a robot."""

from __future__ import annotations

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.status import (
    ArmingStatus,
    BiasStatus,
    CommandStatus,
    ConsistencyStatus,
    DropCounts,
    LeaseStatus,
    LimitStatus,
    LoopStatus,
    Refusals,
    RobotStatus,
    decode_stamp,
    decode_status,
    encode_stamp,
    encode_status,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
counts = st.integers(0, 2**62)
texts = st.text(max_size=20)
params = st.dictionaries(texts, texts | finite, max_size=3)
reasons = st.builds(Reason, texts, params, st.none() | st.builds(Reason, texts, params))
refused = st.dictionaries(st.sampled_from(["arm", "drive", "no_lease"]), reasons)
statuses = st.builds(
    RobotStatus,
    mode=texts,
    stop_reason=texts,
    stop=reasons,
    arming=st.none() | st.builds(ArmingStatus, texts, finite),
    lease=st.builds(LeaseStatus, st.none() | texts, finite),
    refusals=st.none() | refused.map(Refusals.of),
    command=st.builds(
        CommandStatus,
        seq=counts,
        age_s=st.none() | finite,
        accepted=counts,
        dropped=st.builds(DropCounts, *[counts] * 6),
    ),
    limits=st.builds(LimitStatus, *[finite] * 4, why=st.tuples(reasons)),
    consistency=st.builds(
        ConsistencyStatus,
        finite,
        st.none() | texts,
        finite,
        st.dictionaries(texts, finite, max_size=4),
    ),
    learned=st.none() | st.dictionaries(texts, st.builds(BiasStatus, finite, finite), max_size=4),
    loop=st.builds(LoopStatus, finite, counts, finite),
    hardware=st.dictionaries(texts, st.none() | texts | finite | st.lists(finite), max_size=4),
)


@given(status=statuses)
def test_a_status_survives_the_bus(status: RobotStatus) -> None:
    assert decode_status(encode_status(status)) == status


def test_a_status_has_the_fields_that_others_rely_on() -> None:
    plain = json.loads(encode_status(RobotStatus("ready")))
    assert plain["mode"] == "ready"
    assert plain["stop_reason"] == ""
    assert plain["stops"] == 0
    assert plain["lease"] == {
        "holder": None,
        "remaining_s": 0.0,
        "requested_by": None,
        "request_expires_in_s": 0.0,
        "reserved_for": None,
        "reservation_expires_in_s": 0.0,
    }
    reasons = ("stale", "lease", "order", "nonfinite", "key", "shape")
    assert plain["command"] == {
        "seq": 0,
        "age_s": None,
        "echo_s": None,
        "accepted": 0,
        "dropped": dict.fromkeys(reasons, 0),
    }
    assert plain["consistency"] == {
        "residual_mps": 0.0,
        "suspect": None,
        "level": 0.0,
        "contributions": {},
    }
    assert plain["loop"] == {
        "hz": 0.0,
        "overruns": 0,
        "jitter_p99_ms": 0.0,
        "longest_ms": 0.0,
    }
    assert set(plain) >= {"limits", "hardware"}


def test_fields_of_a_later_version_are_ignored() -> None:
    plain = json.loads(encode_status(RobotStatus("ready"))) | {"new": {"a": 1}}
    assert decode_status(json.dumps(plain).encode()) == RobotStatus("ready")


def test_a_status_says_why_each_request_is_refused() -> None:
    why = because(Code.WRONG_MODE, mode="ready")
    status = RobotStatus("ready", refusals=Refusals.of({"arm": why, "disarm": None}))
    plain = json.loads(encode_status(status))
    assert plain["refusals"] == {
        "lease": None,
        "no_lease": "",
        "arm": sentence(why),
        "disarm": None,
        "reset": None,
        "drive": None,
        "set_pose": None,
        "speed": None,
        "why": {"arm": {"code": "wrong_mode", "params": {"mode": "ready"}}},
    }


def test_texts_of_a_robot_without_codes_are_reasons() -> None:
    old = RobotStatus(
        "fault",
        stop_reason="it broke",
        refusals=Refusals(no_lease="take control", arm="it broke"),
        limits=LimitStatus(reason="it is hot"),
    )
    status = decode_status(encode_status(old))
    broke = Reason("text", {"text": "it broke"})
    assert status.stop == broke
    assert status.refusals is not None
    assert status.refusals.why == {
        "no_lease": Reason("text", {"text": "take control"}),
        "arm": broke,
    }
    assert status.limits.why == (Reason("text", {"text": "it is hot"}),)


def test_the_refusals_of_a_robot_that_sends_none_are_unknown() -> None:
    plain = json.loads(encode_status(RobotStatus("disarmed")))
    del plain["refusals"]
    status = decode_status(json.dumps(plain).encode())
    assert status.refusals is None
    assert status.why_no_drive == because(Code.MODE_ONLY, mode="disarmed")


@pytest.mark.parametrize("payload", [b"", b"[]", b"{}", b'{"mode": 1}', b'{"mode": "\xff"}'])
def test_what_is_no_status_is_a_shape_error(payload: bytes) -> None:
    with pytest.raises(MessageError, match="not a status") as caught:
        decode_status(payload)
    assert caught.value.reason == "shape"


@given(seq=st.integers(0, 2**64 - 1), robot_ns=st.integers(-(2**63), 2**63 - 1))
def test_a_stamp_is_number_and_time_in_16_little_endian_bytes(seq: int, robot_ns: int) -> None:
    stamp = encode_stamp(seq, robot_ns)
    assert stamp == struct.pack("<Qq", seq, robot_ns)
    assert decode_stamp(stamp) == (seq, robot_ns)


@given(stamp=st.binary(max_size=40).filter(lambda stamp: len(stamp) != 16))
def test_a_stamp_of_another_size_is_a_shape_error(stamp: bytes) -> None:
    with pytest.raises(MessageError, match="stamp") as caught:
        decode_stamp(stamp)
    assert caught.value.reason == "shape"


@pytest.mark.parametrize("opening", [b"[", b'{"a":'])
@pytest.mark.parametrize("levels", [9, 500, 50_000])
def test_a_status_that_is_nested_too_deeply_is_none(opening: bytes, levels: int) -> None:
    """A status that decodes but cannot be encoded again would close the socket of every page."""
    closing = b"]" if opening == b"[" else b"}"
    inner = opening * levels + b"0" + closing * levels
    with pytest.raises(MessageError, match="shape"):
        decode_status(b'{"mode": "ready", "hardware": {"a": ' + inner + b"}}")


def test_a_status_may_have_lists_of_tables_below_hardware() -> None:
    hardware = {"a": [{"b": {"c": [1.0, [2.0, {"d": None}]]}}]}
    assert (
        decode_status(encode_status(RobotStatus("ready", hardware=hardware))).hardware == hardware
    )


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('{"mode":"ready","lease":{"asked_by":"bob","asks_for_s":3.0}}', ("bob", 3.0)),
        (
            '{"mode":"ready","lease":{"requested_by":"bob","request_expires_in_s":3.0}}',
            ("bob", 3.0),
        ),
    ],
)
def test_a_status_with_old_keys_is_read(old: str, new: tuple[str, float]) -> None:
    lease = decode_status(old.encode()).lease
    assert (lease.requested_by, lease.request_expires_in_s) == new


def test_old_keys_are_not_replaced_inside_of_texts() -> None:
    text = '"asked_by": said the note'
    status = RobotStatus(mode="ready", stop_reason=text)
    assert decode_status(encode_status(status)).stop_reason == text
