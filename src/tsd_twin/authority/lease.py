"""The right to drive: one holder at a time, on the robot's clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tsd_twin.messages.service import LeaseReply, LeaseRequest
from tsd_twin.robots import Robot

TTL_S = 2.0
"""A lease ends this long after the last counted command or renewal."""


@dataclass(slots=True)
class Lease:
    """One grant."""

    holder: str
    id: bytes
    expires_s: float
    max_age_s: float
    speed_cap_mps: float
    """The later a command may be, the slower the robot may be."""


class LeaseDesk:
    """Grants, renews and ends leases; time and new ids are given, nothing is looked up."""

    def __init__(self, robot: Robot, new_id: Callable[[], bytes]) -> None:
        self._limits = robot.limits
        self._new_id = new_id
        self._lease: Lease | None = None

    def current(self, now_s: float) -> Lease | None:
        """Return the lease in force, if any; an expired one ends here."""
        if self._lease is not None and now_s >= self._lease.expires_s:
            self._lease = None
        return self._lease

    def answer(self, request: LeaseRequest, now_s: float) -> LeaseReply:
        """Return the answer to a request, and act on it."""
        lease = self.current(now_s)
        match request.op:
            case "acquire":
                return self._acquire(request, lease, now_s)
            case "peek":
                return LeaseReply(False, holder=lease.holder if lease else None)
            case "renew" | "release":
                if lease is None or not held_by(lease, request.operator, request.lease):
                    return self._refuse(lease, "this lease is not in force")
                if request.op == "release":
                    self._lease = None
                    return LeaseReply(False, reason="released")
                lease.expires_s = now_s + TTL_S
                return self._granted(lease)

    def renew(self, now_s: float) -> None:
        """Extend the lease in force, because its holder drives."""
        if self._lease is not None:
            self._lease.expires_s = now_s + TTL_S

    def _acquire(self, request: LeaseRequest, lease: Lease | None, now_s: float) -> LeaseReply:
        if lease is not None and not request.take_over:
            return self._refuse(lease, f"{lease.holder} drives; ask for control or take over")
        limits = self._limits
        wanted = limits.max_command_age_s if request.max_age_s is None else request.max_age_s
        if not math.isfinite(wanted):
            return self._refuse(lease, "max_age_s must be a finite number")
        max_age_s = min(max(wanted, limits.max_command_age_s), limits.max_command_age_ceiling_s)
        # What the timeout adds to a punctual command is in the usual limit already.
        late_s = limits.command_timeout_s + max_age_s - limits.max_command_age_s
        cap = speed_cap_mps(limits.deceleration_mps2, late_s, limits.stop_allowance_m)
        if max_age_s <= limits.max_command_age_s:
            cap = limits.speed_mps
        self._lease = Lease(
            holder=request.operator,
            id=self._new_id(),
            expires_s=now_s + TTL_S,
            max_age_s=max_age_s,
            speed_cap_mps=min(cap, limits.speed_mps),
        )
        return self._granted(self._lease)

    def _granted(self, lease: Lease) -> LeaseReply:
        return LeaseReply(True, lease.id.hex(), lease.holder, TTL_S, "", lease.max_age_s)

    def _refuse(self, lease: Lease | None, reason: str) -> LeaseReply:
        return LeaseReply(False, holder=lease.holder if lease else None, reason=reason)


def held_by(lease: Lease | None, operator: str | None, lease_hex: str | None) -> bool:
    """Return whether this operator (any, when None) holds exactly this lease."""
    return (
        lease is not None
        and lease_hex is not None
        and lease.id.hex() == lease_hex
        and operator in (None, lease.holder)
    )


def speed_cap_mps(deceleration_mps2: float, late_s: float, allowed_m: float) -> float:
    """Return the speed from which `late_s` of travel and braking fit into `allowed_m`.

    The positive root of v late + v^2 / (2 a) = d.
    """
    a, t = deceleration_mps2, late_s
    return -a * t + math.sqrt(a * a * t * t + 2.0 * a * allowed_m)
