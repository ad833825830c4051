"""Who may say what: the access rules of a robot, as data, from the table of topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from tsd_twin import topics
from tsd_twin.access.identity import Identity, Role
from tsd_twin.topics import Service

_ANY = "twin/*"
_CLAIMS = (topics.TWIST, topics.OUTSIDE_POSE, topics.STOP)
"""What clients say to robots; all other topics are what robots say."""
_BRANCHES = sorted({topic.path.split("/")[0] for topic in topics.TOPICS if topic not in _CLAIMS})

SHOWN = tuple(f"{_ANY}/{branch}/**" for branch in _BRANCHES)
ALIVE = (topics.alive_key("*"), topics.instance_key("*", "*"))
HISTORY = (f"{topics.EVENT.key('*')}/@adv/**",)
"""Where late joiners of events ask for what was; chunks with @ match no wildcard but themselves."""
OPEN = tuple(f"{_ANY}/{service}" for service in Service if not service.startswith("srv/"))
HOLDER = tuple(f"{_ANY}/{service}" for service in Service if service.startswith("srv/"))
STOP = (topics.STOP.key("*"),)
TWIST = (topics.TWIST.key("*"),)
OUTSIDE_POSE = (topics.OUTSIDE_POSE.key("*"),)
EVERYTHING = (f"{_ANY}/**", *HISTORY)


@dataclass(frozen=True, slots=True)
class Rule:
    """What is let through; everything else is not."""

    id: str
    flow: Literal["ingress", "egress"]
    """Seen from the robot: ingress is what comes in."""
    messages: tuple[str, ...]
    """In Zenoh's terms. A key that is declared must lie within one of `keys` altogether."""
    keys: tuple[str, ...]


EVERYBODY = (
    Rule("see-ask", "ingress", ("declare_subscriber",), SHOWN),
    Rule("see", "egress", ("put",), SHOWN),
    Rule(
        "alive-ask",
        "ingress",
        ("declare_liveliness_subscriber", "liveliness_query"),
        ALIVE + HISTORY,
    ),
    Rule("alive", "egress", ("liveliness_token",), ALIVE + HISTORY),
    Rule("history-ask", "ingress", ("query",), HISTORY),
    Rule("history", "egress", ("declare_queryable",), HISTORY),
    # An answer about the past carries the key of the event itself.
    Rule("history-say", "egress", ("reply",), (topics.EVENT.key("*"),)),
    Rule("open-ask", "ingress", ("query",), OPEN),
    Rule("open", "egress", ("declare_queryable", "reply"), OPEN),
    Rule("stop-say", "ingress", ("put",), STOP),
    Rule("stop", "egress", ("declare_subscriber",), STOP),
)
"""All: see, and stop."""

OPERATORS = (
    Rule("holder-ask", "ingress", ("query",), HOLDER),
    Rule("holder", "egress", ("declare_queryable", "reply"), HOLDER),
    # Without this the session of an operator never hears of a reader, and sends nothing.
    Rule("drive", "egress", ("declare_subscriber",), TWIST),
    Rule("outside-ask", "ingress", ("declare_subscriber",), OUTSIDE_POSE),
    Rule("outside-see", "egress", ("put",), OUTSIDE_POSE),
)
"""Operators besides: ask for control, hear that somebody listens to commands, and where a robot is
seen, to calibrate it by."""

SENSORS = (
    Rule("outside-say", "ingress", ("put",), OUTSIDE_POSE),
    Rule("outside", "egress", ("declare_subscriber",), OUTSIDE_POSE),
)
"""Sensors besides: say where a robot is. Nobody else, since poses turn what `odom` means."""


def drive_rule(name: str) -> Rule:
    """Return the rule that lets one operator, and the pages of one, send commands; nobody else.

    `name-$*` is any chunk that begins so: each page of a dashboard has a key of its own.
    """
    own = tuple(
        topics.TWIST.key("*").replace("cmd/*", f"cmd/{chunk}") for chunk in (name, f"{name}-$*")
    )
    return Rule(f"drive-{name}", "ingress", ("put",), own)


def access_control(people: Sequence[Identity]) -> dict[str, Any]:
    """Return the section `access_control` of a robot's Zenoh configuration.

    Subjects are the common names of client certificates; who is none of them may nothing.
    """
    operators = [person.name for person in people if person.role is Role.OPERATOR]
    sensors = [person.name for person in people if person.role is Role.SENSOR]
    own = [drive_rule(name) for name in operators]
    everybody, driving = [r.id for r in EVERYBODY], [r.id for r in OPERATORS]
    policies = [{"subjects": [person.name for person in people], "rules": everybody}]
    policies += [
        {"subjects": [name], "rules": [*driving, rule.id]}
        for name, rule in zip(operators, own, strict=True)
    ]
    policies += [{"subjects": [name], "rules": [r.id for r in SENSORS]} for name in sensors]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [_in_zenoh_terms(rule) for rule in (*EVERYBODY, *OPERATORS, *SENSORS, *own)],
        "subjects": [{"id": p.name, "cert_common_names": [p.name]} for p in people],
        # A policy for nobody is an error to Zenoh; no policies deny everything.
        "policies": policies if people else [],
    }


def _in_zenoh_terms(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "permission": "allow",
        "flows": [rule.flow],
        "messages": list(rule.messages),
        "key_exprs": list(rule.keys),
    }
