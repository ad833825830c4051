"""Display names from requests, which a robot repeats to all clients."""

from __future__ import annotations

from tests.safety.supervisor_harness import SupervisorHarness
from tsd_twin.messages.services import LeaseRequest, StopRequest, decode_request
from tsd_twin.safety import SafetySupervisor


def names(supervisor: SafetySupervisor) -> dict[str, str]:
    return dict(supervisor.operators.by_id)


def test_the_holder_and_the_one_who_asks_are_named(stage: SupervisorHarness) -> None:
    stage.acquire("alice", name="Алиса")
    stage.ask("request", "bob", name="王小明")
    assert names(stage.supervisor) == {"alice": "Алиса", "bob": "王小明"}


def test_a_holder_who_renews_control_can_change_the_name(stage: SupervisorHarness) -> None:
    lease = stage.acquire("alice", name="Ann")
    stage.ask("renew", lease=lease, name="Anna")
    assert names(stage.supervisor) == {"alice": "Anna"}


def test_a_refused_request_names_nobody(stage: SupervisorHarness) -> None:
    stage.acquire("alice", name="Anna")
    for op in ("acquire", "renew", "request", "release", "grant", "withdraw", "peek"):
        stage.ask(op, "alice", name="Mallory")
    stage.ask("acquire", "carol", name="Carol")
    assert names(stage.supervisor) == {"alice": "Anna"}


def test_a_stop_names_its_operator_but_renames_nobody(stage: SupervisorHarness) -> None:
    stage.acquire("alice", name="Anna")
    for operator, name in (("alice", "Mallory"), ("bob", "Боб"), ("", "nobody")):
        stage.supervisor.stop(StopRequest(operator, name=name), stage.now_s)
    assert names(stage.supervisor) == {"alice": "Anna", "bob": "Боб"}


def test_requests_without_a_name_are_those_of_older_clients(stage: SupervisorHarness) -> None:
    old = decode_request(b'{"op": "acquire", "operator": "alice"}', LeaseRequest)
    assert stage.supervisor.lease(old, stage.now_s).granted
    assert names(stage.supervisor) == {}
