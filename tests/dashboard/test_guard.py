"""Only pages that the gateway has served itself may speak to it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.guard import is_loopback, refusal

PORT = 8080


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST", "127.8.9.1", "[::1]"])
def test_the_names_of_this_machine_are_answered(name: str) -> None:
    host = f"{name}:{PORT}"
    assert refusal(host, None, PORT, ()) is None
    assert refusal(host, f"http://{host}", PORT, ()) is None


@pytest.mark.parametrize(
    "host",
    [None, "", "127.0.0.1", "127.0.0.1:8081", "evil.example:8080", "127.0.0.1.evil.example:8080"],
)
def test_other_names_and_ports_are_refused_with_the_address_that_works(host: str | None) -> None:
    reason = refusal(host, None, PORT, ())
    assert reason is not None
    assert f"http://127.0.0.1:{PORT}/" in reason


@pytest.mark.parametrize("host", ["127.0.0.1:x", "[::1:8080", "]:8080", "user@127.0.0.1:8080x"])
def test_a_host_that_is_none_is_refused(host: str) -> None:
    assert refusal(host, None, PORT, ()) is not None


@given(st.text(max_size=40), st.text(max_size=40))
def test_nothing_that_a_client_sends_is_more_than_refused(host: str, origin: str) -> None:
    ours = is_loopback(host.rpartition(":")[0].strip("[]"))
    assert refusal(host, origin, PORT, ()) is not None or ours


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9090", "http://localhost:8080", ""]
)
def test_pages_of_other_origins_are_refused(origin: str) -> None:
    assert refusal(f"127.0.0.1:{PORT}", origin, PORT, ()) is not None


def test_a_name_that_is_allowed_is_answered_to_its_own_pages_only() -> None:
    allowed = ["robot.example"]
    assert refusal("Robot.example", "https://robot.example", PORT, allowed) is None
    assert refusal("robot.example", "https://evil.example", PORT, allowed) is not None
    assert refusal("robot.example:81", None, PORT, allowed) is not None
