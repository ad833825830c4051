"""Who has opened a page, and by which name they drive."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tsd_twin.errors import TwinError
from tsd_twin.security import LONGEST, BusIdentity, Role
from tsd_twin.security.users import Login, User

DEFAULT_IDENTITY = BusIdentity("web", Role.OPERATOR)
"""Bus identity of a dashboard without a certificate."""


@dataclass(frozen=True, slots=True)
class Principal:
    """Bus identity, stop permission and login of a request."""

    identity: BusIdentity
    """Operator identity on the bus."""
    may_stop: bool
    login: Login | None = None
    """None if no login is required."""

    @property
    def key(self) -> str | None:
        """Id of the login session; when it ends, all sockets of this principal are closed."""
        return None if self.login is None else self.login.id

    @property
    def user(self) -> str | None:
        """Name of the logged-in user."""
        return None if self.login is None else self.login.user.name


def bus_identity_of(user: User, owner: BusIdentity) -> BusIdentity:
    """Return the bus identity for a user of `owner`'s dashboard, with at most the owner's rights.

    With a certificate, the name is `<owner>-<user>`, because access rules let a dashboard use its
    certificate's name and any name that extends it with a dash.

    Raises:
        TwinError: If the combined name is too long.
    """
    if owner == DEFAULT_IDENTITY:
        return BusIdentity(user.name, user.role)
    name = f"{owner.name}-{user.name}"
    if len(name) > LONGEST:
        raise TwinError(f"'{name}' is too long for the bus: {LONGEST} characters are left for both")
    return BusIdentity(name, user.role if owner.role is Role.OPERATOR else Role.VIEWER)


_TYPED_NAME = re.compile(r"[a-z0-9_][a-z0-9_-]*")


def operator_name(principal: Principal, typed: str) -> str:
    """Return the operator name: from the login, or as typed on a page without a login.

    A typed name is not authenticated. If the bus does not permit it, it is ignored, so that a page
    can always connect. With a certificate, the typed name is appended to the dashboard's own name.
    """
    own = principal.identity
    if principal.login is not None or not _TYPED_NAME.fullmatch(typed):
        return own.name
    name = typed if own == DEFAULT_IDENTITY else f"{own.name}-{typed}"
    return name if len(name) <= LONGEST else own.name
