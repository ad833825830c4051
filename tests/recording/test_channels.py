"""Every bus message is recorded byte by byte, and readers meet only decodable messages."""

from __future__ import annotations

import base64
import json

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tsd_twin.control.logged_controller import InputBatch, ServeCall, StopCall, encode_batch
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, JointState, TwistStamped, encode_joints, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.status import encode_stamp
from tsd_twin.messages.topics import Sample
from tsd_twin.recording.channels import RAW, Entry, EntryMaker, RawMessage
from tsd_twin.recording.export import Redactor

STORE = get_typestore(Stores.ROS2_JAZZY)
TWIST = encode_twist(TwistStamped(BASE, np.arange(6.0)))
JOINTS = encode_joints(JointState(("a", "b"), np.zeros(2), np.ones(2)))
POSE = encode_pose(PoseStamped("odom", np.zeros(3), np.array([1.0, 0, 0, 0]), 5))
LEASE = bytes(range(16))

keys = st.sampled_from(
    [topic.key("tsd").replace("*", "alice") for topic in topics.TOPICS]
    + ["twin/*/stop", "twin/tsd/cmd/*/twist", "twin/tsd/other", "twin/tsd/state/new"]
)
payloads = st.binary(max_size=60) | st.sampled_from([TWIST, JOINTS, POSE, b"{}", b"\xff", b"[1"])
attachments = st.binary(max_size=40) | st.sampled_from(
    [b"", encode_stamp(7, 9), encode_stamp(1 << 40, 9), encode_stamp(7, -9)]
)


def sample_of(entries: list[Entry]) -> Sample:
    """Rebuild a message from its entries in the file."""
    whole = [entry for entry in entries if not entry.topic.endswith(RAW)]
    raws = [entry for entry in entries if entry.topic.endswith(RAW)]
    assert len({entry.sequence for entry in entries}) == 1
    key = entries[0].topic.removesuffix(RAW)
    if not raws:
        (entry,) = whole
        stamped = key.split("/")[2] == "state" and entry.publish_ns != entry.log_ns
        attachment = encode_stamp(entry.sequence, entry.publish_ns) if stamped else b""
        return Sample(key, entry.data, attachment)
    (raw_entry,) = raws
    raw = msgspec.json.decode(raw_entry.data, type=RawMessage)
    payload = whole[0].data if whole else base64.b64decode(raw.payload or "")
    return Sample(key, payload, bytes.fromhex(raw.attachment), raw.put)


@given(key=keys, payload=payloads, attachment=attachments, put=st.booleans())
def test_each_message_can_be_had_again_to_the_byte(
    key: str, payload: bytes, attachment: bytes, *, put: bool
) -> None:
    sample = Sample(key, payload if put else b"", attachment, put)
    entries = [
        entry
        for entry in EntryMaker().of_sample(sample, 1 << 60)
        if not entry.topic.endswith("/requests")
    ]
    assert sample_of(entries) == sample


@given(key=keys, payload=payloads)
def test_what_a_client_may_have_put_is_only_in_the_file_if_it_can_be_read(
    key: str, payload: bytes
) -> None:
    for entry in EntryMaker().of_sample(Sample(key, payload, b""), 0):
        if entry.topic.endswith(RAW):
            msgspec.json.decode(entry.data, type=RawMessage)
        elif "/cmd/" in key or "/sensor/" in key:
            STORE.deserialize_cdr(entry.data, entry.type)
        elif key.endswith("/stop"):
            json.loads(entry.data)


def test_a_command_has_its_attachment_beside_it_under_the_same_number() -> None:
    maker = EntryMaker()
    attachment = encode_attachment(3, LEASE, 8)
    for number in (1, 2, 3):
        sample = Sample("twin/tsd/cmd/alice/twist", TWIST, attachment)
        command, raw = maker.of_sample(sample, 5)
        assert (command.type, command.encoding) == ("geometry_msgs/msg/TwistStamped", "cdr")
        assert command.data == TWIST
        assert command.sequence == raw.sequence == number
        assert raw.topic == "twin/tsd/cmd/alice/twist/raw"
        assert json.loads(raw.data) == {"attachment": attachment.hex()}


def test_requests_and_answers_can_be_read_without_our_code() -> None:
    calls = [
        ServeCall("srv/arm", b'{"lease": "x"}', 1.5, b'{"ok":false,"reason":"no"}'),
        ServeCall("srv/arm", b"\xff{", 1.6, b'{"ok":false}'),
        StopCall(b"", 1.7, b'{"ok":true}'),
    ]
    sample = Sample("twin/tsd/log/inputs", encode_batch(InputBatch(0, [*calls])), b"")
    batch, *requests = EntryMaker().of_sample(sample, 5)
    assert batch.encoding == "msgpack"
    assert {entry.topic for entry in requests} == {"twin/tsd/requests"}
    shown = [json.loads(entry.data) for entry in requests]
    assert [(each["service"], each["robot_s"]) for each in shown] == [
        ("srv/arm", 1.5), ("srv/arm", 1.6), ("stop", 1.7),
    ]  # fmt: skip
    assert shown[0]["request"] == {"lease": "x"}
    assert shown[0]["reply"] == {"ok": False, "reason": "no"}


@pytest.mark.parametrize(
    "sample",
    [
        Sample("twin/tsd/cmd/alice/twist", TWIST, encode_attachment(3, LEASE, 8)),
        Sample("twin/tsd/cmd/alice/twist", LEASE.hex().encode(), LEASE + LEASE[:3]),
        Sample("twin/tsd/stop", json.dumps({"lease": LEASE.hex()}).encode(), LEASE),
        Sample("twin/tsd/stop", b"{" + LEASE.hex().encode(), b""),
        Sample(
            "twin/tsd/log/inputs",
            encode_batch(
                InputBatch(
                    0,
                    [
                        ServeCall(
                            "srv/arm",
                            json.dumps({"lease": LEASE.hex()}).encode(),
                            1.0,
                            json.dumps({"lease": LEASE.hex()}).encode(),
                        )
                    ],
                )
            ),
            b"",
        ),
    ],
    ids=range(5),
)
def test_no_lease_id_is_left_after_redaction(sample: Sample) -> None:
    redactor = Redactor()
    for entry in EntryMaker().of_sample(sample, 5):
        data = redactor.entry(entry).data
        assert LEASE not in data
        assert LEASE.hex().encode() not in data
        assert base64.b64encode(LEASE.hex().encode())[:20] not in data
