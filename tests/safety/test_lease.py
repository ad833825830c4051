"""Leases: one holder, on the robot's clock, with a speed that fits the command age."""

from __future__ import annotations

import itertools
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.services import LeaseReply, LeaseRequest
from tsd_twin.safety.lease import TTL_S, LeaseManager, max_speed_for_distance

ROBOT = robots.load_robot("tsd")


def new_desk() -> LeaseManager:
    ids = itertools.count(1)
    return LeaseManager(ROBOT, lambda: next(ids).to_bytes(16, "big"))


def acquire(desk: LeaseManager, operator: str, now_s: float, **fields: Any) -> LeaseReply:
    request = LeaseRequest(op="acquire", operator=operator, **fields)
    return desk.answer(request, now_s)


def test_the_first_to_ask_gets_it_and_is_told_for_how_long() -> None:
    reply = acquire(new_desk(), "alice", 5.0)
    assert reply.granted
    assert (reply.holder, reply.ttl_s) == ("alice", 2.0)
    assert reply.lease is not None
    assert len(bytes.fromhex(reply.lease)) == 16


def test_a_second_operator_is_told_who_has_it() -> None:
    desk = new_desk()
    acquire(desk, "alice", 5.0)
    reply = acquire(desk, "bob", 5.1)
    assert not reply.granted
    assert (reply.lease, reply.holder) == (None, "alice")
    assert reply.why == because(Code.DRIVEN_BY, holder="alice")


def test_it_ends_after_its_time_and_not_before() -> None:
    desk = new_desk()
    acquire(desk, "alice", 5.0)
    assert desk.current(5.0 + TTL_S - 1e-6) is not None
    assert not acquire(desk, "bob", 5.0 + TTL_S - 1e-6).granted
    assert desk.current(5.0 + TTL_S) is None
    assert acquire(desk, "bob", 5.0 + TTL_S).granted


def test_a_renewal_counts_from_when_it_comes_in() -> None:
    desk = new_desk()
    lease = acquire(desk, "alice", 5.0).lease
    request = LeaseRequest(op="renew", operator="alice", lease=lease)
    assert desk.answer(request, 6.5).lease == lease
    assert desk.current(8.4) is not None
    assert not desk.answer(request, 8.5).granted


def test_a_take_over_ends_the_lease_of_the_other_at_once() -> None:
    desk = new_desk()
    old = acquire(desk, "alice", 5.0).lease
    new = acquire(desk, "bob", 5.1, take_over=True)
    assert new.granted
    assert new.lease != old
    for op in ("renew", "release"):
        request = LeaseRequest(op=op, operator="alice", lease=old)
        reply = desk.answer(request, 5.2)
        assert not reply.granted
        assert reply.holder == "bob"
    current = desk.current(5.3)
    assert current is not None
    assert current.holder == "bob"


@pytest.mark.parametrize("op", ["renew", "release"])
@pytest.mark.parametrize(("operator", "own"), [("bob", True), ("alice", False)])
def test_only_its_holder_with_its_id_renews_or_releases_it(
    op: Any, operator: str, own: bool
) -> None:
    desk = new_desk()
    granted = acquire(desk, "alice", 5.0).lease
    for lease in (granted,) if own else ("ff" * 16, None):
        request = LeaseRequest(op=op, operator=operator, lease=lease)
        assert not desk.answer(request, 6.0).granted
    current = desk.current(6.0)
    assert current is not None
    assert current.id.hex() == granted
    assert desk.current(7.0) is None


def test_released_it_is_free() -> None:
    desk = new_desk()
    lease = acquire(desk, "alice", 5.0).lease
    reply = desk.answer(LeaseRequest(op="release", operator="alice", lease=lease), 5.1)
    assert reply.why == because(Code.RELEASED)
    assert acquire(desk, "bob", 5.1).granted


def test_peeking_changes_nothing() -> None:
    desk = new_desk()
    peek = LeaseRequest(op="peek", operator="bob")
    assert desk.answer(peek, 5.0).holder is None
    acquire(desk, "alice", 5.0)
    assert desk.answer(peek, 6.9) == LeaseReply(False, holder="alice")
    assert desk.current(7.0) is None


operators = st.sampled_from(["alice", "bob", "carol"])
acts: st.SearchStrategy[Any] = st.tuples(
    st.sampled_from(["acquire", "take over", "renew", "release"]),
    operators,
    st.booleans(),
    st.sampled_from([0.0, 0.1, 1.0, 1.9, 2.0, 2.1]),
)


