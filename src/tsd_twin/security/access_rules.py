"""Identities and roles on the bus, a robot's access rules, and Zenoh settings with TLS, as data."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

from tsd_twin.errors import BusError, TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.topics import Service

LONGEST = 23
"""Maximum name length: operator ids have 32 characters, and dashboard pages append a dash and 8
digits.
"""
ROBOT = "robot"
ROUTER = "router"
AUTHORITY = "ca"


class Role(StrEnum):
    """Role of a bus identity, from its certificate."""

    ROBOT = "robot"
    ROUTER = "router"
    OPERATOR = "operator"
    """May observe, drive and stop."""
    VIEWER = "viewer"
    """May observe and stop."""
    SENSOR = "sensor"
    """May observe, stop and publish pictures and pose measurements, as a camera does."""
    RECORDER = "recorder"
    """May observe, stop and read all messages, including lease ids.

    It cannot use the ids, because it may neither send commands nor request control.
    """


@dataclass(frozen=True, slots=True)
class BusIdentity:
    """Owner of a certificate: common name and organizational unit."""

    name: str
    role: Role


def client(name: str, role: Role) -> BusIdentity:
    """Return the identity of an operator, viewer, sensor or recorder.

    Raises:
        TwinError: If the name is not valid in a key, is too long, or is reserved.
    """
    try:
        topics.checked(name)
    except BusError as error:
        raise TwinError(str(error)) from error
    if len(name) > LONGEST:
        raise TwinError(f"'{name}' is too long: pages add to it, so {LONGEST} characters are left")
    if name in (ROBOT, ROUTER, AUTHORITY):
        raise TwinError(f"'{name}' is not for people here: choose another")
    return BusIdentity(name, role)


def merged(known: Sequence[BusIdentity], new: Iterable[BusIdentity]) -> list[BusIdentity]:
    """Return all identities, without duplicates, sorted by name.

    Raises:
        TwinError: If names conflict.
    """
    roles = {person.name: person.role for person in known}
    for person in new:
        if roles.setdefault(person.name, person.role) is not person.role:
            raise TwinError(
                f"'{person.name}' is {_a(roles[person.name])} and cannot be {_a(person.role)} "
                "as well: choose another name"
            )
    for name in roles:
        for other in roles:
            # Operator alice may use all keys of alice-<page>.
            if other.startswith(f"{name}-"):
                raise TwinError(
                    f"'{other}' could be a page of '{name}': a name must not continue another "
                    "with a dash"
                )
    return [BusIdentity(name, roles[name]) for name in sorted(roles)]


def _a(role: Role) -> str:
    return f"an {role}" if role is Role.OPERATOR else f"a {role}"


_ANY = "twin/*"
_CLAIMS = (topics.TWIST, topics.SENSOR_POSE, topics.STOP)
"""Topics published by clients; robots publish all others."""
_SECRETS = (topics.INPUTS,)
"""Topics with lease ids, for recorders only."""
_BRANCHES = sorted({t.path.split("/")[0] for t in topics.TOPICS if t not in (*_CLAIMS, *_SECRETS)})

CAMERAS = (f"{_ANY}/camera/**",)
"""Pictures, tokens and clocks of cameras on robots."""
FLOOR = ("floor/**",)
"""Pictures, tokens and clocks of cameras above the floor, which show all robots."""
SHOWN = (*(f"{_ANY}/{branch}/**" for branch in _BRANCHES), *CAMERAS)
ALIVE = (topics.alive_key("*"), topics.instance_key("*", "*"), *CAMERAS)
HISTORY = (f"{topics.EVENT.key('*')}/@adv/**",)
"""Keys on which late joiners query past events; wildcards do not match chunks with @."""
OPEN = tuple(f"{_ANY}/{service}" for service in Service if not service.startswith("srv/"))
HOLDER = tuple(f"{_ANY}/{service}" for service in Service if service.startswith("srv/"))
STOP = (topics.STOP.key("*"),)
TWIST = (topics.TWIST.key("*"),)
SENSOR_POSE = (topics.SENSOR_POSE.key("*"),)
ON_RECORD = tuple(topic.key("*") for topic in (*_CLAIMS, *_SECRETS))
EVERYTHING = (f"{_ANY}/**", *FLOOR, *HISTORY)
TO_ROBOTS = (*TWIST, *SENSOR_POSE, *(f"{_ANY}/{service}" for service in Service), *HISTORY)
"""Keys on which a robot receives messages; cameras publish larger ones, which robots do not read.
"""


@dataclass(frozen=True, slots=True)
class Rule:
    """Access rule that allows messages on keys; everything else is denied."""

    id: str
    flow: Literal["ingress", "egress"]
    """Seen from the robot: ingress messages are received by it."""
    messages: tuple[str, ...]
    """Message types as named by Zenoh. A declared key must lie entirely within one of `keys`."""
    keys: tuple[str, ...]
    asks: bool = False
    """Whether a router passes it for all robots, because it limits the answers instead."""


EVERYBODY = (
    Rule("see-ask", "ingress", ("declare_subscriber",), SHOWN, asks=True),
    Rule("see", "egress", ("put",), SHOWN),
    Rule(
        "alive-ask",
        "ingress",
        ("declare_liveliness_subscriber", "liveliness_query"),
        ALIVE + HISTORY,
        asks=True,
    ),
    Rule("alive", "egress", ("liveliness_token",), ALIVE + HISTORY),
    Rule("history-ask", "ingress", ("query",), HISTORY, asks=True),
    Rule("history", "egress", ("declare_queryable",), HISTORY),
    # The reply to a history query carries the key of the event itself.
    Rule("history-say", "egress", ("reply",), (topics.EVENT.key("*"),)),
    Rule("open-ask", "ingress", ("query",), OPEN + CAMERAS),
    Rule("open", "egress", ("declare_queryable", "reply"), OPEN + CAMERAS),
    Rule("stop-say", "ingress", ("put",), STOP),
    Rule("stop", "egress", ("declare_subscriber",), STOP),
)
"""Rules for all roles: observe and stop."""

OPERATORS = (
    Rule("holder-ask", "ingress", ("query",), HOLDER),
    Rule("holder", "egress", ("declare_queryable", "reply"), HOLDER),
    # Without this rule, an operator's session learns of no subscriber and sends nothing.
    Rule("drive", "egress", ("declare_subscriber",), TWIST),
    Rule("outside-ask", "ingress", ("declare_subscriber",), SENSOR_POSE, asks=True),
    Rule("outside-see", "egress", ("put",), SENSOR_POSE),
)
"""Additional rules for operators: request control, see subscribers of commands, and read pose
measurements for calibration.
"""

_SHOW = ("put", "liveliness_token", "declare_queryable", "reply")
"""Messages of a camera: pictures, its token, and the answer to a question for its clock."""
SENSORS = (
    Rule("outside-say", "ingress", ("put",), SENSOR_POSE),
    Rule("outside", "egress", ("declare_subscriber",), SENSOR_POSE),
    Rule("picture-say", "ingress", _SHOW, CAMERAS),
    Rule("picture", "egress", ("declare_subscriber", "query"), CAMERAS),
)
"""Additional rules for sensors: publish poses and pictures. No other role may, because poses shift
`odom`, and operators drive by pictures.
"""

FLOOR_WATCHERS = (
    Rule(
        "floor-ask",
        "ingress",
        ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query", "query"),
        FLOOR,
    ),
    Rule("floor", "egress", _SHOW, FLOOR),
)
"""Rules for those who may watch all robots."""
FLOOR_CAMERAS = (
    Rule("floor-say", "ingress", _SHOW, FLOOR),
    Rule("floor-hear", "egress", ("declare_subscriber", "query"), FLOOR),
)
"""Additional rules for sensors of all robots."""

RECORDERS = (
    Rule("record-ask", "ingress", ("declare_subscriber",), ON_RECORD, asks=True),
    Rule("record", "egress", ("put",), ON_RECORD),
)
"""Additional rules for recorders: read client messages and the controller inputs."""


def drive_rule(name: str) -> Rule:
    """Return the rule that lets an operator and its pages send commands on their keys.

    `name-$*` matches any chunk with this prefix, because each dashboard page has a separate key.
    """
    own = tuple(
        topics.TWIST.key("*").replace("cmd/*", f"cmd/{chunk}") for chunk in (name, f"{name}-$*")
    )
    return Rule(f"drive-{name}", "ingress", ("put",), own)


def access_control(identities: Sequence[BusIdentity]) -> dict[str, Any]:
    """Return section `access_control` of a robot's Zenoh configuration.

    Subjects are the common names of client certificates; all other names have no rights.
    """
    operators = [person.name for person in identities if person.role is Role.OPERATOR]
    sensors = [person.name for person in identities if person.role is Role.SENSOR]
    recorders = [person.name for person in identities if person.role is Role.RECORDER]
    own = [drive_rule(name) for name in operators]
    watching, sensing = (*EVERYBODY, *FLOOR_WATCHERS), (*SENSORS, *FLOOR_CAMERAS)
    everybody, driving = [r.id for r in watching], [r.id for r in OPERATORS]
    policies = [{"subjects": [person.name for person in identities], "rules": everybody}]
    policies += [
        {"subjects": [name], "rules": [*driving, rule.id]}
        for name, rule in zip(operators, own, strict=True)
    ]
    policies += [{"subjects": [name], "rules": [r.id for r in sensing]} for name in sensors]
    policies += [{"subjects": [name], "rules": [r.id for r in RECORDERS]} for name in recorders]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            in_zenoh_terms(rule) for rule in (*watching, *OPERATORS, *sensing, *RECORDERS, *own)
        ],
        "subjects": [{"id": p.name, "cert_common_names": [p.name]} for p in identities],
        # Zenoh rejects a policy without subjects; an empty list denies everything.
        "policies": policies if identities else [],
    }


def in_zenoh_terms(rule: Rule) -> dict[str, Any]:
    """Return a rule with Zenoh's keys."""
    return {
        "id": rule.id,
        "permission": "allow",
        "flows": [rule.flow],
        "messages": list(rule.messages),
        "key_exprs": list(rule.keys),
    }


