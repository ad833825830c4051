"""Network security: certificates, access rules of the bus, users of the dashboard."""

from __future__ import annotations

from tsd_twin.security.access_rules import (
    AUTHORITY,
    LISTEN,
    LONGEST,
    ROBOT,
    Identity,
    Role,
    access_control,
    client,
    client_settings,
    robot_settings,
)
from tsd_twin.security.certificates import (
    CertificateRequest,
    KeyFolder,
    certificate_identity,
    provision,
)
from tsd_twin.security.users import Login, Logins, User, Users, refuse_public

__all__ = [
    "AUTHORITY",
    "LISTEN",
    "LONGEST",
    "ROBOT",
    "CertificateRequest",
    "Identity",
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
