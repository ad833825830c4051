"""Ed25519 keys of operators, and X25519 keys of leases."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tsd_twin.errors import TwinError, needs_extra

with needs_extra("A signing key", "tls"):
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )
    from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
    from cryptography.hazmat.primitives.asymmetric.x25519 import (
        X25519PrivateKey,
        X25519PublicKey,
    )

SIGNING_SUFFIX = ".sign"
"""Suffix of the file of a signing key; the stem is the name of its certificate."""
SigningKey = Ed25519PrivateKey


def new_signing_key() -> SigningKey:
    """Generate a signing key."""
    return Ed25519PrivateKey.generate()


def key_pem(key: PrivateKeyTypes) -> bytes:
    """Encode a private key of any kind as PKCS #8 without a passphrase."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def read_signing_key(file: Path) -> SigningKey:
    """Read a signing key.

    Raises:
        TwinError: If the file cannot be read or contains another kind of key.
    """
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise TwinError(f"{file} cannot be read as a signing key") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise TwinError(f"{file} is not an ed25519 key")
    return key


def public_bytes(key: SigningKey) -> bytes:
    """Return the public key (32 bytes)."""
    return key.public_key().public_bytes_raw()


def verify(key: bytes, content: bytes, signature: bytes) -> bool:
    """Return whether a signature is right for a public key (32 bytes)."""
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, content)
    except (InvalidSignature, ValueError):
        return False
    return True


def exchange() -> tuple[bytes, Callable[[bytes], bytes]]:
    """Generate an X25519 key; return its public key and the function for the shared secret.

    That function raises ValueError if the other public key is invalid.
    """
    key = X25519PrivateKey.generate()

    def shared(other: bytes) -> bytes:
        return key.exchange(X25519PublicKey.from_public_bytes(other))

    return key.public_key().public_bytes_raw(), shared
