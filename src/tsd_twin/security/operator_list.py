"""Signed list of operators' keys and of revoked keys, which a robot reloads while it runs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.messages.signatures import canonical, split_signature, with_signature
from tsd_twin.security.access_rules import AUTHORITY
from tsd_twin.security.certificates import read_certificate

with needs_extra("A list of operators", "tls"):
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

OPERATORS = "operators.json"
_DEVICE = re.compile(r"-[0-9a-f]{8}\Z")
PublicKey = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
"""Ed25519 key in hex."""


class ListedOperator(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of an operator."""

    keys: tuple[PublicKey, ...]
    for_users: bool = False
    """Whether these are keys of a gateway, which signs for users that log in there as
    `<gateway>-<user>`.
    """
    robots: tuple[str, ...] | None = None
    """Ids of the robots that the operator may drive; None for all."""


class OperatorList(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Who may drive, and keys that are no longer valid."""

    number: int
    """Increases with every change; a robot ignores an older list."""
    operators: Mapping[str, ListedOperator]
    revoked: frozenset[PublicKey] = frozenset()

    def allows(self, key: bytes, operator: str, robot: str) -> bool:
        """Return whether a key may sign for an operator id on a robot."""
        key_hex = key.hex()
        if key_hex in self.revoked:
            return False
        return any(
            key_hex in listed.keys
            and (listed.robots is None or robot in listed.robots)
            and is_same_operator(name, operator, for_users=listed.for_users)
            for name, listed in self.operators.items()
        )


def is_same_operator(name: str, operator: str, *, for_users: bool = False) -> bool:
    """Return whether an operator id is a name, or the name with a dash and 8 hex digits.

    The name of another operator that begins like this one does not count, except for a gateway,
    whose users have its name, a dash and their own name.
    """
    if operator == name or (for_users and operator.startswith(f"{name}-")):
        return True
    return operator.startswith(name) and bool(_DEVICE.fullmatch(operator[len(name) :]))


def encode_list(listed: OperatorList, key: ec.EllipticCurvePrivateKey) -> bytes:
    """Encode a list, signed with the key of the certificate authority."""
    body = msgspec.json.encode(listed, order="sorted")
    signature = key.sign(canonical(b"operators", body), ec.ECDSA(hashes.SHA256()))
    return with_signature(body, signature.hex()) + b"\n"


def decode_list(content: bytes, authority: ec.EllipticCurvePublicKey) -> OperatorList:
    """Decode a list and check its signature.

    Raises:
        TwinError: If it is invalid, or was not signed by this authority.
    """
    body, signature = split_signature(content.strip())
    try:
        authority.verify(
            bytes.fromhex(signature), canonical(b"operators", body), ec.ECDSA(hashes.SHA256())
        )
        return msgspec.json.decode(body, type=OperatorList)
    except (InvalidSignature, ValueError) as error:
        raise TwinError("the list was not signed by the authority in ca.pem") from error
    except (msgspec.DecodeError, RecursionError) as error:
        raise TwinError(f"no list of operators: {error}") from error


class OperatorFile:
    """List of operators in a file in the folder of `ca.pem`; reloaded when it changes."""

    def __init__(self, file: Path) -> None:
        """Read the list and the authority's certificate.

        Raises:
            TwinError: If either cannot be read, or the signature is wrong.
        """
        self.file = file
        key = read_certificate(file.with_name(f"{AUTHORITY}.pem")).public_key()
        if not isinstance(key, ec.EllipticCurvePublicKey):
            raise TwinError(f"{AUTHORITY}.pem was not made by tsd-certs")
        self._authority = key
        self._seen: tuple[int, int, int] | None = None
        self.current = OperatorList(-1, {})
        self.poll()

    def poll(self) -> OperatorList | None:
        """Return the list if it has changed.

        If the file is missing, the current list remains valid.

        Raises:
            TwinError: If the new list is invalid or older; the current list remains valid.
        """
        try:
            status = self.file.stat()
            seen = (status.st_mtime_ns, status.st_size, status.st_ino)
            if seen == self._seen:
                return None
            content = self.file.read_bytes()
        except OSError as error:
            if self._seen is None:
                raise TwinError(f"{self.file} cannot be read: {error.strerror}") from error
            return None
        self._seen = seen
        try:
            found = decode_list(content, self._authority)
        except TwinError as error:
            raise TwinError(f"{self.file}: {error}") from error
        if found.number < self.current.number:
            raise TwinError(f"{self.file} is older than the list in force: number {found.number}")
        self.current = found
        return found
