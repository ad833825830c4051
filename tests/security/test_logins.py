"""A login expires on the given clock, and cannot be forged."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.security import Role
from tsd_twin.security.users import ABSOLUTE_S, IDLE_S, Logins, User

ALICE = User("alice", Role.OPERATOR, may_stop=True)


def test_what_the_browser_holds_is_kept_nowhere_and_leads_to_the_user() -> None:
    logins = Logins()
    secret = logins.open(ALICE, 0.0)
    login = logins.find(secret, 1.0)
    assert login is not None
    assert login.user == ALICE
    assert secret.encode() not in pickle.dumps(logins)
    assert len({logins.open(ALICE, 0.0) for _ in range(8)}) == 8
    assert len(secret) >= 43  # 256 bits.


@given(st.text(max_size=60))
def test_nothing_that_is_made_up_is_a_login(cookie: str) -> None:
    logins = Logins()
    logins.open(ALICE, 0.0)
    assert logins.find(cookie, 0.0) is None
    assert logins.find(None, 0.0) is None


def test_it_ends_after_a_while_unused_and_use_prolongs_it_but_not_for_ever() -> None:
    logins = Logins()
    unused, used = logins.open(ALICE, 0.0), logins.open(ALICE, 0.0)
    now_s = 0.0
    while now_s < ABSOLUTE_S:
        assert logins.find(used, now_s) is not None
        now_s += IDLE_S / 2
    assert logins.find(used, now_s + 1.0) is None
    assert logins.find(unused, IDLE_S + 1.0) is None


@pytest.mark.parametrize("open_pages", [True, False])
def test_an_open_page_is_use(open_pages: bool) -> None:
    logins = Logins()
    login = logins.find(logins.open(ALICE, 0.0), 0.0)
    assert login is not None
    for now_s in range(0, int(3 * IDLE_S), 60):
        logins.sweep({login.id} if open_pages else set(), float(now_s))
    assert logins.is_open(login.id) is open_pages
    logins.sweep({login.id}, ABSOLUTE_S + 1.0)
    assert not logins.is_open(login.id)


def test_a_user_has_a_bounded_number_of_logins_and_the_oldest_give_way() -> None:
    logins = Logins()
    secrets = [logins.open(ALICE, float(second)) for second in range(40)]
    alive = [logins.find(secret, 40.0) is not None for secret in secrets]
    assert alive == [False] * 24 + [True] * 16


def test_names_and_addresses_wait_each_for_themselves() -> None:
    logins = Logins()
    while logins.wait_s("10.0.0.1", "alice", 0.0) == 0.0:
        pass
    assert logins.wait_s("10.0.0.1", "bob", 0.0) > 0.0
    assert logins.wait_s("10.0.0.2", "alice", 0.0) == 0.0
    tries = 0
    while logins.wait_s(f"10.0.1.{tries}", "alice", 0.0) == 0.0:
        tries += 1
    assert tries < 10, "many addresses do not get more tries at one name"
    logins.right("10.0.0.2", "alice")
    assert logins.wait_s("10.0.0.3", "alice", 0.0) == 0.0


@given(st.integers(1, 4), st.integers(60, 1800))
def test_made_up_addresses_do_not_make_guessing_quicker(names: int, seconds: int) -> None:
    logins, tries = Logins(), 0
    for second in range(seconds):
        for _ in range(4):
            address, name = f"198.51.100.{tries}", f"user-{tries % names}"
            tries += logins.wait_s(address, name, float(second)) == 0.0
    assert tries <= 60 + seconds / 5 + 1
    assert tries <= names * (10 + 6 + seconds / 300)


def test_forms_without_a_name_count_by_address() -> None:
    logins = Logins()
    assert [logins.wait_nameless_s("192.0.2.1", 0.0) for _ in range(6)] == [0.0] * 5 + [5.0]
    assert logins.wait_s("192.0.2.1", "alice", 0.0) == 5.0
    assert logins.wait_s("192.0.2.2", "alice", 0.0) == 0.0


def test_after_the_wrong_tries_of_all_together_everybody_waits_a_moment() -> None:
    logins = Logins()
    for number in range(60):
        assert logins.wait_s(f"192.0.2.{number}", f"x{number}", 0.0) == 0.0
    assert logins.wait_s("198.51.100.1", "alice", 0.0) == 5.0
    assert logins.wait_s("198.51.100.1", "alice", 5.1) == 0.0
