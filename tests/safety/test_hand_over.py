"""Handover: requests have no effect; a grant stops the robot and reserves the lease."""

from __future__ import annotations

from typing import Any

import pytest

from tests.safety.supervisor_harness import SupervisorHarness
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.safety.lease import DENIED_S, REQUEST_TIMEOUT_S, RESERVATION_S


def changes(stage: SupervisorHarness) -> list[Reason]:
    return [event.why for event in stage.supervisor.take_events() if event.kind == "lease"]


def answer(stage: SupervisorHarness, op: str, asker: str | None = "bob") -> LeaseReply:
    return stage.ask(op, lease=stage.lease, requester=asker)


def hold_on(stage: SupervisorHarness, seconds: float) -> None:
    """Advance time while Alice renews the lease without driving."""
    for _ in range(round(seconds / 0.5)):
        stage.wait(0.5)
        stage.ask("renew", lease=stage.lease)


@pytest.fixture
def asked(stage: SupervisorHarness) -> SupervisorHarness:
    """Alice is driving; Bob has requested control."""
    stage.bring_to(Mode.DRIVING)
    stage.supervisor.take_events()
    assert stage.ask("request", "bob").done
    return stage


def test_a_request_is_told_to_all_and_the_holder_drives_on(asked: SupervisorHarness) -> None:
    asks = because(Code.CONTROL_REQUESTED, operator="bob", holder="alice")
    assert changes(asked) == [asks]
    claim = asked.supervisor.hand_over.pending_request(asked.now_s)
    assert claim is not None
    assert claim.operator == "bob"
    asked.hold(1.0, 1.0)
    assert asked.mode is Mode.DRIVING


def test_a_grant_stops_the_robot_and_only_the_asker_gets_control(asked: SupervisorHarness) -> None:
    assert answer(asked, "grant").done
    handed_over = because(Code.LEASE_HANDED_OVER, operator="alice", other="bob")
    assert changes(asked)[-1] == handed_over
    assert not asked.send(1.0), "the lease of the giver has ended"
    asked.wait(0.01)
    assert asked.mode is Mode.STOPPING
    for other in ("alice", "carol"):
        for take_over in (False, True):
            reply = asked.ask("acquire", other, take_over=take_over)
            assert not reply.granted
            assert reply.why == because(Code.RESERVED_FOR, operator="bob")
    assert asked.ask("acquire", "bob").granted
    assert asked.supervisor.hand_over.reservation(asked.now_s) is None


def test_the_asker_drives_from_standstill_on(asked: SupervisorHarness) -> None:
    answer(asked, "grant")
    asked.wait(0.01)
    asked.acquire("bob")
    assert asked.send(1.0, operator="bob")
    assert asked.mode is Mode.STOPPING
    asked.wait(0.01, at_rest=True)
    assert asked.send(1.0, operator="bob")
    assert asked.mode is Mode.DRIVING


def test_what_is_kept_for_the_asker_is_free_again_when_not_taken(asked: SupervisorHarness) -> None:
    answer(asked, "grant")
    asked.wait(RESERVATION_S - 0.02)
    assert not asked.ask("acquire", "alice").granted
    asked.wait(0.03)
    assert changes(asked)[-1] == because(Code.RESERVATION_EXPIRED, operator="bob")
    assert asked.ask("acquire", "alice").granted


def test_who_has_left_when_control_is_granted_keeps_it_from_nobody(
    asked: SupervisorHarness,
) -> None:
    answer(asked, "grant")
    assert not asked.ask("withdraw", "carol").done
    assert asked.ask("withdraw", "bob").done
    asked.wait(0.01, at_rest=True)
    assert changes(asked)[-1].params["other"] == "bob"
    assert asked.ask("acquire", "carol").granted


def test_control_that_is_kept_stays_and_the_asker_waits_before_asking_again(
    asked: SupervisorHarness,
) -> None:
    assert answer(asked, "deny").done
    assert changes(asked)[-1] == because(Code.REQUEST_DENIED, operator="alice", asker="bob")
    assert asked.mode is Mode.DRIVING
    assert asked.ask("request", "bob").why.code == Code.DENIED_LATELY
    assert asked.ask("request", "carol").done, "another may ask"
    asked.ask("withdraw", "carol")
    hold_on(asked, DENIED_S + 0.5)
    assert asked.ask("request", "bob").done


