"""Lease from the client's point of view: id, renewals, and why it ended. Pure."""

from __future__ import annotations

import math
import statistics
from collections import deque

import msgspec

from tsd_twin.errors import ControlLost, MessageError
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.requests import LeaseReply, LeaseRequest, decode_json, why_of
from tsd_twin.messages.sentences import sentence

RENEW_PERIOD_S = 0.5
"""Renewal period; a lease expires after 2 s."""
_ROUND_TRIPS = 8


class HeldLease:
    """Lease on one robot: granted, renewed, and lost or released."""

    def __init__(self, robot_id: str, operator: str, max_age_s: float) -> None:
        """Prepare for one robot.

        Raises:
            BusError: the name of the operator cannot be part of a bus key.
        """
        self.robot_id = robot_id
        self.operator = topics.checked(operator)
        self.max_age_s = max_age_s
        """Age up to which commands count under this lease."""
        self._lease = b""
        self._granted_s = self._renewed_s = -math.inf
        self.lost_why: Reason | None = None
        """Why the lease ended; None before the first."""
        self._round_trips_s: deque[float] = deque(maxlen=_ROUND_TRIPS)

    @property
    def has_lease(self) -> bool:
        """Whether the lease is held, according to the newest status."""
        return bool(self._lease)

    @property
    def lost_reason(self) -> str:
        """Why the lease ended; "" before the first."""
        return sentence(self.lost_why) if self.lost_why else ""

    @property
    def lease_hex(self) -> str:
        """The lease id, as requests have it.

        Raises:
            ControlLost: the lease is not held.
        """
        self.check_lease()
        return self._lease.hex()

    def grant(self, reply: LeaseReply, now_s: float) -> None:
        """Process the reply that grants the lease."""
        if reply.lease is None:
            raise MessageError("shape", "a granted lease has an id")
        self._lease = bytes.fromhex(reply.lease)
        self._granted_s = self._renewed_s = now_s
        self.lost_why = None
        self.max_age_s = reply.max_age_s

    def release(self) -> None:
        """Record that the lease was released or handed over."""
        self._lose(because(Code.CONTROL_RELEASED))

    def check_lease(self) -> None:
        """Check that the lease is held.

        Raises:
            ControlLost: it is not.
        """
        if not self._lease:
            lost = self.lost_reason or "take it first"
            raise ControlLost(f"no control of {self.robot_id}: {lost}", "no_control", self.lost_why)

    def renewal_is_due(self, now_s: float) -> bool:
        """Return whether a lease is held that has to be renewed."""
        return bool(self._lease) and now_s - self._renewed_s >= RENEW_PERIOD_S

    def renewal(self, now_s: float) -> bytes | None:
        """Return the request that renews the lease, when one is due."""
        if not self.renewal_is_due(now_s):
            return None
        self._renewed_s = now_s
        lease = self._lease.hex()
        return msgspec.json.encode(LeaseRequest(op="renew", operator=self.operator, lease=lease))

    def receive_renewal(self, request: bytes, answer: bytes | None, trip_s: float) -> None:
        """Process the response to a renewal; a missing one is judged by the age of the status."""
        if answer is None or not self._lease:
            return
        asked = decode_json(request, LeaseRequest, "a renewal")
        try:
            reply = decode_json(answer, LeaseReply, "an answer")
        except MessageError:
            return
        if asked.lease != self._lease.hex():
            return  # The answer is about an earlier lease.
        self.add_round_trip(trip_s)
        if not reply.granted:
            self._lose(self._why_not_renewed(reply))

    def add_round_trip(self, seconds: float) -> None:
        """Add a measured round-trip time of a service."""
        self._round_trips_s.append(seconds)

    @property
    def round_trip_s(self) -> float:
        """Median time from a request to its answer; 0 while none is known."""
        return statistics.median(self._round_trips_s) if self._round_trips_s else 0.0

    def _why_not_renewed(self, reply: LeaseReply) -> Reason:
        if reply.holder == self.operator:
            return because(Code.OTHER_CLIENT)
        if reply.holder:
            return because(Code.HAS_CONTROL_NOW, holder=reply.holder)
        return why_of(reply) or because(Code.LEASE_ENDED)

    def _lose(self, why: Reason) -> None:
        self._lease, self.lost_why = b"", why
