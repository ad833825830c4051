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


LAX = [
    "127.0.0.1:8080#.evil.example",
    "127.0.0.1:8080?x",
    "127.0.0.1:8080/",
    "127.0.0.1:8080\\",
    "evil@127.0.0.1:8080",
    "evil:x@localhost:8080",
    " 127.0.0.1:8080",
    "127.0.0.1:8080 ",
    "127.0.0.1:8080,127.0.0.1:8080",
    "127.0.0.1:08080",
    "127.0.0.1:+8080",
    "127.0.0.1:8080\t",
    "[127.0.0.1]:8080",
    "[::1%25lo]:8080",
    "[::1%lo]:8080",
    "::1:8080",
    "127.1:8080",
    "0177.0.0.1:8080",
    "localhos\u0074\u0301:8080",
    "\u2113ocalhost:8080",
    "127.0.0.1:\uff18080",
]


@pytest.mark.parametrize("host", LAX)
def test_a_host_has_one_way_to_be_written(host: str) -> None:
    assert refusal(host, None, PORT, (), addresses=True) is not None
    assert refusal(host, f"http://{host}", PORT, (), addresses=True) is not None


SCHEMES = ["file", "chrome-extension", "ftp", "ws", "data", "javascript", "", "HTTP+x"]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_origin_is_of_http_or_https(scheme: str) -> None:
    host = f"127.0.0.1:{PORT}"
    assert refusal(host, f"{scheme}://{host}", PORT, ()) is not None


NAMES = st.sampled_from(
    ["127.0.0.1", "localhost", "LocalHost", "[::1]", "192.0.2.7", "[2001:db8::1]"]
)
INSERTED = st.text("#?/\\@%,; \t\r\n\"'<>&=+*|~^`{}()!$\u00e9\u212a\uff0e", min_size=1, max_size=3)


@given(NAMES, INSERTED, st.integers(0, 40))
def test_no_other_character_fits_into_a_host_or_an_origin(
    name: str, inserted: str, place: int
) -> None:
    host = f"{name}:{PORT}"
    origin = f"http://{host}"
    assert refusal(host, origin, PORT, (), addresses=True) is None
    broken, of_broken = (
        text[: min(place, len(text))] + inserted + text[place:] for text in (host, origin)
    )
    assert refusal(broken, None, PORT, (), addresses=True) is not None
    assert refusal(host, of_broken, PORT, (), addresses=True) is not None


@given(st.text(max_size=12), st.text(max_size=12))
def test_what_surrounds_an_origin_makes_it_another(before: str, after: str) -> None:
    host = f"127.0.0.1:{PORT}"
    origin = f"{before}http://{host}{after}"
    assert (refusal(host, origin, PORT, ()) is None) == (origin == f"http://{host}")


def test_small_letters_of_other_alphabets_are_no_ascii() -> None:
    assert refusal("\u212aiwi.example", None, PORT, ["kiwi.example"]) is not None


def test_the_port_that_https_leaves_out_is_its_own() -> None:
    assert refusal("192.0.2.7", "https://192.0.2.7", 443, (), addresses=True, secure=True) is None
    assert refusal("192.0.2.7", None, 80, (), addresses=True, secure=True) is not None
    assert refusal("192.0.2.7", None, 80, (), addresses=True) is None
