"""Who may drive, how fast, and what became of commands, as the status says it."""

from __future__ import annotations

import math

from tsd_twin.authority import Authority, Lease
from tsd_twin.authority.lease import speed_cap_mps
from tsd_twin.messages.status import CommandStatus, LeaseStatus, LimitStatus
from tsd_twin.robots import Robot


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


def limit_status(robot: Robot, lease: Lease | None, applied: float) -> LimitStatus:
    """Limits under a `lease`, or under that of a default request; `applied` is a share."""
    limits = robot.limits
    max_age_s = lease.max_age_s if lease else limits.max_command_age_s
    cap_mps = lease.speed_cap_mps if lease else speed_cap_mps(robot, max_age_s)
    return LimitStatus(
        speed_mps=cap_mps,
        turn_rate_rad_per_s=limits.turn_rate_rad_per_s * cap_mps / limits.speed_mps,
        max_command_age_s=max_age_s,
        stop_allowance_m=limits.stop_allowance_m,
        applied=round(applied, 3),
    )
