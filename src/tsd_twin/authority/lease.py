"""The right to drive: one holder at a time, on the robot's clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tsd_twin.authority.hand_over import HandOver
from tsd_twin.messages.service import LeaseReply, LeaseRequest
from tsd_twin.robots import Robot

TTL_S = 2.0
"""A lease ends this long after the last counted command or renewal."""
REACTION_S = 0.02
"""Two control periods: one until the age of a command is noticed, one until the joints get zero."""


@dataclass(slots=True)
class Lease:
    """One grant."""

    holder: str
    id: bytes
    expires_s: float
    max_age_s: float
    speed_cap_mps: float
    """The later a command may be, the slower the robot may be."""
    timeout_s: float
    """A command stands this long after its arrival, and never longer than `max_age_s` after the
    status was sent that it echoes. A lease for late commands has a longer one: on a slow link gaps
    can be as long as the delay.
    """


class LeaseDesk:
    """Grants, renews and ends leases; time and new ids are given, nothing is looked up."""

    def __init__(self, robot: Robot, new_id: Callable[[], bytes]) -> None:
        self._robot = robot
        self._new_id = new_id
        self._lease: Lease | None = None
        self.hand_over = HandOver()

    def current(self, now_s: float) -> Lease | None:
        """Return the lease in force, if any; an expired one ends here."""
        if self._lease is not None and now_s >= self._lease.expires_s:
            self._end()
        return self._lease

    def answer(self, request: LeaseRequest, now_s: float) -> LeaseReply:
        """Return the answer to a request, and act on it."""
        lease = self.current(now_s)
        match request.op:
            case "acquire":
                return self._acquire(request, lease, now_s)
            case "peek":
                return LeaseReply(False, holder=lease.holder if lease else None)
            case "request":
                return self._request(request, lease, now_s)
            case "withdraw":
                return self._done(
                    lease, self.hand_over.withdraw(request.operator, now_s), "withdrawn"
                )
            case "renew" | "release" | "grant" | "keep":
                if lease is None or not held_by(lease, request.operator, request.lease):
                    return self._refuse(lease, "this lease is not in force")
                return self._of_holder(request, lease, now_s)

    def _of_holder(self, request: LeaseRequest, lease: Lease, now_s: float) -> LeaseReply:
        hand_over = self.hand_over
        match request.op:
            case "release":
                # Who is asked and lets go has answered.
                if (asked := hand_over.asked(now_s)) is not None:
                    hand_over.grant(asked.operator, now_s)
                    self._lease = None
                else:
                    self._end()
                return LeaseReply(False, reason="released", done=True)
            case "grant":
                refusal = hand_over.grant(request.asker, now_s)
                if not refusal:
                    self._lease = None
                return self._done(self._lease, refusal, f"control is kept for {request.asker}")
            case "keep":
                return self._done(lease, hand_over.keep(request.asker, now_s), "control is kept")
            case _:
                lease.expires_s = now_s + TTL_S
                return self._granted(lease)

    def _request(self, request: LeaseRequest, lease: Lease | None, now_s: float) -> LeaseReply:
        if lease is None:
            return self._refuse(lease, "nobody has control: acquire it")
        if lease.holder == request.operator:
            return self._refuse(lease, f"{lease.holder} has control already")
        refusal = self.hand_over.ask(request.operator, now_s)
        return self._done(lease, refusal, f"{lease.holder} is asked")

    def _end(self) -> None:
        self._lease = None
        self.hand_over.end()

    def renew(self, now_s: float) -> None:
        """Extend the lease in force, because its holder drives."""
        if self._lease is not None:
            self._lease.expires_s = now_s + TTL_S

    def _acquire(self, request: LeaseRequest, lease: Lease | None, now_s: float) -> LeaseReply:
        reserved = self.hand_over.reserved(now_s)
        if reserved is not None and reserved.operator != request.operator:
            return self._refuse(lease, f"control is kept for {reserved.operator}, for a moment")
        if lease is not None and not request.take_over:
            return self._refuse(lease, f"{lease.holder} drives; ask for control or take over")
        limits = self._robot.limits
        wanted = limits.max_command_age_s if request.max_age_s is None else request.max_age_s
        if not math.isfinite(wanted):
            return self._refuse(lease, "max_age_s must be a finite number")
        max_age_s = min(max(wanted, limits.max_command_age_s), limits.max_command_age_ceiling_s)
        self._end()
        self._lease = Lease(
            holder=request.operator,
            id=self._new_id(),
            expires_s=now_s + TTL_S,
            max_age_s=max_age_s,
            speed_cap_mps=speed_cap_mps(self._robot, max_age_s),
            timeout_s=limits.command_timeout_s + max_age_s - limits.max_command_age_s,
        )
        return self._granted(self._lease)

    def _granted(self, lease: Lease) -> LeaseReply:
        return LeaseReply(True, lease.id.hex(), lease.holder, TTL_S, "", lease.max_age_s, done=True)

    def _done(self, lease: Lease | None, refusal: str, what: str) -> LeaseReply:
        """Return the answer to what grants no lease by itself."""
        if refusal:
            return self._refuse(lease, refusal)
        return LeaseReply(False, holder=lease.holder if lease else None, reason=what, done=True)

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


def speed_cap_mps(robot: Robot, max_age_s: float) -> float:
    """Top speed from which a robot keeps to `limits.stop_allowance_m`, whatever way its link fails.

    Commands may move it until `max_age_s` after the last status that got through. Then it brakes,
    later by the reaction of the control loop and by the lag of its joints.
    """
    limits = robot.limits
    late_s = max_age_s + REACTION_S + robot.lag_s + robot.delay_s
    cap_mps = speed_within(limits.deceleration_mps2, late_s, limits.stop_allowance_m)
    return min(cap_mps, limits.speed_mps)


def speed_within(deceleration_mps2: float, late_s: float, allowed_m: float) -> float:
    """Speed in m/s from which `late_s` of travel and then braking take `allowed_m`.

    The positive root of v late + v^2 / (2 a) = d.
    """
    a, t = deceleration_mps2, late_s
    return -a * t + math.sqrt(a * a * t * t + 2.0 * a * allowed_m)
