"""Access over a network: keys, certificates, and rules that say who may do what."""

from tsd_twin.access.files import Order, fulfil
from tsd_twin.access.folder import KeyFolder, certificate_identity
from tsd_twin.access.identity import AUTHORITY, ROBOT, Identity, Role, client
from tsd_twin.access.rules import access_control
from tsd_twin.access.settings import LISTEN, client_settings, robot_settings

__all__ = [
    "AUTHORITY",
    "LISTEN",
    "ROBOT",
    "Identity",
    "KeyFolder",
    "Order",
    "Role",
    "access_control",
    "certificate_identity",
    "client",
    "client_settings",
    "fulfil",
    "robot_settings",
]
