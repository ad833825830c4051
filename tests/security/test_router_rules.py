"""Router rules against the rules of a listening robot, for any rights."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from tests.security.test_access_rules import FLOOR, KEYS, MESSAGES, may
from tsd_twin.security import Role, access_control, client
from tsd_twin.security.router_rules import ALL, RobotRights, router_access_control

ROBOTS = ("tsd", "lab2", "lab3")
ROLES = (Role.OPERATOR, Role.VIEWER, Role.SENSOR, Role.RECORDER)
QUESTIONS = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
SHOW = ("put", "liveliness_token", "declare_queryable", "reply")
"""Messages of a camera."""
NAME = "alice"
OTHERS = ("bob", "alice2")
SOME = st.frozensets(st.sampled_from([*ROBOTS, ALL]))


def alone(role: Role) -> set[tuple[str, str, str]]:
    """Return the permissions of a certificate on a robot that listens itself."""
    return passing(access_control([client(NAME, role)]), NAME)


def passing(rules: dict[str, object], name: str, robot: str = "tsd") -> set[tuple[str, str, str]]:
    """Return flow, message and key of all permitted messages for a robot, as keys below `tsd`."""
    return {
        (flow, message, key)
        for flow, message, key in itertools.product(("ingress", "egress"), MESSAGES, KEYS)
        if may(name, flow, message, key.replace("twin/tsd/", f"twin/{robot}/"), rules)
    }


AS = {role: alone(role) for role in ROLES}


def is_question(case: tuple[str, str, str]) -> bool:
    flow, message, key = case
    return flow == "ingress" and (message in QUESTIONS or (message == "query" and "@adv" in key))


@given(st.sampled_from(ROLES), SOME, SOME)
def test_rights_on_a_robot_are_those_of_the_role_of_a_viewer_or_only_questions(
    role: Role, use: frozenset[str], watch: frozenset[str]
) -> None:
    rights = RobotRights(use, watch)
    people = [client(NAME, role), *(client(name, Role.OPERATOR) for name in OTHERS)]
    rules = router_access_control(ROBOTS, people, {NAME: rights})
    for robot in ROBOTS:
        found = passing(rules, NAME, robot)
        if ALL in use or robot in use:
            assert found == AS[role]
        elif ALL in watch or robot in watch:
            assert {case for case in found if not is_question(case)} == {
                case for case in AS[Role.VIEWER] if not is_question(case)
            }
        else:
            assert all(map(is_question, found))
        assert passing(rules, "bob", robot) == set()


@given(st.sampled_from(ROLES), SOME, SOME)
def test_the_floor_is_shown_to_those_who_may_watch_all_robots_by_sensors_of_all(
    role: Role, use: frozenset[str], watch: frozenset[str]
) -> None:
    rules = router_access_control(ROBOTS, [client(NAME, role)], {NAME: RobotRights(use, watch)})
    watches = {
        *(("ingress", message) for message in QUESTIONS),
        ("ingress", "query"),
        *(("egress", message) for message in SHOW),
    }
    shows = {
        *(("ingress", message) for message in SHOW),
        *(("egress", message) for message in ("declare_subscriber", "query")),
    }
    expected = (watches if ALL in use | watch else set()) | (
        shows if ALL in use and role is Role.SENSOR else set()
    )
    for key, robot in itertools.product(FLOOR, ROBOTS):
        found = {
            (flow, message)
            for flow, message in itertools.product(("ingress", "egress"), MESSAGES)
            if may(NAME, flow, message, key, rules)
        }
        assert found == expected
        assert not any(
            may(robot, flow, message, key, rules)
            for flow, message in itertools.product(("ingress", "egress"), MESSAGES)
        )


@given(st.sampled_from(ROBOTS))
def test_a_robot_may_do_what_its_clients_expect_below_its_own_id_only(robot: str) -> None:
    rules = router_access_control(ROBOTS, [], {})
    every = set().union(*AS.values())
    flipped = {("ingress" if f == "egress" else "egress", m, k) for f, m, k in every}
    found = passing(rules, robot, robot)
    assert flipped <= found
    own = {key for key in KEYS if key.endswith("/alive")}
    extra = {case for case in found - flipped if case[2] not in own}
    # It passes commands of every operator, because the router has checked them.
    assert {case[1] for case in extra} <= {"put"}
    assert all("/cmd/" in case[2] and case[0] == "egress" for case in extra)
    for other in set(ROBOTS) - {robot}:
        seen = passing(rules, robot, other)
        assert not [case for case in seen if case[0] == "ingress"]
        assert {case[1] for case in seen} <= {*QUESTIONS, "query"}
