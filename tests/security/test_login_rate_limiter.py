"""Guessing is slow for any client, and correct logins are not delayed."""

from __future__ import annotations

import pickle

from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.security.rate_limits import CALM_S, KEYS, LoginRateLimiter, LoginTokenBucket

DAY_S = 86_400.0


def made() -> LoginRateLimiter:
    return LoginRateLimiter(free=5, first_s=5.0, longest_s=900.0)


def test_a_few_tries_are_free_and_then_each_wait_is_twice_the_last() -> None:
    throttle, now_s, waits = made(), 0.0, list[float]()
    for _ in range(14):
        throttle.count_attempt("a", now_s)
        waits.append(throttle.wait_s("a", now_s))
        now_s += waits[-1]
    assert waits == [0.0] * 4 + [5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 900.0, 900.0]


@given(st.lists(st.floats(0.0, CALM_S / 4), min_size=1, max_size=300))
def test_however_tries_are_spaced_no_more_than_a_hundred_fit_into_a_day_beyond_the_free(
    pauses: list[float],
) -> None:
    throttle, now_s, tries = made(), 0.0, 0
    for pause_s in pauses:
        now_s += pause_s
        if now_s > DAY_S:
            break
        if throttle.wait_s("a", now_s) == 0.0:
            throttle.count_attempt("a", now_s)
            tries += 1
    assert tries <= 5 + 8 + DAY_S / 900.0


def test_tries_at_one_instant_count_before_any_is_known_to_be_wrong() -> None:
    throttle = made()
    let = 0
    while throttle.wait_s("a", 0.0) == 0.0:
        throttle.count_attempt("a", 0.0)
        let += 1
    assert let == 5


def test_who_turns_out_right_does_not_wait_but_what_was_wrong_stays_counted() -> None:
    throttle = made()
    for _ in range(5):
        throttle.count_attempt("a", 0.0)
    throttle.refund("a")
    assert throttle.wait_s("a", 0.0) == 0.0
    throttle.count_attempt("a", 0.0)
    assert throttle.wait_s("a", 0.0) > 0.0


def test_keys_do_not_know_of_each_other_and_an_hour_of_calm_is_a_new_start() -> None:
    throttle = made()
    for _ in range(9):
        throttle.count_attempt("a", 0.0)
    assert throttle.wait_s("b", 0.0) == 0.0
    throttle.count_attempt("a", CALM_S + 1.0)
    assert throttle.wait_s("a", CALM_S + 1.0) == 0.0


def test_a_flood_of_made_up_keys_neither_grows_nor_frees_the_one_that_waits() -> None:
    throttle = made()
    for _ in range(9):
        throttle.count_attempt("alice", 0.0)
    for number in range(KEYS, KEYS + KEYS - 1):
        throttle.count_attempt(f"x{number}", 1.0)
    full = len(pickle.dumps(throttle))
    for number in range(2 * KEYS, 4 * KEYS):
        throttle.count_attempt(f"x{number}", 1.0)
    assert throttle.wait_s("alice", 1.0) > 0.0
    assert len(pickle.dumps(throttle)) <= full, "no more than `KEYS` are kept"


def test_many_made_up_keys_do_not_give_new_tries_to_one_that_has_nearly_none_left() -> None:
    throttle = made()
    for _ in range(4):
        throttle.count_attempt("alice", 0.0)
    for number in range(3 * KEYS):
        throttle.count_attempt(f"x{number}", 1.0)
    throttle.count_attempt("alice", 2.0)
    assert throttle.wait_s("alice", 2.0) > 0.0


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=300))
def test_all_keys_together_have_so_many_tries_and_then_one_every_so_often(
    pauses: list[float],
) -> None:
    bucket, now_s, tries = LoginTokenBucket(at_once=60, every_s=5.0), 1e5, 0
    for pause_s in pauses:
        now_s += pause_s
        while bucket.wait_s(now_s) == 0.0:
            bucket.count_attempt(now_s)
            tries += 1
    assert tries <= 60 + (now_s - 1e5) / 5.0 + 1e-6
    assert 0.0 < bucket.wait_s(now_s) <= 5.0
    assert bucket.wait_s(now_s + 5.1) == 0.0


def test_a_right_try_costs_nothing_of_what_all_have() -> None:
    bucket = LoginTokenBucket(at_once=3, every_s=5.0)
    for _ in range(100):
        assert bucket.wait_s(0.0) == 0.0
        bucket.count_attempt(0.0)
        bucket.refund()
    assert bucket.wait_s(0.0) == 0.0