@given(script=st.lists(acts, max_size=30))
def test_never_more_than_one_lease_is_in_force(
    script: list[tuple[Any, str, bool, float]],
) -> None:
    """Against a minimal model: the latest holder, its lease, and the last renewal."""
    desk, now_s = new_desk(), 0.0
    last: tuple[str, str, float] | None = None
    held = dict.fromkeys(["alice", "bob", "carol"], "00" * 16)
    seen: set[str] = set()
    for op, operator, other, wait_s in script:
        now_s += wait_s
        if last is not None and now_s >= last[2]:
            last = None
        if op in ("acquire", "take over"):
            reply = acquire(desk, operator, now_s, take_over=op == "take over")
            assert reply.granted == (last is None or op == "take over")
            if reply.granted:
                assert reply.lease is not None
                assert reply.lease not in seen
                seen.add(reply.lease)
                held[operator] = reply.lease
                last = (operator, reply.lease, now_s + 2.0)
        else:
            lease = held["alice" if other else operator]
            desk.answer(
                LeaseRequest(op=op, operator=operator, lease=lease),
                now_s,
            )
            if last is not None and last[:2] == (operator, lease):
                last = (operator, lease, now_s + 2.0) if op == "renew" else None
        current = desk.current(now_s)
        assert (current and (current.holder, current.id.hex())) == (last and last[:2])


# Granted command age, and the corresponding speed.


@pytest.mark.parametrize(
    ("asked_s", "granted_s"),
    [(None, 0.21), (0.001, 0.21), (0.25, 0.25), (0.6, 0.6), (1.0, 1.0), (60.0, 1.0), (1e300, 1.0)],
)
def test_the_age_has_a_floor_and_a_ceiling(asked_s: float | None, granted_s: float) -> None:
    reply = acquire(new_desk(), "alice", 5.0, max_age_s=asked_s)
    assert reply.granted
    assert reply.max_age_s == granted_s


@pytest.mark.parametrize("age_s", [math.nan, math.inf])
def test_an_age_that_is_no_number_is_refused(age_s: float) -> None:
    desk = new_desk()
    reply = acquire(desk, "alice", 5.0, max_age_s=age_s)
    assert not reply.granted
    assert reply.why == because(Code.NOT_FINITE, quantity="max_age_s")
    assert desk.current(5.0) is None


@pytest.mark.parametrize(
    ("timeout_s", "distance_m"), [(0.1, 0.35), (0.2, 0.45), (0.5, 0.75), (2.0, 2.25)]
)
def test_the_cap_inverts_published_stopping_distances(timeout_s: float, distance_m: float) -> None:
    """From 1 m/s at 2 m/s^2: WPILib, Husarion, ROS controllers and Viam with their timeouts."""
    assert max_speed_for_distance(2.0, timeout_s, distance_m) == pytest.approx(1.0)


@given(
    deceleration=st.floats(0.1, 20.0), late_s=st.floats(0.0, 5.0), allowed_m=st.floats(0.01, 10.0)
)
def test_at_the_cap_lateness_and_braking_use_up_the_allowance(
    deceleration: float, late_s: float, allowed_m: float
) -> None:
    speed = max_speed_for_distance(deceleration, late_s, allowed_m)
    steps, braking_s = 20_000, speed / deceleration
    # Drive on for the delay, then brake: summed up numerically.
    braking = sum(speed * (1 - (i + 0.5) / steps) for i in range(steps)) * braking_s / steps
    assert speed > 0.0
    assert speed * late_s + braking == pytest.approx(allowed_m, rel=1e-6)


@given(ages=st.lists(st.floats(0.01, 3.0), min_size=2, max_size=5))
def test_the_older_commands_may_be_the_slower_the_robot(ages: list[float]) -> None:
    caps = []
    for age_s in sorted(ages):
        desk = new_desk()
        acquire(desk, "alice", 5.0, max_age_s=age_s)
        lease = desk.current(5.0)
        assert lease is not None
        caps.append(lease.speed_cap_mps)
    assert caps == sorted(caps, reverse=True)
    assert max(caps) <= ROBOT.limits.speed_mps
    assert min(caps) > 0.0


@pytest.mark.parametrize("name", robots.robot_names())
def test_every_shipped_robot_has_its_full_speed_under_the_usual_lease(name: str) -> None:
    robot = robots.load_robot(name)
    desk = LeaseManager(robot, lambda: bytes(16))
    acquire(desk, "alice", 5.0)
    lease = desk.current(5.0)
    assert lease is not None
    assert lease.speed_cap_mps == robot.limits.speed_mps


def test_a_robot_with_a_short_allowance_is_slower_under_every_lease() -> None:
    limits = msgspec.structs.replace(ROBOT.limits, stop_allowance_m=0.1)
    robot = msgspec.structs.replace(ROBOT, limits=limits)
    desk = LeaseManager(robot, lambda: bytes(16))
    acquire(desk, "alice", 5.0)
    lease = desk.current(5.0)
    assert lease is not None
    assert 0.0 < lease.speed_cap_mps < 0.4


def test_the_cap_of_the_oldest_age_keeps_to_the_allowance() -> None:
    """A command 1 s old, two control periods, servo lag and bus delay, and braking."""
    desk = new_desk()
    acquire(desk, "alice", 5.0, max_age_s=1.0)
    lease = desk.current(5.0)
    assert lease is not None
    v, a = lease.speed_cap_mps, ROBOT.limits.deceleration_mps2
    late_s = 1.0 + 0.02 + 1 / 32 + 0.005
    assert v * late_s + v * v / (2 * a) == pytest.approx(0.35)
    assert v < 0.35