LISTEN = "tls/0.0.0.0:7447"
LARGEST_BYTES = 65536
"""Largest message that a robot reassembles; pictures that it routes have up to 60,000 bytes."""
_PORT = re.compile(r"^tls/.*?:(\d+)(?:[?#].*)?$")


def robot_settings(
    base: Mapping[str, Any], listen: str, identities: Sequence[BusIdentity]
) -> dict[str, Any]:
    """Return the settings of a robot node that other machines can reach.

    `base` contains the settings of a node that does not listen. File names are relative to the
    configuration file.
    """
    settings = with_tls(
        base,
        {
            "listen_private_key": f"{ROBOT}.key",
            "listen_certificate": f"{ROBOT}.pem",
        },
    )
    settings["listen"] = {"endpoints": [listen]}
    settings["access_control"] = access_control(identities)
    settings["transport"]["link"]["rx"] = {"max_message_size": LARGEST_BYTES}
    for limit in settings["low_pass_filter"]:
        limit["key_exprs"] = list(TO_ROBOTS)
    return settings


def client_settings(base: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the settings of a dashboard or tool; `base` contains those without TLS."""
    return with_tls(
        base,
        {
            "connect_private_key": f"{name}.key",
            "connect_certificate": f"{name}.pem",
            "verify_name_on_connect": True,
        },
    )


def endpoint(host: str, server: Mapping[str, Any], name: str = ROBOT) -> str:
    """Return the endpoint for clients of a robot or router with these settings at `host`.

    `name` is the name of its configuration file.

    Raises:
        TwinError: If the first listening endpoint is missing or has no port.
    """
    try:
        port = _PORT.search(server["listen"]["endpoints"][0])
    except (LookupError, TypeError):
        port = None
    if port is None:
        raise TwinError(f"{name}.json5 must listen at an endpoint with a port, such as {LISTEN}")
    return f"tls/[{host}]:{port[1]}" if ":" in host else f"tls/{host}:{port[1]}"


def with_tls(base: Mapping[str, Any], files: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings that accept mutual TLS only; `files` are relative to the configuration."""
    settings = copy.deepcopy(dict(base))
    settings["transport"]["link"] |= {
        "protocols": ["tls"],
        "tls": {
            "root_ca_certificate": f"{AUTHORITY}.pem",
            "enable_mtls": True,
            # A connection must not outlive its certificate.
            "close_link_on_expiration": True,
            **files,
        },
    }
    return settings
