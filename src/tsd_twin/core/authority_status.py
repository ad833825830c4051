"""Who may drive, as the status says it."""

from __future__ import annotations

from tsd_twin.authority import Authority, Lease
from tsd_twin.messages.status import LeaseStatus


def lease_status(authority: Authority, lease: Lease | None, now_s: float) -> LeaseStatus:
    """Return what the status says of the `lease` in force, of who asks and who may have it next."""
    asked = authority.hand_over.asked(now_s) if lease else None
    reserved = authority.hand_over.reserved(now_s)
    return LeaseStatus(
        holder=lease.holder if lease else None,
        remaining_s=round(lease.expires_s - now_s, 3) if lease else 0.0,
        asked_by=asked.operator if asked else None,
        asks_for_s=round(asked.until_s - now_s, 3) if asked else 0.0,
        reserved_for=reserved.operator if reserved else None,
        reserved_s=round(reserved.until_s - now_s, 3) if reserved else 0.0,
    )
