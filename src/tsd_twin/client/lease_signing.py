"""Signatures of an operator on requests and commands to a robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.signatures import (
    KEY_BYTES,
    IdentitySignature,
    LeaseTag,
    command_content,
    identity_content,
    lease_key,
    request_content,
    tag,
    with_signature,
)
from tsd_twin.messages.topics import Service

if TYPE_CHECKING:
    from tsd_twin.security.signing_keys import SigningKey


class LeaseSigning:
    """Signs lease requests with the operator's key, and the rest with the key of the lease.

    Not thread-safe; one for each `ControlProtocol`.
    """

    def __init__(self, key: SigningKey, robot_id: str) -> None:
        # Late, because a client without a key needs no package for certificates.
        from tsd_twin.security import signing_keys

        self._keys, self._signing_key, self._robot = signing_keys, key, robot_id
        self._exchange: tuple[bytes, Callable[[bytes], bytes]] | None = None
        self._lease = self._key = b""
        self._number = 0

    def sign_lease_request(self, body: bytes, *, acquires: bool) -> bytes:
        """Sign a request of the operator; one that acquires replaces the key that it offers."""
        exchange = self._keys.exchange()
        if acquires:
            self._exchange = exchange
        content = identity_content(self._robot, exchange[0], body)
        signer = self._keys.public_bytes(self._signing_key)
        signed = IdentitySignature(signer, exchange[0], self._signing_key.sign(content))
        return with_signature(body, signed.text())

    def grant(self, reply: LeaseReply) -> None:
        """Derive the key of a granted lease; a robot without a list of operators needs none."""
        self._lease, self._key, self._number = bytes.fromhex(reply.lease or ""), b"", 0
        try:
            robot_key = bytes.fromhex(reply.key)
            if self._exchange is not None and len(robot_key) == KEY_BYTES:
                public, shared = self._exchange
                secret = shared(robot_key)
                self._key = lease_key(secret, self._robot, self._lease, public, robot_key)
        except ValueError:
            return  # The robot refuses the first command, with a code.

    def sign_request(self, service: Service, body: bytes, echo: int) -> bytes:
        """Sign a request under the lease."""
        if not self._key:
            return body
        self._number += 1
        content = request_content(self._robot, service, self._lease, self._number, echo, body)
        return with_signature(body, LeaseTag(self._number, echo, tag(self._key, content)).text())

    def command_tag(self, operator: str, attachment: bytes, payload: bytes) -> bytes:
        """Return the tag of a command, b"" if the robot needs none."""
        if not self._key:
            return b""
        return tag(self._key, command_content(self._robot, operator, attachment, payload))


def signing_key_beside(certificate: Path | None) -> SigningKey | None:
    """Read the signing key in the folder of a certificate; None if it is missing.

    Raises:
        TwinError: If it cannot be read.
    """
    file = None if certificate is None else certificate.with_suffix(".sign")
    if file is None or not file.exists():
        return None
    # Late, as above.
    from tsd_twin.security.signing_keys import read_signing_key

    return read_signing_key(file)
