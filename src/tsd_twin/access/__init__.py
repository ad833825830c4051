"""Access over a network: who may do what, and how each proves who it is."""

from tsd_twin.access.files import Order, fulfil
from tsd_twin.access.folder import KeyFolder, certificate_identity
from tsd_twin.access.identity import AUTHORITY, LONGEST, ROBOT, Identity, Role, client
from tsd_twin.access.logins import Login, Logins
from tsd_twin.access.private import refuse_public
from tsd_twin.access.rules import access_control
from tsd_twin.access.settings import LISTEN, client_settings, robot_settings
from tsd_twin.access.users import User, Users

__all__ = [
    "AUTHORITY",
    "LISTEN",
    "LONGEST",
    "ROBOT",
    "Identity",
    "KeyFolder",
    "Login",
    "Logins",
    "Order",
    "Role",
    "User",
    "Users",
    "access_control",
    "certificate_identity",
    "client",
    "client_settings",
    "fulfil",
    "refuse_public",
    "robot_settings",
]
