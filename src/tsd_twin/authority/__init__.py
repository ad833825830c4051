"""Command gate, lease, modes and latched stop: a pure state machine."""

from tsd_twin.authority.authority import Authority, Facts
from tsd_twin.authority.lease import Lease
from tsd_twin.authority.mandate import Mandate
from tsd_twin.authority.modes import ARMED, LATCHED, TRANSITIONS, Mode

__all__ = ["ARMED", "LATCHED", "TRANSITIONS", "Authority", "Facts", "Lease", "Mandate", "Mode"]