def test_a_request_without_an_answer_ends(asked: SupervisorHarness) -> None:
    hold_on(asked, REQUEST_TIMEOUT_S - 0.5)
    assert asked.supervisor.hand_over.pending_request(asked.now_s) is not None
    hold_on(asked, 1.0)
    assert asked.supervisor.hand_over.pending_request(asked.now_s) is None
    assert changes(asked)[-1] == because(Code.REQUEST_EXPIRED, holder="alice", asker="bob")
    assert answer(asked, "grant").why == because(Code.NO_REQUEST)


def test_a_request_is_withdrawn_by_who_made_it(asked: SupervisorHarness) -> None:
    assert not asked.ask("withdraw", "carol").done
    assert asked.ask("withdraw", "bob").done
    assert changes(asked)[-1] == because(Code.REQUEST_WITHDRAWN, operator="bob")
    assert not answer(asked, "grant").done


def test_one_asks_at_a_time_and_asking_twice_is_asking_once(asked: SupervisorHarness) -> None:
    assert asked.ask("request", "carol").why == because(Code.OTHER_REQUEST, asker="bob")
    first = asked.supervisor.hand_over.pending_request(asked.now_s)
    asked.wait(0.1)
    assert asked.ask("request", "bob").done
    assert asked.supervisor.hand_over.pending_request(asked.now_s) == first


def test_who_is_asked_and_releases_hands_over(asked: SupervisorHarness) -> None:
    assert asked.ask("release", lease=asked.lease).done
    assert not asked.ask("acquire", "carol").granted
    assert asked.ask("acquire", "bob").granted


def test_a_request_ends_with_the_lease_that_it_asks_for(asked: SupervisorHarness) -> None:
    asked.acquire("carol", take_over=True)
    assert asked.supervisor.hand_over.pending_request(asked.now_s) is None
    assert not asked.ask("grant", "carol", lease=asked.lease, requester="bob").done
    asked.ask("request", "bob")
    asked.wait(2.1)
    assert asked.supervisor.hand_over.pending_request(asked.now_s) is None
    assert asked.ask("acquire", "alice").granted, "nothing is kept for who asked the one before"


@pytest.mark.parametrize("op", ["grant", "deny"])
def test_only_the_holder_answers_and_only_who_has_asked(asked: SupervisorHarness, op: Any) -> None:
    for operator, lease, asker in (
        ("bob", asked.lease, "bob"),
        ("alice", "ff" * 16, "bob"),
        ("alice", asked.lease, "carol"),
        ("alice", asked.lease, None),
    ):
        assert not asked.ask(op, operator, lease=lease, requester=asker).done
    assert asked.mode is Mode.DRIVING
    assert asked.supervisor.hand_over.pending_request(asked.now_s) is not None


def test_nobody_asks_for_what_is_free_or_theirs(stage: SupervisorHarness) -> None:
    assert stage.ask("request", "bob").why == because(Code.NO_OPERATOR)
    stage.acquire("bob")
    assert stage.ask("request", "bob").why == because(Code.HAS_CONTROL_ALREADY, holder="bob")


def test_a_take_over_tells_its_reason(stage: SupervisorHarness) -> None:
    stage.acquire("alice")
    stage.acquire("bob", take_over=True, reason=" cat on\nthe track. ")
    assert changes(stage)[-1] == because(
        Code.LEASE_TAKEN_OVER, operator="bob", other="alice", text="cat on the track"
    )


def test_who_asks_and_withdraws_all_the_time_fills_no_log(stage: SupervisorHarness) -> None:
    stage.acquire("alice")
    stage.supervisor.take_events()
    for _ in range(1000):
        stage.ask("request", "bob")
        stage.ask("withdraw", "bob")
    assert len(changes(stage)) == 2


def test_every_stop_by_itself_is_counted_however_short(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    for count in (1, 2):
        assert stage.supervisor.stops == count - 1
        stage.wait(0.21, at_rest=True)
        assert stage.supervisor.stops == count
        assert stage.mode in (Mode.STOPPING, Mode.READY)
        stage.hold(0.04, 1.0)
        assert stage.mode is Mode.DRIVING
