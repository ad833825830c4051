"""Client-side lease: id, renewals and reason of loss (pure)."""

from __future__ import annotations

import math
import statistics
from collections import deque

import msgspec

from tsd_twin.client.errors import ControlLost
from tsd_twin.client.lease_signing import LeaseSigning
from tsd_twin.messages import topics
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import LeaseReply, LeaseRequest, decode_json
from tsd_twin.messages.topics import Service

RENEW_PERIOD_S = 0.5
"""Well below the lease timeout of 2 s."""
_ROUND_TRIPS = 8


class HeldLease:
    """Lease on one robot."""

    def __init__(
        self,
        robot_id: str,
        operator: str,
        max_age_s: float,
        name: str = "",
        signing: LeaseSigning | None = None,
    ) -> None:
        """Prepare a lease on one robot; `name` is the display name of the operator.

        `signing` signs what the operator sends, if there is a key.

        Raises:
            BusError: If the operator name is not valid in a bus key.
        """
        self.robot_id = robot_id
        self.operator = topics.checked(operator)
        self.name = name
        """Display name, sent with requests."""
        self.max_age_s = max_age_s
        """Maximum age of accepted commands under this lease."""
        self.signing = signing
        self.status_seq = 0
        """Number of the latest status, echoed by new inputs."""
        self._lease = b""
        self._granted_s = self._renewed_s = -math.inf
        self.lost_why: Reason | None = None
        """Why the lease ended; None before the first."""
        self._round_trips_s: deque[float] = deque(maxlen=_ROUND_TRIPS)

    @property
    def has_lease(self) -> bool:
        """Whether the lease is held, according to the latest status."""
        return bool(self._lease)

    @property
    def lost_reason(self) -> str:
        """Reason why the last lease ended, or ""."""
        return sentence(self.lost_why) if self.lost_why else ""

    @property
    def lease_hex(self) -> str:
        """Lease id in hex, as sent in requests.

        Raises:
            ControlLost: If the lease is not held.
        """
        self.check_lease()
        return self._lease.hex()

    def grant(self, reply: LeaseReply, now_s: float) -> None:
        """Process the reply that grants the lease."""
        if reply.lease is None:
            raise MessageError("shape", "a granted lease has an id")
        self._lease = bytes.fromhex(reply.lease)
        if self.signing is not None:
            self.signing.grant(reply)
        self._granted_s = self._renewed_s = now_s
        self.lost_why = None
        self.max_age_s = reply.max_age_s

    def release(self) -> None:
        """Record that the lease was released or handed over."""
        self._lose(because(Code.CONTROL_RELEASED))

    def check_lease(self) -> None:
        """Check that the lease is held.

        Raises:
            ControlLost: If the lease is not held.
        """
        if not self._lease:
            lost = self.lost_reason or "take it first"
            raise ControlLost(f"no control of {self.robot_id}: {lost}", "no_control", self.lost_why)

    def renewal(self, now_s: float) -> bytes | None:
        """Return the renewal request if one is due."""
        if not self._lease or now_s - self._renewed_s < RENEW_PERIOD_S:
            return None
        self._renewed_s = now_s
        lease = self._lease.hex()
        renewal = LeaseRequest(op="renew", operator=self.operator, lease=lease, name=self.name)
        return self.encode(Service.LEASE, renewal)

    def encode(self, service: Service, message: msgspec.Struct) -> bytes:
        """Encode a request, and sign it if the operator has a key."""
        body = msgspec.json.encode(message)
        if self.signing is None:
            return body
        if isinstance(message, LeaseRequest) and message.lease is None:
            return self.signing.sign_lease_request(body, acquires=message.op == "acquire")
        return self.signing.sign_request(service, body, self.status_seq)

    def receive_renewal(self, request: bytes, answer: bytes | None, trip_s: float) -> None:
        """Process a renewal reply; if it is missing, the status timeout applies instead."""
        if answer is None or not self._lease:
            return
        asked = decode_json(request, LeaseRequest, "a renewal")
        try:
            reply = decode_json(answer, LeaseReply, "an answer")
        except MessageError:
            return
        if asked.lease != self._lease.hex():
            return  # Reply for an earlier lease.
        self.add_round_trip(trip_s)
        if not reply.granted:
            self._lose(self._why_not_renewed(reply))

    def add_round_trip(self, seconds: float) -> None:
        """Add a measured round-trip time of a service."""
        self._round_trips_s.append(seconds)

    @property
    def round_trip_s(self) -> float:
        """Median round-trip time of a request, or 0 if unknown."""
        return statistics.median(self._round_trips_s) if self._round_trips_s else 0.0

    def _why_not_renewed(self, reply: LeaseReply) -> Reason:
        if reply.holder == self.operator:
            return because(Code.OTHER_CLIENT)
        if reply.holder:
            return because(Code.HAS_CONTROL_NOW, holder=reply.holder)
        return why_of(reply) or because(Code.LEASE_ENDED)

    def _lose(self, why: Reason) -> None:
        self._lease, self.lost_why = b"", why
