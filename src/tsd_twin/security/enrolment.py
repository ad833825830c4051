"""Enrolment of robots: one-time codes, and messages that are authenticated with them.

A code has 50 random bits and a fingerprint of the authority of 30 bits. The random bits, stretched
by scrypt together with the whole certificate of the authority, are the key of both messages. A
gateway with another authority therefore derives another key, even if it has made a certificate with
the same fingerprint. Whoever has recorded a message must test up to 2^50 codes, with 16 MiB and
tens of milliseconds each, while the code is good. Network and clock are elsewhere.
"""

from __future__ import annotations

import hashlib
import math
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self, TypeVar

import msgspec

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.messages.signatures import (
    KEY_BYTES,
    canonical,
    is_tag,
    split_signature,
    tag,
    with_signature,
)
from tsd_twin.security.certificates import Certificate, Key, PublicKey
from tsd_twin.security.rate_limits import AttemptLimits

with needs_extra("Enrolment", "tls"):
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

PORT = 7448
JOIN_PATH = "/join"
VALID_S = 600.0
"""Time for which a code is good."""
LARGEST_BYTES = 65536
"""Largest message of an enrolment."""
_ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Digits and letters without those that look like others, as in Crockford's base 32."""
_LOOK_ALIKE = str.maketrans("OIL", "011", "- ")
_SECRET, _FINGERPRINT, _GROUP = 10, 6, 4
_SCRYPT = {"n": 2**14, "r": 8, "p": 1}

