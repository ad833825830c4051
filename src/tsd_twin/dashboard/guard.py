"""Who may speak to the gateway: pages that it has served itself, under a name that it knows."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection

_HOST = re.compile(
    r"(?P<name>[a-z0-9](?:[a-z0-9._-]{0,251}[a-z0-9])?|\[(?P<ipv6>[0-9a-f:.]{2,45})\])"
    r"(?::(?P<port>[1-9][0-9]{0,4}))?"
)
"""`name`, `address` or `[IPv6 address]`, each alone or with a port."""
_ORIGIN = re.compile(rf"(?P<scheme>https?)://(?P<host>{_HOST.pattern})")

_SOURCES = {
    "default-src": "'self'",
    # viser unpacks its client in the page itself, compiles WebAssembly and starts workers from
    # blobs; its Plotly widget needs eval.
    "script-src": "'self' 'unsafe-inline' 'unsafe-eval' blob: data:",
    "worker-src": "blob: data:",
    "connect-src": "'self' data: blob:",
    "style-src": "'self' 'unsafe-inline'",
    "img-src": "'self' data: blob:",
    "font-src": "'self' data:",
    "object-src": "'none'",
    "base-uri": "'none'",
    "form-action": "'none'",
    "frame-ancestors": "'none'",
}

HEADERS = {
    "Content-Security-Policy": "; ".join(f"{key} {value}" for key, value in _SOURCES.items()),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "tsd-twin",
}
"""Sent with every answer. A framed page could be clicked through, so nobody may frame it."""


def refusal(
    host: str | None,
    origin: str | None,
    port: int,
    allowed_hosts: Collection[str],
    *,
    addresses: bool = False,
    secure: bool = False,
) -> str | None:
    """Return why a request is refused, by its `Host` and `Origin` headers; None when it is not.

    A page of another site can make a browser speak to this machine, also under a name of its own
    that it points here (DNS rebinding). It can forge neither header. With `addresses` the gateway
    also answers to any address with its port: nobody can point one of those elsewhere. When the
    browser's side is `secure`, a page that came without TLS is another site.
    """
    if host is None or not _is_ours(host, port, allowed_hosts, addresses=addresses, secure=secure):
        return (
            f"This gateway does not answer to the name '{host or ''}': "
            f"open http://127.0.0.1:{port}/ or start it with --allow-host and that name."
        )
    if origin is not None and not _is_page_of(origin, host, secure=secure):
        return f"A page of {origin} may not speak to this gateway."
    return None


def is_loopback(name: str) -> bool:
    """Return whether a host name or address, without port, is this machine for itself only."""
    if name.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def is_address(name: str) -> bool:
    """Return whether a host is an IP address, and no name that somebody could point anywhere."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_ours(
    host: str, port: int, allowed_hosts: Collection[str], *, addresses: bool, secure: bool
) -> bool:
    parts = _HOST.fullmatch(_lower(host))
    if parts is None:
        return False
    if parts[0] in {name.lower() for name in allowed_hosts}:
        return True
    name = parts["ipv6"] or parts["name"]
    known = is_loopback(name) or (addresses and is_address(name))
    if parts["ipv6"] is not None and ":" not in name:  # In brackets stands IPv6 alone.
        return False
    return known and int(parts["port"] or (443 if secure else 80)) == port


def _is_page_of(origin: str, host: str, *, secure: bool) -> bool:
    parts = _ORIGIN.fullmatch(_lower(origin))
    if parts is None or (secure and parts["scheme"] != "https"):
        return False
    return parts["host"] == _lower(host)


def _lower(text: str) -> str:
    """Return ASCII letters as small ones; other characters stay, also those whose small one is."""
    return text.lower() if text.isascii() else text
