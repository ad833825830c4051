"""Only a proxy that was named is believed what it says of the browser."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.approach import Approach, approach

SAID = {
    "X-Forwarded-For": "203.0.113.9, 198.51.100.7",
    "X-Forwarded-Proto": "https",
    "X-Forwarded-Prefix": "/twin/",
}


@pytest.mark.parametrize("peer", ["127.0.0.1", "192.0.2.1"])
@pytest.mark.parametrize("tls", [True, False])
def test_without_a_proxy_nothing_that_a_request_says_counts(peer: str, tls: bool) -> None:
    assert approach(peer, SAID, tls=tls, proxy=None) == Approach(peer, tls, "/")


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
    assert approach(peer, SAID, tls=False, proxy=proxy) == Approach("198.51.100.7", True, "/twin")


@pytest.mark.parametrize("peer", ["192.0.2.1", "10.0.0.6", "::2", "", "rubbish"])
def test_who_comes_past_the_proxy_is_refused(peer: str) -> None:
    came = approach(peer, SAID, tls=True, proxy="10.0.0.5")
    assert isinstance(came, str)
    assert "proxy" in came


@pytest.mark.parametrize("said", [None, "http", "", "HTTPS, http"])
def test_a_proxy_without_tls_is_refused(said: str | None) -> None:
    headers = {} if said is None else {"X-Forwarded-Proto": said}
    assert "TLS" in str(approach("127.0.0.1", headers, tls=False, proxy="127.0.0.1"))


@given(st.text(max_size=30))
def test_no_prefix_gets_anything_else_into_the_cookie(prefix: str) -> None:
    came = approach(
        "127.0.0.1", SAID | {"X-Forwarded-Prefix": prefix}, tls=False, proxy="127.0.0.1"
    )
    assert isinstance(came, Approach)
    assert came.path.startswith("/")
    assert came.path.isascii()
    assert not set(came.path) & set(" ;,\r\n\t\"'")


def test_the_addresses_of_one_subscriber_are_one() -> None:
    first, second, other = (
        approach(peer, {}, tls=False, proxy=None)
        for peer in ("2001:db8::1", "2001:db8::ffff:1", "2001:db8:0:1::1")
    )
    assert first == second != other


@given(st.text(max_size=40))
def test_whatever_comes_before_the_last_address_changes_nothing(made_up: str) -> None:
    said = SAID | {"X-Forwarded-For": f"{made_up}, 198.51.100.7"}
    came = approach("127.0.0.1", said, tls=False, proxy="127.0.0.1")
    assert isinstance(came, Approach)
    assert came.address == "198.51.100.7"


@given(st.text(max_size=60))
def test_what_is_no_address_is_one_stranger(said: str) -> None:
    came = approach("127.0.0.1", SAID | {"X-Forwarded-For": said}, tls=False, proxy="127.0.0.1")
    assert isinstance(came, Approach)
    assert came.address == "unknown" or set(came.address) <= set("0123456789abcdef.:/")
