"""Canonical bytes, tags and signatures of commands and requests.

A signed request is a JSON object whose last field is `sig`, which robots without a list of
operators ignore; a signed command has a tag behind its attachment.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass

from tsd_twin.messages.topics import Service

TAG_BYTES = 16
KEY_BYTES = 32
ATTACHMENT_BYTES = 32
"""Length of a command attachment without a tag."""
_MAX_SIG = 400
_FIELD = b',"sig":"'
_END = b'"}'
_NUMBERS = struct.Struct("<QQ")


def canonical(label: bytes, *parts: bytes) -> bytes:
    """Join parts unambiguously: each is preceded by its length."""
    return b"".join(struct.pack("<I", len(part)) + part for part in (b"tsd-twin " + label, *parts))


def tag(key: bytes, content: bytes) -> bytes:
    """Return the keyed BLAKE2b tag (16 bytes) of canonical bytes; `key` has 32 bytes."""
    return hashlib.blake2b(content, key=key, digest_size=TAG_BYTES).digest()


def is_tag(key: bytes, content: bytes, claimed: bytes) -> bool:
    """Return whether a tag is right, in constant time."""
    return hmac.compare_digest(tag(key, content), claimed)


def command_content(robot: str, operator: str, attachment: bytes, payload: bytes) -> bytes:
    """Canonical bytes of a command; the attachment has number, lease and echo, without a tag."""
    return canonical(b"command", robot.encode(), operator.encode(), attachment, payload)


def request_content(
    robot: str, service: Service, lease: bytes, number: int, echo: int, body: bytes
) -> bytes:
    """Canonical bytes of a request under a lease."""
    numbers = _NUMBERS.pack(number, echo)
    return canonical(b"request", robot.encode(), service.encode(), lease, numbers, body)


def identity_content(robot: str, exchange_key: bytes, body: bytes) -> bytes:
    """Canonical bytes of a lease request, which an operator signs with ed25519."""
    return canonical(b"lease", robot.encode(), exchange_key, body)


def lease_key(
    shared: bytes, robot: str, lease: bytes, client_key: bytes, robot_key: bytes
) -> bytes:
    """Derive the key of a lease from the X25519 secret, both public keys, robot and lease."""
    content = canonical(b"key", robot.encode(), lease, client_key, robot_key)
    return hashlib.blake2b(content, key=shared, digest_size=KEY_BYTES).digest()


@dataclass(frozen=True, slots=True)
class LeaseTag:
    """Signature of a request under a lease."""

    number: int
    echo: int
    """Number of the latest status that the client had received."""
    tag: bytes

    def text(self) -> str:
        """Return the text for `sig`."""
        return f"{self.number:x}.{self.echo:x}.{self.tag.hex()}"


@dataclass(frozen=True, slots=True)
class IdentitySignature:
    """Signature of a lease request by an operator."""

    signer: bytes
    """Public ed25519 key (32 bytes)."""
    exchange_key: bytes
    """Public X25519 key (32 bytes) of this request."""
    signature: bytes

    def text(self) -> str:
        """Return the text for `sig`."""
        return f"{self.signer.hex()}.{self.exchange_key.hex()}.{self.signature.hex()}"


def with_signature(body: bytes, text: str) -> bytes:
    """Append the field `sig` to a JSON object with at least one field."""
    return body[:-1] + _FIELD + text.encode() + _END


def split_signature(payload: bytes) -> tuple[bytes, str]:
    """Split a request into the object that was signed and the text of `sig`, "" without one."""
    start = payload.rfind(_FIELD, max(0, len(payload) - _MAX_SIG))
    if start < 0 or not payload.endswith(_END):
        return payload, ""
    text = payload[start + len(_FIELD) : -len(_END)]
    return payload[:start] + b"}", text.decode("ascii", "replace")


def parse_lease_tag(text: str) -> LeaseTag | None:
    """Parse the signature of a request under a lease, None if it has another form."""
    number, _, rest = text.partition(".")
    echo, _, digest = rest.partition(".")
    try:
        found = LeaseTag(int(number, 16), int(echo, 16), bytes.fromhex(digest))
    except ValueError:
        return None
    return found if found.text() == text and max(found.number, found.echo) < 2**64 else None


def parse_identity(text: str) -> IdentitySignature | None:
    """Parse the signature of an operator, None if it has another form."""
    parts = text.split(".")
    if [len(part) for part in parts] != [2 * KEY_BYTES, 2 * KEY_BYTES, 4 * KEY_BYTES]:
        return None
    try:
        return IdentitySignature(*map(bytes.fromhex, parts))
    except ValueError:
        return None
