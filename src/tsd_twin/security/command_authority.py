"""Checks the signatures of commands and requests before they reach the controller of a robot.

Pure apart from the key that it draws for each lease: time and bytes are passed in.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace

import msgspec

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import LeaseReply, LeaseRequest, decode_request
from tsd_twin.messages.signatures import (
    ATTACHMENT_BYTES,
    IdentitySignature,
    command_content,
    identity_content,
    is_tag,
    lease_key,
    parse_identity,
    parse_lease_tag,
    request_content,
    split_signature,
)
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.security.operator_list import OperatorList
from tsd_twin.security.signing_keys import exchange, verify

REQUEST_AGE_S = 1.0
"""Maximum age of the status that a request echoes: its sender waits no longer for the reply."""
_WINDOW = 64
"""Requests may overtake each other by this much, because clients send them from several threads."""
_KEPT_KEYS = 1024
_KEPT_STATUSES = 256
_SIGNED_BY_OPERATOR = frozenset({"acquire", "request", "withdraw"})
_OPEN = frozenset({Service.STOP, Service.DESC})
_MISSING, _WRONG = because(Code.SIGNATURE_MISSING), because(Code.SIGNATURE_WRONG)
_REPEATED, _LATE = because(Code.SIGNATURE_REPEATED), because(Code.SIGNATURE_LATE)


@dataclass(slots=True)
class _Session:
    """Lease with its key."""

    lease: bytes
    operator: str
    signer: bytes
    key: bytes
    latest: int = -1
    seen: set[int] = field(default_factory=set[int])

    def is_new(self, number: int) -> bool:
        """Record a request number; return whether it is new and not far behind the latest."""
        if number in self.seen or number <= self.latest - _WINDOW:
            return False
        self.latest = max(self.latest, number)
        self.seen = {each for each in self.seen if each > self.latest - _WINDOW} | {number}
        return True


class CommandAuthority:
    """Checks who may drive one robot; STOP and the description need no signature."""

    def __init__(self, robot_id: str, operators: OperatorList) -> None:
        self._robot = robot_id
        self._operators = operators
        self._session: _Session | None = None
        self._pending: tuple[LeaseRequest, IdentitySignature] | None = None
        self._exchange_keys: OrderedDict[bytes, None] = OrderedDict()
        self._sent_s: OrderedDict[int, float] = OrderedDict()

    def set_operators(self, operators: OperatorList) -> None:
        """Use a new list; a lease whose key is no longer listed moves the robot no further."""
        self._operators = operators

    def record_status(self, number: int, now_s: float) -> None:
        """Record the time at which a status was sent, whose number requests echo."""
        self._sent_s[number] = now_s
        while len(self._sent_s) > _KEPT_STATUSES:
            self._sent_s.popitem(last=False)

    def check_command(self, sample: Sample) -> Sample | Reason:
        """Return a command without its tag, or why it does not count."""
        attachment, tag = sample.attachment[:ATTACHMENT_BYTES], sample.attachment[ATTACHMENT_BYTES:]
        if not tag:
            return _MISSING
        session, parts = self._session, sample.key.split("/")
        if session is None or len(parts) != 5 or attachment[8:24] != session.lease:
            return _WRONG
        content = command_content(self._robot, parts[3], attachment, sample.payload)
        if not is_tag(session.key, content, tag):
            return _WRONG
        return self._refusal_of_key(session.signer, session.operator) or replace(
            sample, attachment=attachment
        )

    def check_request(self, service: Service, payload: bytes, now_s: float) -> bytes | Reason:
        """Return a request without its signature, or why it is refused."""
        if service in _OPEN:
            return payload
        body, text = split_signature(payload)
        only_stops = service is Service.DISARM
        if service is Service.LEASE:
            try:
                request = decode_request(body, LeaseRequest)
            except MessageError:
                return body  # The controller refuses it, with the field that is wrong.
            if request.op == "peek":
                return body
            if request.op in _SIGNED_BY_OPERATOR:
                return self._check_identity(request, body, text)
            only_stops = request.op == "release"
        refusal = self._check_lease_tag(service, body, text, now_s, only_stops=only_stops)
        return refusal or body

    def _check_identity(self, request: LeaseRequest, body: bytes, text: str) -> bytes | Reason:
        if not text:
            return _MISSING
        identity = parse_identity(text)
        if identity is None:
            return _WRONG
        if refusal := self._refusal_of_key(identity.signer, request.operator):
            return refusal
        content = identity_content(self._robot, identity.exchange_key, body)
        if not verify(identity.signer, content, identity.signature):
            return _WRONG
        if identity.exchange_key in self._exchange_keys:
            return _REPEATED
        self._exchange_keys[identity.exchange_key] = None
        while len(self._exchange_keys) > _KEPT_KEYS:
            self._exchange_keys.popitem(last=False)
        self._pending = (request, identity) if request.op == "acquire" else None
        return body

    def _check_lease_tag(
        self, service: Service, body: bytes, text: str, now_s: float, *, only_stops: bool
    ) -> Reason | None:
        """Return why a request is refused; a revoked key may still disarm and release."""
        if not text:
            return _MISSING
        claimed, session = parse_lease_tag(text), self._session
        if claimed is None or session is None:
            return _WRONG
        content = request_content(
            self._robot, service, session.lease, claimed.number, claimed.echo, body
        )
        if not is_tag(session.key, content, claimed.tag):
            return _WRONG
        refusal = self._refusal_of_key(session.signer, session.operator)
        if refusal and not only_stops:
            return refusal
        sent_s = self._sent_s.get(claimed.echo)
        if sent_s is None or now_s - sent_s > REQUEST_AGE_S:
            return _LATE
        return None if session.is_new(claimed.number) else _REPEATED

    def complete(self, reply: msgspec.Struct) -> msgspec.Struct:
        """Return a reply with the robot's X25519 key, if it grants the lease just requested."""
        pending, self._pending = self._pending, None
        if pending is None or not isinstance(reply, LeaseReply) or not reply.granted:
            return reply
        request, identity = pending
        public, shared = exchange()
        lease = bytes.fromhex(reply.lease or "")
        self._session = None
        try:
            secret = shared(identity.exchange_key)
        except ValueError:  # A key without a secret: this lease moves nothing, and expires.
            return reply
        key = lease_key(secret, self._robot, lease, identity.exchange_key, public)
        self._session = _Session(lease, request.operator, identity.signer, key)
        return msgspec.structs.replace(reply, key=public.hex())

    def _refusal_of_key(self, signer: bytes, operator: str) -> Reason | None:
        if self._operators.allows(signer, operator, self._robot):
            return None
        return because(Code.KEY_REFUSED, operator=operator)