Struct = TypeVar("Struct", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class EnrolmentCode:
    """Secret of 50 bits, and fingerprint of the authority with 30 bits, in base 32."""

    secret: str = field(repr=False)
    fingerprint: str

    @classmethod
    def new(cls, authority: Certificate) -> Self:
        """Generate a code for an authority."""
        secret = "".join(secrets.choice(_ALPHABET) for _ in range(_SECRET))
        return cls(secret, fingerprint(authority))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a typed code: case, dashes and blanks do not matter.

        Raises:
            TwinError: If it has another form.
        """
        plain = text.upper().translate(_LOOK_ALIKE)
        if len(plain) != _SECRET + _FINGERPRINT or set(plain) - set(_ALPHABET):
            raise TwinError(
                "--code: a code has 16 digits and letters, as in 7K3M-9Q2X-HT4W-0B8N: copy it from "
                "the output of tsd-certs --enrol"
            )
        return cls(plain[:_SECRET], plain[_SECRET:])

    @property
    def text(self) -> str:
        """Code in groups of four characters."""
        plain = self.secret + self.fingerprint
        return "-".join(plain[i : i + _GROUP] for i in range(0, len(plain), _GROUP))

    def key(self, authority: Certificate) -> bytes:
        """Derive the key of the messages (32 bytes) for an authority, slowly."""
        salt = authority.fingerprint(hashes.SHA256())
        return hashlib.scrypt(self.secret.encode(), salt=salt, dklen=KEY_BYTES, **_SCRYPT)


def fingerprint(authority: Certificate) -> str:
    """Return the first 30 bits of a certificate's SHA-256 digest, in base 32."""
    number = int.from_bytes(authority.fingerprint(hashes.SHA256())[:4], "big") >> 2
    return "".join(_ALPHABET[number >> 5 * i & 31] for i in reversed(range(_FINGERPRINT)))


class JoinRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a robot for a certificate."""

    csr: str
    """PEM request for a certificate; only its public key counts."""
    robot: str | None = None
    """Id that the robot expects, None for any."""
    is_done: bool = False
    """Whether the robot has written its files, so that the code has served its purpose."""


class Joined(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Files of a robot, except its private key and the certificate of the authority."""

    robot: str
    certificate: str
    settings: str
    operators: str
    """Signed list of operators."""


def signing_request(key: Key) -> str:
    """Return a PEM request for a certificate, with the public key and an empty name."""
    builder = x509.CertificateSigningRequestBuilder().subject_name(x509.Name([]))
    request = builder.sign(key, hashes.SHA256())
    return request.public_bytes(serialization.Encoding.PEM).decode()


def requested_key(csr: str) -> PublicKey:
    """Return the public key of a request for a certificate, whose private key signed it.

    Raises:
        ValueError: If the request or its signature is invalid, or it is not a P-256 key.
    """
    request = x509.load_pem_x509_csr(csr.encode())
    key = request.public_key()
    if not isinstance(key, PublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise ValueError("not a P-256 key")
    if not request.is_signature_valid:
        raise ValueError("wrong signature")
    return key


def seal(key: bytes, content: msgspec.Struct, answers: bytes = b"") -> bytes:
    """Encode a message with an authentication tag; a reply is bound to the request it answers."""
    body = msgspec.json.encode(content)
    return with_signature(body, tag(key, _canonical(body, answers)).hex())


def unseal(key: bytes, message: bytes, kind: type[Struct], answers: bytes = b"") -> Struct:
    """Decode a message.

    Raises:
        InvalidSignature: If its tag is wrong.
        msgspec.DecodeError: If it has another form.
    """
    body, signature = split_signature(message)
    try:
        claimed = bytes.fromhex(signature)
    except ValueError:
        claimed = b""
    if not is_tag(key, _canonical(body, answers), claimed):
        raise InvalidSignature
    return msgspec.json.decode(body, type=kind)


def _canonical(body: bytes, answers: bytes) -> bytes:
    return canonical(b"join", answers, body)


class Refusal(StrEnum):
    """Reason for which a gateway refuses to enrol a robot."""

    WRONG = "wrong"
    LATE = "late"
    USED = "used"
    OTHER_ROBOT = "other_robot"
    MALFORMED = "malformed"
    WAIT = "wait"
    REVOKED = "revoked"


_SENTENCES = {
    Refusal.WRONG: "the code is not that of a robot which may join now: copy it again",
    Refusal.LATE: "the code has expired: run tsd-certs --enrol again for a new one",
    Refusal.USED: "the code has been used already: run tsd-certs --enrol again for a new one",
    Refusal.OTHER_ROBOT: "the code is for a robot with another name than --id",
    Refusal.MALFORMED: "the gateway cannot read this request: use the same version on both sides",
    Refusal.REVOKED: "this certificate is not, or no longer, in the folder of tsd-certs",
    Refusal.WAIT: "too many codes were tried: repeat this in {} s",
}


class EnrolmentError(TwinError):
    """A gateway refuses to enrol a robot."""

    def __init__(self, refusal: Refusal, wait_s: int = 0) -> None:
        self.refusal = refusal
        self.wait_s = wait_s
        super().__init__(_SENTENCES[refusal].format(wait_s))


@dataclass(slots=True)
class _Offer:
    robot: str
    key: bytes
    end_s: float
    used_by: PublicKey | None = None
    joined: Joined | None = None
    is_done: bool = False


class Enrolments:
    """Codes that are offered, and the answers to requests; `now_s` is monotonic time.

    A code belongs to the first public key that arrives with it. A robot whose answer was lost
    repeats its request and gets the same certificate, until it confirms or the code expires.
    """

    def __init__(self, issue: Callable[[str, PublicKey], Joined]) -> None:
        """`issue` signs a certificate of a robot for a key; if it raises, the code remains good."""
        self._issue = issue
        self._offers: list[_Offer] = []
        self._limits = AttemptLimits()

    def offer(self, robot: str, key: bytes, now_s: float) -> None:
        """Accept the code with this key for one robot, once, for `VALID_S`."""
        self._offers.append(_Offer(robot, key, now_s + VALID_S))

    def answer(self, message: bytes, address: str, now_s: float) -> bytes:
        """Return the reply to a request from an address.

        Raises:
            EnrolmentError: If it is wrong, late, or comes after too many others.
            TwinError: If the certificate cannot be issued.
        """
        wait_s = self._limits.wait_s(address, now_s)
        if wait_s > 0.0:
            raise EnrolmentError(Refusal.WAIT, math.ceil(wait_s))
        offer, request = self._authenticated(message)
        if now_s >= offer.end_s:
            raise EnrolmentError(Refusal.LATE)
        if request.robot not in (None, offer.robot):
            raise EnrolmentError(Refusal.OTHER_ROBOT)
        try:
            key = requested_key(request.csr)
        except ValueError as error:
            raise EnrolmentError(Refusal.MALFORMED) from error
        if offer.is_done or offer.used_by not in (None, key):
            raise EnrolmentError(Refusal.USED)
        if offer.joined is None:
            offer.joined, offer.used_by = self._issue(offer.robot, key), key
        offer.is_done = request.is_done
        self._limits.right(address)
        return seal(offer.key, offer.joined, message)

    @property
    def missing(self) -> list[str]:
        """Robots that have not confirmed."""
        return [each.robot for each in self._offers if not each.is_done]

    def open_robots(self, now_s: float) -> list[str]:
        """Return the robots that may still join or confirm."""
        return [each.robot for each in self._offers if not each.is_done and now_s < each.end_s]

    def _authenticated(self, message: bytes) -> tuple[_Offer, JoinRequest]:
        for offer in self._offers:
            try:
                return offer, unseal(offer.key, message, JoinRequest)
            except InvalidSignature:
                continue
            except msgspec.DecodeError as error:
                raise EnrolmentError(Refusal.MALFORMED) from error
        raise EnrolmentError(Refusal.WRONG)
