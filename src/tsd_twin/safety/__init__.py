"""Safety rules as pure state machines: supervisor, lease, command gate, modes."""

from __future__ import annotations

from tsd_twin.messages.modes import ARMED, LATCHED, Mode
from tsd_twin.safety.lease import Lease
from tsd_twin.safety.supervisor import TRANSITIONS, Heartbeat, SafetySupervisor

__all__ = [
    "ARMED",
    "LATCHED",
    "TRANSITIONS",
    "Heartbeat",
    "Lease",
    "Mode",
    "SafetySupervisor",
]
