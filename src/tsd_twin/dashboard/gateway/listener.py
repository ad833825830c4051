"""The two ports of the dashboard, and the names by which browsers may know each.

The main port serves the page. The viewport's port serves viser's page only, so that its scripts run
in a separate process of the browser and their origin is refused by all routes of the main port.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from aiohttp import web

from tsd_twin.errors import TwinError
from tsd_twin.security.web_access import (
    host_of_origin,
    is_address,
    is_loopback,
    name_of_host,
    origin_refusal,
)


@dataclass(slots=True)
class Listener:
    """A port with the `Host` headers that it accepts."""

    login_redirects: Collection[str] = ()
    """Paths that lead to the login page if nobody is logged in."""
    login_path: str | None = None
    """Path that is served without a login."""
    port: int = 0
    _accepts_addresses: bool = False
    _allowed_hosts: frozenset[str] = frozenset()

    def open(self, host: str, port: int, allowed_hosts: Collection[str]) -> None:
        """Set the address that the server listens on, and further accepted `Host` headers."""
        self.port = port
        self._accepts_addresses = not is_loopback(host)
        names = set(allowed_hosts)
        self._allowed_hosts = frozenset(
            names | {f"{name}:{port}" for name in names if name_of_host(name) == name}
        )

    def refusal(self, host: str | None, origin: str | None, *, secure: bool) -> str | None:
        """Return why a request is refused by its `Host` and `Origin` headers, or None."""
        return origin_refusal(
            host,
            origin,
            self.port,
            self._allowed_hosts,
            addresses=self._accepts_addresses,
            secure=secure,
        )

    def accepts_parent(self, parent: str, host: str, *, secure: bool) -> bool:
        """Return whether a page of origin `parent`, served here, may frame a page at `host`.

        Both need the same name, because a login cookie is sent to one name on all its ports.
        """
        parent_host = host_of_origin(parent)
        if parent_host is None or name_of_host(parent_host) != name_of_host(host):
            return False
        return self.refusal(parent_host, parent, secure=secure) is None


LISTENER = web.AppKey("LISTENER", Listener)
"""Listener of an application."""


def check_viewport_origin(origin: str | None, allowed_hosts: Collection[str]) -> None:
    """Check that the login cookie of the page reaches the viewport.

    Raises:
        TwinError: If the viewport has another name than the page.
    """
    if origin is None:
        return
    name = name_of_host(host_of_origin(origin) or "")
    known = {name_of_host(each.lower()) for each in allowed_hosts}
    if name not in known and not (is_loopback(name) or is_address(name)):
        raise TwinError(
            f"--viewport-origin {origin} has another name than the page, so the login would not "
            "reach it: use a name from --allow-host, with another port"
        )
