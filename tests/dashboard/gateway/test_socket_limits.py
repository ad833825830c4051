"""Rate limits of a socket are far above normal use and cut off a flood."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.gateway.socket_limits import (
    GRACE,
    TELEOP,
    VISER,
    Bucket,
    FloodBlocklist,
    LimitDecision,
    Quota,
    SocketLimiter,
)

DRIVE = (
    '{"t":"drive","vx":0.123456,"vy":-0.123456,"omega":1.234567,"frame":"base_link",'
    '"status_seq":12345}'
)
BEAT = '{"t":"heartbeat","status_seq":12345,"sent_ms":123456.7,"focus":true}'
CLEARED = '{"t":"clear_plan"}'
MOST_AT_ONCE = round((1.0 + GRACE) * TELEOP.messages.burst)


@given(
    st.floats(1.0, 100.0),
    st.floats(1.0, 100.0),
    st.lists(st.floats(0.0, 0.5), min_size=1, max_size=200),
)
def test_no_more_passes_than_the_burst_and_the_rate(
    per_s: float, burst: float, waits_s: list[float]
) -> None:
    bucket, now_s, passed = Bucket(Quota(per_s, burst)), 0.0, 0
    for wait_s in waits_s:
        now_s += wait_s
        passed += bucket.try_take(now_s)
    assert passed <= burst + per_s * now_s + 1e-6


def test_a_page_that_does_all_it_can_at_once_passes_for_an_hour() -> None:
    """Stick commands at the maximum rate of 100 Hz, heartbeats, and cleared plans."""
    limiter = SocketLimiter(TELEOP)
    for tick in range(360_000):
        now_s = 0.01 * tick
        said = [DRIVE]
        said += [BEAT] if tick % 10 == 0 else []
        said += [CLEARED] if tick % 25 == 0 else []
        said += ['{"t":"stop"}'] if tick % 20 == 0 else []
        assert all(limiter.decide(text, now_s) is LimitDecision.PASS for text in said)


def test_what_a_page_said_while_the_network_stood_still_passes() -> None:
    """The page falls silent after 2 s without a reply, so its backlog is limited."""
    limiter = SocketLimiter(TELEOP)
    for text in [DRIVE] * 200 + [BEAT] * 20:
        assert limiter.decide(text, 5.0) is LimitDecision.PASS


@pytest.mark.parametrize(
    "text", [CLEARED, DRIVE, BEAT, "garbage", '{"t":"robot","id":"x"}', '{"t":"stop"}', b"\x00"]
)
def test_a_flood_is_cut_off(text: str | bytes) -> None:
    limiter = SocketLimiter(TELEOP)
    decisions = [limiter.decide(text, 1.0) for _ in range(MOST_AT_ONCE + 1)]
    assert decisions[-1] is LimitDecision.CUT
    assert LimitDecision.CUT not in decisions[: round(TELEOP.messages.burst)]


def test_a_few_huge_messages_are_a_flood_too() -> None:
    limiter = SocketLimiter(TELEOP)
    decisions = [limiter.decide("x" * 16_000, 1.0) for _ in range(60)]
    assert decisions[0] is LimitDecision.PASS
    assert decisions[-1] is LimitDecision.CUT


def test_one_kind_that_floods_takes_nothing_from_the_others() -> None:
    limiter = SocketLimiter(TELEOP)
    decisions = [limiter.decide(CLEARED, 1.0) for _ in range(200)]
    assert decisions.count(LimitDecision.PASS) == TELEOP.kinds["clear_plan"].burst
    assert limiter.dropped == 200 - decisions.count(LimitDecision.PASS)
    assert limiter.decide(DRIVE, 1.0) is LimitDecision.PASS


@pytest.mark.parametrize("text", ['{"t":"stop"}', '{"t": "stop"}', '{"t":"release"}'])
def test_stop_and_release_pass_until_the_socket_is_cut_off(text: str) -> None:
    limiter = SocketLimiter(TELEOP)
    while limiter.decide("garbage", 1.0) is not LimitDecision.CUT:
        decision = limiter.decide(text, 1.0)
        assert decision is not LimitDecision.DROP


@given(st.text(max_size=200) | st.binary(max_size=200))
def test_whatever_is_sent_is_judged(data: str | bytes) -> None:
    assert SocketLimiter(TELEOP).decide(data, 1.0) is LimitDecision.PASS


def test_cameras_and_controls_as_a_browser_sends_them_pass() -> None:
    limiter = SocketLimiter(VISER)
    for tick in range(36_000):
        assert limiter.decide(bytes(330), tick / 70.0) is LimitDecision.PASS


def test_a_message_of_a_flood_costs_little() -> None:
    """Cheaper than decoding; take the best run, because other processes interfere."""
    limiter = SocketLimiter(TELEOP)

    def took_s() -> float:
        begin_s = time.thread_time()
        for _ in range(2000):
            limiter.decide(CLEARED, 1.0)
        return (time.thread_time() - begin_s) / 2000

    assert min(took_s() for _ in range(10)) < 20e-6


def test_who_was_cut_off_waits_and_is_forgotten_then() -> None:
    cut_off = FloodBlocklist()
    for number in range(5000):
        cut_off.note(str(number), 10.0)
    assert cut_off.waits_s("4999", 10.0) == FloodBlocklist.STAYS_OUT_S
    assert cut_off.waits_s("4999", 10.0 + FloodBlocklist.STAYS_OUT_S) == 0.0
    assert cut_off.waits_s("somebody else", 10.0) == 0.0
    waiting = [number for number in range(5000) if cut_off.waits_s(str(number), 10.0) > 0.0]
    assert len(waiting) <= 1000
    assert cut_off.count == 5000


def test_who_floods_again_and_again_stays_out_longer_and_longer_up_to_a_minute() -> None:
    cut_off, now_s, waits_s = FloodBlocklist(), 100.0, list[float]()
    for _ in range(6):
        cut_off.note("guest", now_s)
        cut_off.note("guest", now_s)  # A second socket of the same login counts once.
        waits_s.append(cut_off.waits_s("guest", now_s))
        now_s += waits_s[-1] + 1.0
    assert waits_s == pytest.approx([5.0, 10.0, 20.0, 40.0, 60.0, 60.0])
    now_s += FloodBlocklist.LONGEST_S
    cut_off.note("guest", now_s)
    assert cut_off.waits_s("guest", now_s) == pytest.approx(5.0)
