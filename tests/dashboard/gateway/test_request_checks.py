"""Accepted hosts, origins and proxies of requests."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.gateway.auth import ClientAddress, resolve_client_address
from tsd_twin.security.web_access import is_loopback, origin_refusal

SAID = {
    "X-Forwarded-For": "203.0.113.9, 198.51.100.7",
    "X-Forwarded-Proto": "https",
    "X-Forwarded-Prefix": "/twin/",
}


@pytest.mark.parametrize("peer", ["127.0.0.1", "192.0.2.1"])
@pytest.mark.parametrize("tls", [True, False])
def test_without_a_proxy_nothing_that_a_request_says_counts(peer: str, tls: bool) -> None:
    assert resolve_client_address(peer, SAID, tls=tls, proxy=None) == ClientAddress(peer, tls, "/")


@pytest.mark.parametrize(
    ("peer", "proxy"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("::1", "127.0.0.1"),
        ("10.0.0.5", "10.0.0.5"),
        ("::ffff:10.0.0.5", "10.0.0.5"),
    ],
)
def test_the_proxy_is_believed_and_of_addresses_the_one_that_it_added(
    peer: str, proxy: str
) -> None:
    assert resolve_client_address(peer, SAID, tls=False, proxy=proxy) == ClientAddress(
        "198.51.100.7", True, "/twin"
    )


@pytest.mark.parametrize("peer", ["192.0.2.1", "10.0.0.6", "::2", "", "rubbish"])
def test_who_comes_past_the_proxy_is_refused(peer: str) -> None:
    came = resolve_client_address(peer, SAID, tls=True, proxy="10.0.0.5")
    assert isinstance(came, str)
    assert "proxy" in came


@pytest.mark.parametrize("said", [None, "http", "", "HTTPS, http"])
def test_a_proxy_without_tls_is_refused(said: str | None) -> None:
    headers = {} if said is None else {"X-Forwarded-Proto": said}
    assert "TLS" in str(resolve_client_address("127.0.0.1", headers, tls=False, proxy="127.0.0.1"))


@given(st.text(max_size=30))
def test_no_prefix_gets_anything_else_into_the_cookie(prefix: str) -> None:
    came = resolve_client_address(
        "127.0.0.1", SAID | {"X-Forwarded-Prefix": prefix}, tls=False, proxy="127.0.0.1"
    )
    assert isinstance(came, ClientAddress)
    assert came.path.startswith("/")
    assert came.path.isascii()
    assert not set(came.path) & set(" ;,\r\n\t\"'")


def test_the_addresses_of_one_subscriber_are_one() -> None:
    first, second, other = (
        resolve_client_address(peer, {}, tls=False, proxy=None)
        for peer in ("2001:db8::1", "2001:db8::ffff:1", "2001:db8:0:1::1")
    )
    assert first == second != other


@given(st.text(max_size=40))
def test_whatever_comes_before_the_last_address_changes_nothing(made_up: str) -> None:
    said = SAID | {"X-Forwarded-For": f"{made_up}, 198.51.100.7"}
    came = resolve_client_address("127.0.0.1", said, tls=False, proxy="127.0.0.1")
    assert isinstance(came, ClientAddress)
    assert came.address == "198.51.100.7"


@given(st.text(max_size=60))
def test_what_is_no_address_is_one_stranger(said: str) -> None:
    came = resolve_client_address(
        "127.0.0.1", SAID | {"X-Forwarded-For": said}, tls=False, proxy="127.0.0.1"
    )
    assert isinstance(came, ClientAddress)
    assert came.address == "unknown" or set(came.address) <= set("0123456789abcdef.:/")


PORT = 8080


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST", "127.8.9.1", "[::1]"])
def test_the_names_of_this_machine_are_answered(name: str) -> None:
    host = f"{name}:{PORT}"
    assert origin_refusal(host, None, PORT, ()) is None
    assert origin_refusal(host, f"http://{host}", PORT, ()) is None


@pytest.mark.parametrize(
    "host",
    [None, "", "127.0.0.1", "127.0.0.1:8081", "evil.example:8080", "127.0.0.1.evil.example:8080"],
)
def test_other_names_and_ports_are_refused_with_the_address_that_works(host: str | None) -> None:
    reason = origin_refusal(host, None, PORT, ())
    assert reason is not None
    assert f"http://127.0.0.1:{PORT}/" in reason


@pytest.mark.parametrize("host", ["127.0.0.1:x", "[::1:8080", "]:8080", "user@127.0.0.1:8080x"])
def test_a_host_that_is_none_is_refused(host: str) -> None:
    assert origin_refusal(host, None, PORT, ()) is not None


@given(st.text(max_size=40), st.text(max_size=40))
def test_nothing_that_a_client_sends_is_more_than_refused(host: str, origin: str) -> None:
    ours = is_loopback(host.rpartition(":")[0].strip("[]"))
    assert origin_refusal(host, origin, PORT, ()) is not None or ours


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9090", "http://localhost:8080", ""]
)
def test_pages_of_other_origins_are_refused(origin: str) -> None:
    assert origin_refusal(f"127.0.0.1:{PORT}", origin, PORT, ()) is not None


def test_a_name_that_is_allowed_is_answered_to_its_own_pages_only() -> None:
    allowed = ["robot.example"]
    assert origin_refusal("Robot.example", "https://robot.example", PORT, allowed) is None
    assert origin_refusal("robot.example", "https://evil.example", PORT, allowed) is not None
    assert origin_refusal("robot.example:81", None, PORT, allowed) is not None


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
    assert origin_refusal(host, None, PORT, (), addresses=True) is not None
    assert origin_refusal(host, f"http://{host}", PORT, (), addresses=True) is not None


SCHEMES = ["file", "chrome-extension", "ftp", "ws", "data", "javascript", "", "HTTP+x"]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_origin_is_of_http_or_https(scheme: str) -> None:
    host = f"127.0.0.1:{PORT}"
    assert origin_refusal(host, f"{scheme}://{host}", PORT, ()) is not None


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
    assert origin_refusal(host, origin, PORT, (), addresses=True) is None
    broken, of_broken = (
        text[: min(place, len(text))] + inserted + text[place:] for text in (host, origin)
    )
    assert origin_refusal(broken, None, PORT, (), addresses=True) is not None
    assert origin_refusal(host, of_broken, PORT, (), addresses=True) is not None


@given(st.text(max_size=12), st.text(max_size=12))
def test_what_surrounds_an_origin_makes_it_another(before: str, after: str) -> None:
    host = f"127.0.0.1:{PORT}"
    origin = f"{before}http://{host}{after}"
    assert (origin_refusal(host, origin, PORT, ()) is None) == (origin == f"http://{host}")


def test_small_letters_of_other_alphabets_are_no_ascii() -> None:
    assert origin_refusal("\u212aiwi.example", None, PORT, ["kiwi.example"]) is not None


def test_the_port_that_https_leaves_out_is_its_own() -> None:
    assert (
        origin_refusal("192.0.2.7", "https://192.0.2.7", 443, (), addresses=True, secure=True)
        is None
    )
    assert origin_refusal("192.0.2.7", None, 80, (), addresses=True, secure=True) is not None
    assert origin_refusal("192.0.2.7", None, 80, (), addresses=True) is None
