"""Network security: certificates, access rules of the bus, users of the dashboard.

Certificates and users are imported at first use, because a client needs neither of their packages.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tsd_twin.security.access_rules import (
    AUTHORITY,
    LISTEN,
    LONGEST,
    ROBOT,
    BusIdentity,
    Role,
    access_control,
    client,
    client_settings,
    robot_settings,
)

if TYPE_CHECKING:
    from tsd_twin.security.certificates import (
        KeyFolder,
        certificate_identity,
        provision,
    )
    from tsd_twin.security.users import Login, Logins, User, Users, refuse_public

_USERS = ("Login", "Logins", "User", "Users", "refuse_public")

__all__ = [
    "AUTHORITY",
    "LISTEN",
    "LONGEST",
    "ROBOT",
    "BusIdentity",
    "KeyFolder",
    "Login",
    "Logins",
    "Role",
    "User",
    "Users",
    "access_control",
    "certificate_identity",
    "client",
    "client_settings",
    "provision",
    "refuse_public",
    "robot_settings",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'tsd_twin.security' has no attribute '{name}'")
    home = "users" if name in _USERS else "certificates"
    value = getattr(importlib.import_module(f"tsd_twin.security.{home}"), name)
    globals()[name] = value
    return value
