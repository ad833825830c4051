"""Who has opened a page, and by which name they drive."""

from __future__ import annotations

from dataclasses import dataclass

from tsd_twin.errors import TwinError
from tsd_twin.messages.names import display_name, id_of_name
from tsd_twin.security import LONGEST, BusIdentity, Role
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights
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
    rights: RobotRights = EVERY_ROBOT
    """Robots that the pages may use and show."""

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


def operator_name(principal: Principal, typed: str) -> str:
    """Return the name within the operator id: from the login or the certificate, else as typed.

    A typed name is not authenticated: with a certificate, whose key signs for its own name only,
    it is just shown. If ids cannot spell it, they have the dashboard's own name.
    """
    own = principal.identity
    if principal.login is not None or own != DEFAULT_IDENTITY:
        return own.name
    return id_of_name(typed) or own.name


def shown_name(principal: Principal, typed: str) -> str:
    """Return the display name of an operator: that of the login, or as typed, or ""."""
    return display_name(principal.user or typed)
