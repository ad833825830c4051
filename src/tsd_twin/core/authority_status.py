"""Who may drive, how fast, and what became of commands, as the status says it."""

from __future__ import annotations

import math

from tsd_twin.authority import Authority, Lease
from tsd_twin.messages.status import CommandStatus, LeaseStatus, LimitStatus
from tsd_twin.robots.robot import Limits


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


def command_status(authority: Authority, now_s: float) -> CommandStatus:
    """Return what the status says of commands: the newest that counted, and how many did not."""
    gate, age_s = authority.gate, now_s - authority.command_s
    return CommandStatus(
        seq=authority.command_seq,
        age_s=round(age_s, 4) if math.isfinite(age_s) else None,
        echo_s=None if gate.echo_s is None else round(gate.echo_s, 4),
        accepted=gate.accepted,
        dropped=gate.dropped,
    )


def limit_status(limits: Limits, lease: Lease | None, applied: float) -> LimitStatus:
    """Return what the status says of the limits under a `lease`; `applied` is a share."""
    share = lease.speed_cap_mps / limits.speed_mps if lease else 1.0
    return LimitStatus(
        speed_mps=limits.speed_mps * share,
        turn_rate_rad_per_s=limits.turn_rate_rad_per_s * share,
        max_command_age_s=lease.max_age_s if lease else limits.max_command_age_s,
        applied=round(applied, 3),
    )
