"""Access rules and Zenoh settings of a router that robots and operators dial, as data.

A robot behind a router sees only the router's certificate, so rights per robot are rules of the
router. Rules name certificates exactly, because Zenoh has no patterns for their names.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.security.access_rules import (
    EVERYBODY,
    EVERYTHING,
    FLOOR_CAMERAS,
    FLOOR_WATCHERS,
    OPERATORS,
    RECORDERS,
    ROUTER,
    SENSORS,
    TO_ROBOTS,
    TWIST,
    BusIdentity,
    Role,
    Rule,
    drive_rule,
    in_zenoh_terms,
    with_tls,
)

ALL = "*"
"""All robots of the router, in a list of robots."""
MOST_SESSIONS = 256
LARGEST_COMMAND_BYTES = 4096
"""Largest message to a robot."""
LARGEST_STATE_BYTES = 65536
"""Largest message except replies; a status has 5 kB, a block of inputs 20 kB, a picture 60 kB."""


@dataclass(frozen=True, slots=True)
class RobotRights:
    """Robots that a certificate or a user may use and watch; `ALL` stands for every robot."""

    use: frozenset[str] = frozenset()
    """Robots on which it has all rights of its role."""
    watch: frozenset[str] = frozenset()
    """Further robots that it may watch only, as a viewer may."""

    def may_use(self, robot: str) -> bool:
        """Return whether all rights of the role apply to a robot."""
        return ALL in self.use or robot in self.use

    def may_watch(self, robot: str) -> bool:
        """Return whether a robot is visible."""
        return self.may_use(robot) or ALL in self.watch or robot in self.watch

    @property
    def visible(self) -> frozenset[str]:
        """All visible robots, or `ALL`."""
        seen = self.use | self.watch
        return frozenset({ALL}) if ALL in seen else seen


EVERY_ROBOT = RobotRights(use=frozenset({ALL}))


def parse_robots(names: Iterable[str]) -> frozenset[str]:
    """Return robots by id; `all` stands for every robot.

    Raises:
        TwinError: If a name cannot be a robot id.
    """
    names = list(names)
    if "all" in names:
        return frozenset({ALL})
    return frozenset(topics.checked(name) for name in names)


def show_robots(robots: Iterable[str]) -> list[str]:
    """Return names as `parse_robots` reads them."""
    return ["all"] if ALL in robots else sorted(robots)


def rights_of_flags(robots: str | None, watch: str | None) -> RobotRights | None:
    """Return the rights in `--robots` and `--watch`, such as `lab1,lab2`; None without flags.

    Raises:
        TwinError: If a flag names no robot, or a name cannot be a robot id.
    """
    if robots is None and watch is None:
        return None
    lists = [[each.strip() for each in (text or "").split(",")] for text in (robots, watch)]
    for text, names in zip((robots, watch), lists, strict=True):
        if text is not None and not all(names):
            raise TwinError(f"'{text}' is not a list of robots: write lab1,lab2, or all")
    return RobotRights(*(parse_robots(filter(None, names)) for names in lists))


def router_access_control(
    robots: Sequence[str], identities: Sequence[BusIdentity], rights: Mapping[str, RobotRights]
) -> dict[str, Any]:
    """Return section `access_control` of a router's Zenoh configuration.

    Questions about all robots are allowed, and answered for the permitted ones only, so one
    subscription shows a client its robots and nothing of the others. Pictures of the floor show
    all robots, and are therefore for those who may watch all, with `ALL`.

    Args:
        robots: Ids of the robots, which are the names in their certificates.
        identities: Clients.
        rights: Robots of each client by its name; without an entry, none.
    """
    rules: dict[str, Rule] = {}
    policies: list[dict[str, Any]] = []
    granted = [(robot, _robot_rules(robot)) for robot in robots]
    granted += [
        (person.name, _client_rules(person, robots, rights.get(person.name, RobotRights())))
        for person in identities
    ]
    for name, own in granted:
        rules |= {rule.id: rule for rule in own}
        if own:
            policies.append({"subjects": [name], "rules": [rule.id for rule in own]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [in_zenoh_terms(rule) for rule in rules.values()],
        "subjects": [{"id": name, "cert_common_names": [name]} for name, _ in granted],
        "policies": policies,
    }


_OF_ROLE: Mapping[Role, tuple[Rule, ...]] = {
    Role.OPERATOR: OPERATORS,
    Role.VIEWER: (),
    Role.SENSOR: SENSORS,
    Role.RECORDER: RECORDERS,
}


def _client_rules(person: BusIdentity, robots: Sequence[str], rights: RobotRights) -> list[Rule]:
    used = [robot for robot in robots if rights.may_use(robot)]
    watched = [robot for robot in robots if rights.may_watch(robot)]
    rules = [_limited(rule, robot) for robot in watched for rule in EVERYBODY]
    rules += [_limited(rule, robot) for robot in used for rule in _OF_ROLE[person.role]]
    if person.role is Role.OPERATOR:
        rules += [_limited(drive_rule(person.name), robot) for robot in used]
    if ALL in rights.visible:
        rules += FLOOR_WATCHERS
    if ALL in rights.use and person.role is Role.SENSOR:
        rules += FLOOR_CAMERAS
    return list(dict.fromkeys(rules))


def _limited(rule: Rule, robot: str) -> Rule:
    """Return a rule for one robot, or unchanged if it only asks."""
    if rule.asks:
        return rule
    keys = tuple(key.replace("twin/*/", f"twin/{robot}/", 1) for key in rule.keys)
    return replace(rule, id=f"{rule.id}@{robot}", keys=keys)


def _robot_rules(robot: str) -> list[Rule]:
    """Return the rules of a robot: whatever may pass its clients, in the opposite direction."""
    clients = [_limited(rule, robot) for rule in (*EVERYBODY, *OPERATORS, *SENSORS, *RECORDERS)]
    clients.append(_limited(Rule("drive-say", "ingress", ("put",), TWIST), robot))
    rules = [_mirrored(rule, robot) for rule in clients]
    # A robot checks that no other node has its id.
    own = (topics.alive_key(robot), topics.instance_key(robot, "*"))
    asks = ("declare_liveliness_subscriber", "liveliness_query")
    rules.append(Rule(f"robot-id-ask@{robot}", "ingress", asks, own))
    rules.append(Rule(f"robot-id@{robot}", "egress", ("liveliness_token",), own))
    return rules


def _mirrored(rule: Rule, robot: str) -> Rule:
    flow = "egress" if rule.flow == "ingress" else "ingress"
    return replace(rule, id=f"robot-{rule.id.removesuffix(f'@{robot}')}@{robot}", flow=flow)


def router_settings(
    base: Mapping[str, Any],
    listen: str,
    robots: Sequence[str],
    identities: Sequence[BusIdentity],
    rights: Mapping[str, RobotRights],
) -> dict[str, Any]:
    """Return the settings of a router, also valid for zenohd.

    `base` contains the settings of a node that does not listen. File names are relative to the
    configuration file.
    """
    settings = with_tls(
        base,
        {"listen_private_key": f"{ROUTER}.key", "listen_certificate": f"{ROUTER}.pem"},
    )
    settings["listen"] = {"endpoints": [listen]}
    settings["access_control"] = router_access_control(robots, identities, rights)
    settings["transport"]["unicast"]["max_sessions"] = MOST_SESSIONS
    # A publisher that blocks on congestion would let one slow viewer delay all commands.
    settings["qos"] = {
        "network": [
            {
                "id": "never-block",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": list(EVERYTHING),
                "overwrite": {"congestion_control": "drop"},
            }
        ]
    }
    settings["low_pass_filter"] = [
        _size_limit("states", EVERYTHING, LARGEST_STATE_BYTES),
        _size_limit("commands", TO_ROBOTS, LARGEST_COMMAND_BYTES),
    ]
    return settings


def _size_limit(name: str, keys: Sequence[str], most_bytes: int) -> dict[str, Any]:
    return {
        "id": name,
        "flows": ["ingress"],
        "messages": ["put", "query"],
        "key_exprs": list(keys),
        "size_limit": most_bytes,
    }
