"""Names that could be confused with others are refused."""

from __future__ import annotations

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.errors import TwinError
from tsd_twin.messages import topics
from tsd_twin.security import LONGEST, BusIdentity, Role, client
from tsd_twin.security.access_rules import drive_rule, merged

# Few letters, so that names often share a prefix.
names = st.text("ab-", min_size=1, max_size=5)
roles = st.sampled_from([Role.OPERATOR, Role.VIEWER, Role.SENSOR, Role.RECORDER])
identities = st.lists(st.builds(client, names, roles), max_size=6)
pages = st.text("0123456789abcdef", min_size=8, max_size=8)


def as_key(text: str) -> zenoh.KeyExpr:
    return zenoh.KeyExpr(text)


@given(known=identities, new=identities, page=pages)
def test_whoever_is_accepted_no_operator_may_send_on_the_key_of_another(
    known: list[BusIdentity], new: list[BusIdentity], page: str
) -> None:
    try:
        everybody = merged(merged([], known), new)
    except TwinError:
        return
    for person in everybody:
        for other in everybody:
            keys = [as_key(key) for key in drive_rule(person.name).keys]
            for operator in (other.name, f"{other.name}-{page}"):
                used = as_key(topics.twist_key("r1", operator))
                covered = any(key.includes(used) for key in keys)
                assert covered == (person.name == other.name)


@given(known=identities)
def test_a_register_has_each_name_once_and_does_not_change_when_it_is_merged_again(
    known: list[BusIdentity],
) -> None:
    try:
        register = merged([], known)
    except TwinError:
        return
    assert {person.name for person in register} == {person.name for person in known}
    assert len(register) == len({person.name for person in register})
    assert merged(register, register) == register == merged(register, reversed(known))


@pytest.mark.parametrize(
    ("known", "new"), [("alice", "alice-2"), ("alice-2", "alice"), ("a", "a-")]
)
def test_a_name_that_could_be_a_page_of_another_is_refused(known: str, new: str) -> None:
    with pytest.raises(TwinError, match="could be a page of"):
        merged([client(known, Role.OPERATOR)], [client(new, Role.VIEWER)])


def test_nobody_is_both_operator_and_viewer() -> None:
    with pytest.raises(TwinError, match="'bob' is an operator and cannot be a viewer as well"):
        merged([client("bob", Role.OPERATOR)], [client("bob", Role.VIEWER)])


@pytest.mark.parametrize("name", ["", "Alice", "a/b", "*", "al$*", "é", "robot", "ca", "a" * 24])
def test_a_name_that_cannot_be_one_is_refused(name: str) -> None:
    with pytest.raises(TwinError):
        client(name, Role.OPERATOR)


@given(name=st.text("ab-_09", min_size=1, max_size=LONGEST), page=pages)
def test_every_name_leaves_room_for_a_page(name: str, page: str) -> None:
    person = client(name, Role.OPERATOR)
    assert topics.checked(f"{person.name}-{page}")
