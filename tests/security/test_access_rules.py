"""The access rules with Zenoh's semantics: a key must be entirely within an allowed one."""

from __future__ import annotations

import json
from typing import Any

import pytest
import zenoh

from tsd_twin.messages import topics
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.topics import Service
from tsd_twin.security import Role, access_control, client

ALICE, BOB, GUEST, CAMERA, TAPE = (
    client("alice", Role.OPERATOR),
    client("bob", Role.OPERATOR),
    client("guest", Role.VIEWER),
    client("camera", Role.SENSOR),
    client("tape", Role.RECORDER),
)
RULES = access_control([ALICE, BOB, GUEST, CAMERA, TAPE])
NAMES = ("alice", "bob", "guest", "camera", "tape")
MESSAGES = (
    "put",
    "delete",
    "declare_subscriber",
    "declare_queryable",
    "query",
    "reply",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

STATES = [topic.key("tsd") for topic in topics.TOPICS if topic.path.startswith("state/")]
EVENTS = [topics.event_key("tsd", kind) for kind in ("mode", "refusal")]
HISTORY = [f"{key}/@adv/pub/1f2e/7/uhlc/_" for key in EVENTS]
HOLDERS = [service.key("tsd") for service in Service if service.startswith("srv/")]
OPEN = [Service.DESC.key("tsd"), Service.STOP.key("tsd")]
COMMANDS = [topics.twist_key("tsd", name) for name in (*NAMES, "alice-0123abcd", "nobody")]
OTHERS = ["twin/tsd/other", "twin/tsd/cmd/alice", "other/tsd/state/odom", "@/1f2e/router", "**"]
INSIDE = topics.SENSOR_POSE.key("tsd")
LOG = topics.INPUTS.key("tsd")
"""Contains lease ids."""
ON_RECORD = [*COMMANDS, INSIDE, LOG, Service.STOP.key("tsd")]
ALIVE = topics.alive_key("tsd")
FRONT, CEILING = CameraName("front", "tsd"), CameraName("ceiling")
PICTURES = [FRONT.key, FRONT.info_key, FRONT.alive_key, FRONT.clock_key]
FLOOR = [CEILING.key, CEILING.info_key, CEILING.alive_key, CEILING.clock_key]
KEYS = [*STATES, *EVENTS, *HISTORY, *HOLDERS, *OPEN, *COMMANDS, *OTHERS, INSIDE, LOG, ALIVE]
KEYS += PICTURES
SEEN = [*PICTURES, *FLOOR]


def may(name: str, flow: str, message: str, key: str, rules: dict[str, Any] = RULES) -> bool:
    """Return whether a message passes, by an independent reading of the rules."""
    mine = {s["id"] for s in rules["subjects"] if name in s["cert_common_names"]}
    ids = {i for p in rules["policies"] if mine & {*p["subjects"]} for i in p["rules"]}
    return any(
        rule["permission"] == "allow"
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(
            zenoh.KeyExpr(allowed).includes(zenoh.KeyExpr(key)) for allowed in rule["key_exprs"]
        )
        for rule in rules["rules"]
        if rule["id"] in ids
    )


def passing(name: str, flow: str, message: str) -> set[str]:
    return {key for key in [*KEYS, *FLOOR] if may(name, flow, message, key)}


@pytest.mark.parametrize("name", NAMES)
def test_what_somebody_may_say_is_this_and_nothing_else(name: str) -> None:
    operator = name in ("alice", "bob")
    shown = {*SEEN} if name == "camera" else set[str]()
    own = {"alice": {COMMANDS[0], COMMANDS[-2]}, "bob": {COMMANDS[1]}, "camera": {INSIDE, *SEEN}}
    allowed = {
        "put": {Service.STOP.key("tsd"), *own.get(name, ())},
        "query": {*OPEN, *HISTORY, *SEEN, *(HOLDERS if operator else ())},
        "declare_subscriber": {
            *STATES,
            *EVENTS,
            *SEEN,
            *([INSIDE] if operator else ()),
            *(ON_RECORD if name == "tape" else ()),
        },
        "liveliness_query": {topics.alive_key("tsd"), *HISTORY, *SEEN},
        "declare_liveliness_subscriber": {topics.alive_key("tsd"), *HISTORY, *SEEN},
        "liveliness_token": shown,
        "declare_queryable": shown,
        "reply": shown,
    }
    assert {message: passing(name, "ingress", message) for message in MESSAGES} == {
        message: allowed.get(message, set()) for message in MESSAGES
    }


@pytest.mark.parametrize("name", NAMES)
def test_what_somebody_is_told_is_this_and_nothing_else(name: str) -> None:
    holders = HOLDERS if name in ("alice", "bob") else []
    inside = [INSIDE, *SEEN] if name == "camera" else []
    allowed = {
        "put": {
            *STATES,
            *EVENTS,
            *SEEN,
            *([INSIDE] if holders else ()),
            *(ON_RECORD if name == "tape" else ()),
        },
        "reply": {*OPEN, *EVENTS, *SEEN, *holders},
        "declare_queryable": {*OPEN, *HISTORY, *SEEN, *holders},
        "query": {*(SEEN if name == "camera" else ())},
        "declare_subscriber": {
            Service.STOP.key("tsd"),
            *(COMMANDS if holders else ()),
            *inside,
        },
        "liveliness_token": {topics.alive_key("tsd"), *HISTORY, *SEEN},
    }
    assert {message: passing(name, "egress", message) for message in MESSAGES} == {
        message: allowed.get(message, set()) for message in MESSAGES
    }


def test_every_topic_and_service_of_the_table_is_among_those_that_were_asked_about() -> None:
    asked = {zenoh.KeyExpr(key) for key in KEYS}
    for row in (*topics.TOPICS, *Service):
        assert any(zenoh.KeyExpr(row.key("tsd")).intersects(key) for key in asked), row


@pytest.mark.parametrize(
    "key", ["twin/*/state/odom", "twin/*/state/**", "twin/tsd/state/*", "twin/*/event/*"]
)
def test_who_sees_may_look_at_all_robots_and_all_states_at_once(key: str) -> None:
    assert may("guest", "ingress", "declare_subscriber", key)


@pytest.mark.parametrize("key", ["twin/**", "twin/tsd/**", "**", "twin/*/*/*", "twin/tsd/cmd/**"])
def test_nobody_may_look_at_more(key: str) -> None:
    assert not may("alice", "ingress", "declare_subscriber", key)


@pytest.mark.parametrize("name", ["robot", "nobody", "", "alice-0123abcd"])
def test_who_is_not_listed_may_nothing(name: str) -> None:
    assert not any(
        may(name, flow, message, key)
        for flow in ("ingress", "egress")
        for message in MESSAGES
        for key in KEYS
    )


@pytest.mark.parametrize(
    "identities",
    [[], [GUEST], [ALICE], [CAMERA], [ALICE, GUEST], [TAPE], [ALICE, BOB, GUEST, CAMERA, TAPE]],
)
def test_zenoh_takes_the_rules_for_any_company(identities: list[Any]) -> None:
    rules = access_control(identities)
    settings = {
        "mode": "router",
        "listen": {"endpoints": []},
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "access_control": rules,
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))):
        assert rules["enabled"]
        assert rules["default_permission"] == "deny"
    assert {rule["permission"] for rule in rules["rules"]} == {"allow"}
