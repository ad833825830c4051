"""Network emulation between two programs: delay, jitter, loss, reordering, stalls, limited rate."""

from __future__ import annotations

from tsd_twin.link_emulation.emulator import LinkEmulator
from tsd_twin.link_emulation.link import Counters
from tsd_twin.link_emulation.spec import PROFILES, LinkError, LinkSpec, Stall, Wander

__all__ = ["PROFILES", "Counters", "LinkEmulator", "LinkError", "LinkSpec", "Stall", "Wander"]
