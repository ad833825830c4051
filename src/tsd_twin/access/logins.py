"""Who has logged in, for how long, and who may try."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass

from tsd_twin.access.throttle import Allowance, Throttle
from tsd_twin.access.users import User

IDLE_S = 30 * 60.0
"""A login ends when none of its pages has been open, and nothing been asked, for so long."""
ABSOLUTE_S = 12 * 3600.0
"""A login ends after so long in any case."""
_AT_ONCE = 16
"""Logins of one user; with one more, the oldest ends."""


@dataclass(slots=True)
class Login:
    """A user at one browser. Its id is a digest of what the browser's cookie holds."""

    id: str
    user: User
    began_s: float
    used_s: float


class Logins:
    """All methods take the time, in seconds of a clock that never goes back."""

    def __init__(self, *, idle_s: float = IDLE_S, absolute_s: float = ABSOLUTE_S) -> None:
        self._idle_s = idle_s
        self._absolute_s = absolute_s
        self._logins: dict[str, Login] = {}
        # Somebody behind the same address, or who knows a name, shall not lock others out for long.
        self._addresses = Throttle(free=5, first_s=5.0, longest_s=900.0)
        self._names = Throttle(free=10, first_s=10.0, longest_s=300.0)
        # Addresses behind a proxy are what the proxy says, and any process of its machine can pose
        # as one: this bound holds whatever is said.
        self._all = Allowance(at_once=60, every_s=5.0)

    # Trying.

    def wait_s(self, address: str, name: str, now_s: float) -> float:
        """Return how long to wait before the next try; 0 counts the try, until it is `right`."""
        wait_s = max(self._wait_of_all_s(address, now_s), self._names.wait_s(name, now_s))
        if wait_s <= 0.0:
            self._note(address, now_s)
            self._names.note(name, now_s)
        return wait_s

    def wait_nameless_s(self, address: str, now_s: float) -> float:
        """Return how long to wait before the next try; 0 counts one that has no name."""
        wait_s = self._wait_of_all_s(address, now_s)
        if wait_s <= 0.0:
            self._note(address, now_s)
        return wait_s

    def right(self, address: str, name: str) -> None:
        """Note that a try was right. Other tries from the address stay counted."""
        self._all.forgive()
        self._addresses.forgive(address)
        self._names.forget(name)

    def _wait_of_all_s(self, address: str, now_s: float) -> float:
        return max(self._addresses.wait_s(address, now_s), self._all.wait_s(now_s))

    def _note(self, address: str, now_s: float) -> None:
        self._all.note(now_s)
        self._addresses.note(address, now_s)

    # Being logged in.

    def open(self, user: User, now_s: float) -> str:
        """Return the secret of a new login, for the cookie; it is kept nowhere else."""
        own = [login for login in self._logins.values() if login.user.name == user.name]
        for login in own[: max(0, len(own) - _AT_ONCE + 1)]:
            self.close(login.id)
        secret = secrets.token_urlsafe(32)
        login = Login(_digest(secret), user, now_s, now_s)
        self._logins[login.id] = login
        return secret

    def find(self, secret: str | None, now_s: float) -> Login | None:
        """Return the login that a cookie belongs to, if it is good, and note that it is used."""
        # Digests are looked up, so how long it takes says nothing about the secrets.
        login = None if secret is None else self._logins.get(_digest(secret))
        if login is None or self._is_over(login, now_s):
            return None
        login.used_s = now_s
        return login

    def close(self, login_id: str) -> None:
        """End a login."""
        self._logins.pop(login_id, None)

    def sweep(self, used: set[str], now_s: float) -> None:
        """Note which logins have open pages, and end those whose time is over."""
        for login_id in used & self._logins.keys():
            self._logins[login_id].used_s = now_s
        over = [login.id for login in self._logins.values() if self._is_over(login, now_s)]
        for login_id in over:
            self.close(login_id)

    def is_open(self, login_id: str) -> bool:
        """Return whether a login has not ended."""
        return login_id in self._logins

    def _is_over(self, login: Login, now_s: float) -> bool:
        return now_s - login.used_s > self._idle_s or now_s - login.began_s > self._absolute_s


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
