"""Wire format of rmw_zenoh: values from its documentation, and a third-party implementation."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk.attachment import Attachment as ForeignAttachment
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

from tests.support.ros_nodes import definitions
from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.port import types_of
from tsd_twin.adapters.ros.zenoh_port import (
    QOS,
    Kind,
    RosNode,
    decode_attachment,
    encode_attachment,
    gid_of,
    topic_key,
)
from tsd_twin.adapters.ros_topics import PUBLISHED, READ, RosQoS
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.ros_types import TRIGGER, encode_trigger_response, type_hash

STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ZID = "aac3178e146ba6f1fc6e6a4085e77f21"


def test_tokens_are_those_in_the_design_document_of_rmw_zenoh() -> None:
    node = RosNode(2, ZID, "listener")
    assert node.token() == f"@ros2_lv/2/{ZID}/0/0/NN/%/%/listener"
    token = node.endpoint_token(
        10, Kind.SUBSCRIPTION, "/chatter", STRING, type_hash(STRING), QOS[RosQoS.STATE]
    )
    assert token == (
        f"@ros2_lv/2/{ZID}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/"
        f"{STRING_HASH}/::,10:,:,:,,"
    )


def test_a_namespace_and_inner_slashes_become_percent_signs() -> None:
    node = RosNode(0, "1a", "tsd_ros", "/left")
    key = node.endpoint_token(3, Kind.PUBLISHER, "/left/odom/truth", STRING, "RIHS01_0", "q")
    assert key == (
        "@ros2_lv/0/1a/0/3/MP/%/%left/tsd_ros/%left%odom%truth/std_msgs::msg::dds_::String_/"
        "RIHS01_0/q"
    )


def test_keys_are_those_in_the_design_document() -> None:
    key = topic_key(2, "/chatter", STRING, type_hash(STRING))
    assert key == f"2/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    key = topic_key(0, "/left/arm", TRIGGER, "RIHS01_0")
    assert key == "0/left/arm/std_srvs::srv::dds_::Trigger_/RIHS01_0"


def test_the_hash_of_the_service_is_that_of_ros() -> None:
    """Hashes from `share/std_srvs/srv/Trigger.json` of ROS 2 Jazzy."""
    assert type_hash(TRIGGER) == (
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    )
    assert type_hash(f"{TRIGGER}_Response") == (
        "RIHS01_2d946c21e2fc3f1e9ca6986a8191d85fcc70097a8bb7771a053564bc47009cdf"
    )


@pytest.mark.parametrize(
    "type_name",
    sorted({row.type for row in PUBLISHED} | {t for row in READ for t in types_of(row)}),
)
def test_the_hash_of_each_message_is_that_of_another_implementation(type_name: str) -> None:
    own, others = definitions(type_name)
    assert type_hash(type_name) == compute_type_hash_from_msg(type_name, own, others)


def test_qualities_of_service_are_read_by_another_implementation_as_the_table_says() -> None:
    for row in {*PUBLISHED, *READ}:
        profile = QosProfile.decode(QOS[row.qos])
        wanted = "best effort" if profile.reliability is QosReliability.BEST_EFFORT else "reliable"
        kept = profile.durability is QosDurability.TRANSIENT_LOCAL
        durability = "transient local" if kept else "volatile"
        assert row.qos == f"{wanted}, {durability}, depth {profile.history_depth}"
        assert re.fullmatch(r"2?:1?:,\d+:,:,:,,", QOS[row.qos])


def test_the_id_of_an_endpoint_is_xxh3_of_its_token_lower_half_first() -> None:
    # XXH3-128 of no bytes is 99aa06d3014798d8 6001c324468d497f.
    assert gid_of("").hex() == "7f498d4624c30160d8984701d306aa99"


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_attachments_are_those_of_another_implementation(
    sequence: int, source_ns: int, gid: bytes
) -> None:
    mine = Origin(gid, sequence, source_ns)
    data = encode_attachment(mine)
    assert len(data) == 33
    assert data == ForeignAttachment(sequence, source_ns, gid).to_bytes()
    assert decode_attachment(data) == mine


@given(st.binary(max_size=60))
def test_other_bytes_are_no_attachment(data: bytes) -> None:
    if len(data) != 33 or data[16] != 16:
        with pytest.raises(MessageError, match="rmw_zenoh"):
            decode_attachment(data)


@given(st.booleans(), st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\0")))
def test_a_response_has_a_flag_and_a_text(success: bool, text: str) -> None:
    """As CDR lays them out: header, flag, padding, length with the final zero, text."""
    data = encode_trigger_response(success, text)
    body = text.encode() + b"\0"
    assert data[:5] == bytes([0, 1, 0, 0, success])
    assert data[8:12] == len(body).to_bytes(4, "little")
    assert data[12:] == body


def test_rosbags_has_the_types_of_all_topics() -> None:
    types = get_typestore(Stores.ROS2_JAZZY).types
    assert {row.type for row in PUBLISHED} <= set(types)
