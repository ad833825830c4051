"""Who a request comes from."""

from __future__ import annotations

from dataclasses import dataclass

from tsd_twin.access import LONGEST, Identity, Login, Role, User
from tsd_twin.errors import TwinError

ANYBODY = Identity("web", Role.OPERATOR)
"""Whose dashboard it is when no certificate says so."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody whose request is answered."""

    identity: Identity
    """Who they are on the bus."""
    may_stop: bool
    login: Login | None = None
    """None when nobody has to log in."""

    @property
    def key(self) -> str | None:
        """The login whose end ends all that this visitor has open."""
        return None if self.login is None else self.login.id

    @property
    def user(self) -> str | None:
        """The name that was logged in with."""
        return None if self.login is None else self.login.user.name


def identity_of(user: User, owner: Identity) -> Identity:
    """Return who a user of `owner`'s dashboard is on the bus: nobody who may more than the owner.

    A robot with access rules lets a dashboard speak under its own name and what continues that with
    a dash, so with a certificate the name is `<owner>-<user>`.

    Raises:
        TwinError: together the names are too long.
    """
    if owner == ANYBODY:
        return Identity(user.name, user.role)
    name = f"{owner.name}-{user.name}"
    if len(name) > LONGEST:
        raise TwinError(f"'{name}' is too long for the bus: {LONGEST} characters are left for both")
    return Identity(name, user.role if owner.role is Role.OPERATOR else Role.VIEWER)
