"""How a request comes to the gateway: straight from a browser, or by a proxy that is trusted."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass

from tsd_twin.dashboard.guard import is_loopback

FORWARDED = ("X-Forwarded-For", "X-Forwarded-Proto", "X-Forwarded-Prefix")
"""Headers by which a proxy says how a browser came to it."""
_PREFIX = re.compile(r"(/[A-Za-z0-9._~-]+)*")


@dataclass(frozen=True, slots=True)
class Approach:
    """What the browser's side of a request is like."""

    address: str
    """Whom too many wrong passwords are counted against; of IPv6, the network."""
    secure: bool
    """Whether it came by TLS."""
    path: str
    """Where the pages of this gateway are, as the browser sees it; for its cookie."""


def approach(
    peer: str, headers: Mapping[str, str], *, tls: bool, proxy: str | None
) -> Approach | str:
    """Return how a request came, or why it should not have come so.

    `peer` is the address at the other end, `proxy` that of the proxy through which all requests
    have to come, if there is one. What a request says about where it came from counts only then:
    anybody can write it. A header that came several times is given once, joined by commas.
    """
    if proxy is None:
        return Approach(network(peer), tls, "/")
    if not is_proxy(peer, proxy):
        return "Requests come through the proxy in front of this gateway."
    if headers.get("X-Forwarded-Proto") != "https":
        return "The proxy has to speak TLS to browsers and to say so: X-Forwarded-Proto: https."
    # Each proxy adds what it saw at the end, some of them as one more header; before that may stand
    # whatever a browser made up.
    seen = headers.get("X-Forwarded-For", peer).rpartition(",")[2].strip()
    prefix = headers.get("X-Forwarded-Prefix", "").rstrip("/")
    path = prefix if prefix and _PREFIX.fullmatch(prefix) else "/"
    return Approach(network(seen), secure=True, path=path)


def is_proxy(peer: str, proxy: str | None) -> bool:
    """Return whether a peer is the proxy, or on the machine of the gateway and may be it."""
    return proxy is not None and (is_loopback(peer) or _same(peer, proxy))


def _same(peer: str, proxy: str) -> bool:
    try:
        return _plain(peer) == _plain(proxy)
    except ValueError:
        return False


def network(address: str) -> str:
    """Return an address; of IPv6, the network that one subscriber has all addresses of."""
    try:
        parsed = _plain(address)
    except ValueError:
        return "unknown"
    if parsed.version == 4:
        return str(parsed)
    return str(ipaddress.ip_network((parsed, 64), strict=False))


def _plain(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    parsed = ipaddress.ip_address(address)
    mapped = parsed.ipv4_mapped if parsed.version == 6 else None
    return mapped or parsed
