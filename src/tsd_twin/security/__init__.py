"""Network security: certificates, access rules of the bus, users of the dashboard.

Certificates and users are not imported here, because a client needs neither of their packages.
"""

from __future__ import annotations

from tsd_twin.security.access_rules import (
    AUTHORITY,
    LISTEN,
    LONGEST,
    ROBOT,
    ROUTER,
    BusIdentity,
    Role,
    access_control,
    client,
    client_settings,
    robot_settings,
)

__all__ = [
    "AUTHORITY",
    "LISTEN",
    "LONGEST",
    "ROBOT",
    "ROUTER",
    "BusIdentity",
    "Role",
    "access_control",
    "client",
    "client_settings",
    "robot_settings",
]
