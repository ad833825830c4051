"""Lease: the exclusive, time-limited right to drive, on the robot's clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import LeaseReply, LeaseRequest
from tsd_twin.robots import RobotDescription

REQUEST_TIMEOUT_S = 15.0
"""Timeout of an unanswered request for the lease."""
RESERVATION_S = 3.0
"""Time after a grant during which the lease is reserved for the requester."""
DENIED_S = 5.0
"""Minimum time before a denied operator may request again."""


@dataclass(frozen=True, slots=True)
class LeaseClaim:
    """Pending request or reservation of an operator, with an expiry time."""

    operator: str
    until_s: float


class LeaseHandover:
    """Handover of the lease between operators, with at most one pending request.

    A request alone has no effect. A grant ends the holder's lease and reserves the next one for the
    requester, who then acquires it as usual. This keeps the new lease id private, and the active
    holder always knows about the handover.
    """

    def __init__(self) -> None:
        self._pending: LeaseClaim | None = None
        self._reserved: LeaseClaim | None = None
        self._denied: LeaseClaim | None = None

    def pending_request(self, now_s: float) -> LeaseClaim | None:
        """Return the pending request for control, if any."""
        self._pending = _still_valid(self._pending, now_s)
        return self._pending

    def reservation(self, now_s: float) -> LeaseClaim | None:
        """Return the reservation of the next lease, if any."""
        self._reserved = _still_valid(self._reserved, now_s)
        return self._reserved

    def request_control(self, operator: str, now_s: float) -> Reason | None:
        """Request control; return why it is refused, or None. Requests are idempotent."""
        asked = self.pending_request(now_s)
        self._denied = _still_valid(self._denied, now_s)
        if self._denied is not None and self._denied.operator == operator:
            return because(Code.DENIED_LATELY, s=round(self._denied.until_s - now_s))
        if asked is not None and asked.operator != operator:
            return because(Code.OTHER_REQUEST, asker=asked.operator)
        if asked is None:
            self._pending = LeaseClaim(operator, now_s + REQUEST_TIMEOUT_S)
        return None

    def withdraw(self, operator: str, now_s: float) -> Reason | None:
        """Withdraw a request or a reservation; return why it is refused, or None."""
        asked, reserved = self.pending_request(now_s), self.reservation(now_s)
        if asked is not None and asked.operator == operator:
            self._pending = None
        elif reserved is not None and reserved.operator == operator:
            # The grant crossed the withdrawal: free the reservation for other operators.
            self._reserved = None
        else:
            return because(Code.NO_REQUEST_OF, operator=operator)
        return None

    def deny(self, asker: str | None, now_s: float) -> Reason | None:
        """Deny the request of `asker`; return why it is refused, or None."""
        if refusal := self._requester_mismatch(asker, now_s):
            return refusal
        self._pending, self._denied = None, LeaseClaim(asker or "", now_s + DENIED_S)
        return None

    def grant(self, asker: str | None, now_s: float) -> Reason | None:
        """Reserve the next lease for `asker`; return why it is refused, or None."""
        if refusal := self._requester_mismatch(asker, now_s):
            return refusal
        self._pending, self._reserved = None, LeaseClaim(asker or "", now_s + RESERVATION_S)
        return None

    def end(self) -> None:
        """Clear all claims after the lease has ended or changed hands."""
        self._pending = self._reserved = self._denied = None

    def _requester_mismatch(self, asker: str | None, now_s: float) -> Reason | None:
        asked = self.pending_request(now_s)
        if asked is None:
            return because(Code.NO_REQUEST)
        # Another operator may have requested since the holder decided.
        return None if asked.operator == asker else because(Code.REQUEST_OF, asker=asked.operator)


def _still_valid(claim: LeaseClaim | None, now_s: float) -> LeaseClaim | None:
    return claim if claim is not None and now_s < claim.until_s else None


TTL_S = 2.0
"""Lease timeout after the last accepted command or renewal."""
REACTION_S = 0.02
"""Reaction time: one control period to detect the timeout, one to command zero."""


@dataclass(slots=True)
class Lease:
    """Lease granted to an operator."""

    holder: str
    id: bytes
    expires_s: float
    max_age_s: float
    speed_cap_mps: float
    """Speed limit under this lease; decreases with `max_age_s`."""
    timeout_s: float
    """Command timeout after arrival, capped at `max_age_s` after the echoed status was sent.
    Longer for slow links, where gaps between commands can be as long as the delay."""


class LeaseManager:
    """Grants, renews and ends leases; time and new ids are passed in."""

    def __init__(self, robot: RobotDescription, new_id: Callable[[], bytes]) -> None:
        self._robot = robot
        self._new_id = new_id
        self._lease: Lease | None = None
        self.hand_over = LeaseHandover()

    def current(self, now_s: float) -> Lease | None:
        """Return the active lease, if any; ends an expired one."""
        if self._lease is not None and now_s >= self._lease.expires_s:
            self._end()
        return self._lease

    def answer(self, request: LeaseRequest, now_s: float) -> LeaseReply:
        """Process a request and return the reply."""
        lease = self.current(now_s)
        match request.op:
            case "acquire":
                return self._acquire(request, lease, now_s)
            case "peek":
                return LeaseReply(False, holder=lease.holder if lease else None)
            case "request":
                return self._request(request, lease, now_s)
            case "withdraw":
                refusal = self.hand_over.withdraw(request.operator, now_s)
                return self._done(lease, refusal, because(Code.WITHDRAWN))
            case "renew" | "release" | "grant" | "deny":
                if lease is None or not is_held_by(lease, request.operator, request.lease):
                    return self._refuse(lease, because(Code.LEASE_NOT_IN_FORCE))
                return self._handle_holder_request(request, lease, now_s)

    def _handle_holder_request(
        self, request: LeaseRequest, lease: Lease, now_s: float
    ) -> LeaseReply:
        hand_over = self.hand_over
        match request.op:
            case "release":
                # Releasing the lease grants the pending request.
                if (asked := hand_over.pending_request(now_s)) is not None:
                    hand_over.grant(asked.operator, now_s)
                    self._lease = None
                else:
                    self._end()
                return self._done(None, None, because(Code.RELEASED))
            case "grant":
                refusal = hand_over.grant(request.requester, now_s)
                if not refusal:
                    self._lease = None
                reserved = because(Code.RESERVED, operator=request.requester or "")
                return self._done(self._lease, refusal, reserved)
            case "deny":
                refusal = hand_over.deny(request.requester, now_s)
                return self._done(lease, refusal, because(Code.CONTROL_KEPT))
            case _:
                lease.expires_s = now_s + TTL_S
                return self._granted(lease)

    def _request(self, request: LeaseRequest, lease: Lease | None, now_s: float) -> LeaseReply:
        if lease is None:
            return self._refuse(lease, because(Code.NO_OPERATOR))
        if lease.holder == request.operator:
            return self._refuse(lease, because(Code.HAS_CONTROL_ALREADY, holder=lease.holder))
        refusal = self.hand_over.request_control(request.operator, now_s)
        return self._done(lease, refusal, because(Code.HOLDER_ASKED, holder=lease.holder))

    def acquire_refusal(
        self, operator: str | None, now_s: float, *, take_over: bool
    ) -> Reason | None:
        """Why `operator` cannot acquire the lease now, or None.

        None is an operator for whom no lease is reserved.
        """
        reserved, lease = self.hand_over.reservation(now_s), self.current(now_s)
        if reserved is not None and reserved.operator != operator:
            return because(Code.RESERVED_FOR, operator=reserved.operator)
        if lease is not None and not take_over:
            return because(Code.DRIVEN_BY, holder=lease.holder)
        return None

    def _end(self) -> None:
        self._lease = None
        self.hand_over.end()

    def renew(self, now_s: float) -> None:
        """Extend the active lease after an accepted command."""
        if self._lease is not None:
            self._lease.expires_s = now_s + TTL_S

    def _acquire(self, request: LeaseRequest, lease: Lease | None, now_s: float) -> LeaseReply:
        if refusal := self.acquire_refusal(request.operator, now_s, take_over=request.take_over):
            return self._refuse(lease, refusal)
        limits = self._robot.limits
        wanted = limits.max_command_age_s if request.max_age_s is None else request.max_age_s
        if not math.isfinite(wanted):
            return self._refuse(lease, because(Code.NOT_FINITE, quantity="max_age_s"))
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

    def _done(self, lease: Lease | None, refusal: Reason | None, done: Reason) -> LeaseReply:
        """Return the reply to a request that does not grant a lease."""
        if refusal is not None:
            return self._refuse(lease, refusal)
        holder = lease.holder if lease else None
        return LeaseReply(False, holder=holder, reason=sentence(done), done=True, why=done)

    def _refuse(self, lease: Lease | None, why: Reason) -> LeaseReply:
        holder = lease.holder if lease else None
        return LeaseReply(False, holder=holder, reason=sentence(why), why=why)


def is_held_by(lease: Lease | None, operator: str | None, lease_hex: str | None) -> bool:
    """Return whether `operator` (None for any) holds exactly this lease."""
    return (
        lease is not None
        and lease_hex is not None
        and lease.id.hex() == lease_hex
        and operator in (None, lease.holder)
    )


def speed_cap_mps(robot: RobotDescription, max_age_s: float) -> float:
    """Return the top speed that keeps the stopping distance within `limits.stop_allowance_m`.

    After a link failure, commands stay valid until `max_age_s` after the last delivered status.
    Braking then starts after the reaction time of the loop and the actuator lag.
    """
    limits = robot.limits
    late_s = max_age_s + REACTION_S + robot.lag_s + robot.delay_s
    cap_mps = max_speed_for_distance(limits.deceleration_mps2, late_s, limits.stop_allowance_m)
    return min(cap_mps, limits.speed_mps)


def max_speed_for_distance(deceleration_mps2: float, late_s: float, allowed_m: float) -> float:
    """Return the speed in m/s from which a robot stops within `allowed_m`.

    It travels for `late_s` before braking: the positive root of v late + v^2 / (2 a) = d.
    """
    a, t = deceleration_mps2, late_s
    return -a * t + math.sqrt(a * a * t * t + 2.0 * a * allowed_m)


class LeaseEvents:
    """Reasons for events of lease changes: requests, hand-overs, and claims that expire."""

    def __init__(self, leases: LeaseManager) -> None:
        self._leases = leases
        self._holder = ""
        self._pending: LeaseClaim | None = None
        self._reserved: LeaseClaim | None = None

    def after(self, request: LeaseRequest, before: Lease | None, now_s: float) -> Reason | None:
        """Reason for the event of a request, None when it changed nothing."""
        asked, after = self._pending, self._leases.current(now_s)
        self._update(now_s)
        if after is not before:
            return self._change_event(request, before, after)
        if request.op == "deny" and asked is not None and self._pending is None:
            return because(Code.REQUEST_DENIED, operator=request.operator, asker=asked.operator)
        if request.op == "withdraw" and asked is not None and self._pending is None:
            return because(Code.REQUEST_WITHDRAWN, operator=asked.operator)
        if self._pending is not None and self._pending is not asked:
            asker = self._pending.operator
            return because(Code.CONTROL_REQUESTED, operator=asker, holder=self._holder)
        return None

    def expiry_event(self, now_s: float) -> Reason | None:
        """Reason for the event of a lease or claim that has expired, None when none has."""
        holder, asked, reserved = self._holder, self._pending, self._reserved
        self._update(now_s)
        if holder and not self._holder:
            return because(Code.LEASE_EXPIRED, operator=holder)
        if asked is not None and self._pending is None:
            return because(Code.REQUEST_EXPIRED, holder=holder, asker=asked.operator)
        if reserved is not None and self._reserved is None:
            return because(Code.RESERVATION_EXPIRED, operator=reserved.operator)
        return None

    def _update(self, now_s: float) -> None:
        lease = self._leases.current(now_s)
        self._holder = lease.holder if lease else ""
        self._pending = self._leases.hand_over.pending_request(now_s)
        self._reserved = self._leases.hand_over.reservation(now_s)

    def _change_event(
        self, request: LeaseRequest, before: Lease | None, after: Lease | None
    ) -> Reason:
        if after is None:
            giver = before.holder if before else ""
            if self._reserved is not None:
                asker = self._reserved.operator
                return because(Code.LEASE_HANDED_OVER, operator=giver, other=asker)
            return because(Code.LEASE_RELEASED, operator=giver)
        if before is None or before.holder == after.holder:
            return because(Code.LEASE_GRANTED, operator=after.holder)
        text = " ".join(request.reason.split()).rstrip(".")
        return because(
            Code.LEASE_TAKEN_OVER,
            operator=after.holder,
            other=before.holder,
            **({"text": text} if text else {}),
        )
