"""Requests: missing fields are named, and invalid requests are only refused."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import (
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    SetPoseRequest,
    StopRequest,
    decode_request,
)

LEASE = "0123456789abcdef" * 2
KINDS = (LeaseRequest, HolderRequest, SetPoseRequest, StopRequest)
COMPLETE: dict[type[msgspec.Struct], dict[str, Any]] = {
    LeaseRequest: {"op": "acquire", "operator": "alice"},
    HolderRequest: {"lease": LEASE},
    SetPoseRequest: {"lease": LEASE, "x_m": 1.0, "y_m": 2, "heading_rad": -0.5},
    StopRequest: {},
}
MISSING = [(kind, field) for kind, fields in COMPLETE.items() for field in fields]


def encoded(fields: dict[str, Any]) -> bytes:
    return json.dumps(fields).encode()


@pytest.mark.parametrize(("kind", "fields"), COMPLETE.items())
def test_what_is_there_is_read(kind: type[msgspec.Struct], fields: dict[str, Any]) -> None:
    request = decode_request(encoded(fields | {"unknown": [1, {}]}), kind)
    for name, value in fields.items():
        assert getattr(request, name) == value


@pytest.mark.parametrize(("kind", "field"), MISSING)
def test_a_missing_field_is_named(kind: type[msgspec.Struct], field: str) -> None:
    fields = {name: value for name, value in COMPLETE[kind].items() if name != field}
    with pytest.raises(MessageError, match=f"missing required field `{field}`") as caught:
        decode_request(encoded(fields), kind)
    assert caught.value.reason == "shape"


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (LeaseRequest, "op", "steal"),
        (LeaseRequest, "operator", 5),
        (LeaseRequest, "operator", ""),
        (LeaseRequest, "operator", "Alice"),
        (LeaseRequest, "operator", "a/b"),
        (LeaseRequest, "operator", "*"),
        (LeaseRequest, "operator", "a" * 33),
        (LeaseRequest, "operator", "alice\n"),
        (LeaseRequest, "lease", LEASE + "\n"),
        (LeaseRequest, "lease", LEASE.upper()),
        (LeaseRequest, "take_over", "yes"),
        (LeaseRequest, "max_age_s", 0.0),
        (LeaseRequest, "max_age_s", -1.0),
        (LeaseRequest, "max_age_s", "1"),
        (HolderRequest, "lease", LEASE + "\n"),
        (HolderRequest, "lease", LEASE[1:]),
        (HolderRequest, "lease", None),
        (SetPoseRequest, "x_m", None),
        (SetPoseRequest, "y_m", "1"),
        (SetPoseRequest, "heading_rad", []),
        (StopRequest, "reason", 3),
        (StopRequest, "reason", "x" * 201),
    ],
)
def test_a_wrong_value_is_refused_with_the_name_of_its_field(
    kind: type[msgspec.Struct], field: str, value: Any
) -> None:
    with pytest.raises(MessageError, match=field) as caught:
        decode_request(encoded(COMPLETE[kind] | {field: value}), kind)
    assert caught.value.reason == "shape"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "payload",
    [
        b"[]",
        b'"text"',
        b"1",
        b"null",
        b"{",
        b"\xff\xfe",
        b'{"operator": "\xff", "lease": "\xff", "reason": "\xff", "op": "\xff", "x_m": "\xff"}',
        b"[" * 4096,
        b'{"a":' * 800,
        b'{"a":' + b"[" * 3000 + b"]" * 3000 + b"}",
        b"{} {}",
    ],
)
def test_what_is_no_json_object_is_refused(kind: type[msgspec.Struct], payload: bytes) -> None:
    with pytest.raises(MessageError, match="not a request") as caught:
        decode_request(payload, kind)
    assert caught.value.reason == "shape"


numbers_out_of_range = st.sampled_from([b"1e999", b"-1e999", b"9" * 400, b"NaN", b"Infinity"])


@given(number=numbers_out_of_range, field=st.sampled_from(["x_m", "y_m", "heading_rad"]))
def test_a_number_that_no_float_can_hold_is_refused(number: bytes, field: str) -> None:
    fields = encoded(COMPLETE[SetPoseRequest] | {field: "here"})
    with pytest.raises(MessageError, match="shape"):
        decode_request(fields.replace(b'"here"', number), SetPoseRequest)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=10,
)
fields_of_all = sorted({name for kind in KINDS for name in kind.__struct_fields__})
requests = st.dictionaries(st.sampled_from(fields_of_all), json_values | st.just(LEASE)).map(
    encoded
)


@given(payload=st.binary(max_size=60) | json_values.map(encoded) | requests)
def test_any_payload_is_a_request_or_a_shape_error(payload: bytes) -> None:
    for kind in KINDS:
        try:
            assert isinstance(decode_request(payload, kind), kind)
        except MessageError as error:
            assert error.reason == "shape"  # noqa: PT017  Most are refused, some are requests.


def test_a_stop_needs_nothing_at_all() -> None:
    assert decode_request(b"", StopRequest) == StopRequest()
    assert decode_request(b"{}", StopRequest) == StopRequest("", "")


def test_answers_have_the_fields_that_others_rely_on() -> None:
    granted = msgspec.to_builtins(LeaseReply(True, LEASE, "alice", 2.0))
    assert (
        granted.items()
        >= {
            "granted": True,
            "lease": LEASE,
            "holder": "alice",
            "ttl_s": 2.0,
            "reason": "",
        }.items()
    )
    refused = msgspec.to_builtins(Reply.refused(because(Code.HELD_BY, holder="bob")))
    assert refused == {
        "ok": False,
        "reason": sentence(because(Code.HELD_BY, holder="bob")),
        "why": {"code": "held_by", "params": {"holder": "bob"}},
    }
