"""Keys and certificates as files: keys are written once and for their owner alone."""

from __future__ import annotations

import os
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from tsd_twin.errors import TwinError

Key = ec.EllipticCurvePrivateKey
Certificate = x509.Certificate


def read_certificate(file: Path) -> Certificate:
    """Return the certificate in a file.

    Raises:
        TwinError: there is none.
    """
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except (OSError, ValueError) as error:
        raise TwinError(f"{file} cannot be read as a certificate") from error


def read_key(file: Path) -> Key:
    """Return the private key in a file.

    Raises:
        TwinError: there is none, it has a passphrase, or it is of another kind.
    """
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise TwinError(f"{file} cannot be read as a private key without a passphrase") from error
    if not isinstance(key, Key):
        raise TwinError(f"{file} is not a key on an elliptic curve")
    return key


def write_key(file: Path, key: Key) -> None:
    """Write a private key as PKCS #8, without a passphrase, for its owner to read.

    Raises:
        TwinError: the file is there already, or cannot be written.
    """
    content = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
    except OSError as error:
        raise TwinError(f"{file} cannot be written: {error.strerror}") from error


def write_certificate(file: Path, certificate: Certificate) -> None:
    """Write a certificate.

    Raises:
        TwinError: the file cannot be written.
    """
    replace(file, certificate.public_bytes(serialization.Encoding.PEM))


def replace(file: Path, content: bytes, mode: int = 0o644) -> None:
    """Write a file whole: whenever this is interrupted, there is never half of one.

    Raises:
        TwinError: the file cannot be written.
    """
    draft = file.with_name(f"{file.name}.new")
    try:
        draft.unlink(missing_ok=True)  # One that was left behind may be anybody's to read.
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
        draft.replace(file)
    except OSError as error:
        raise TwinError(f"{file} cannot be written: {error.strerror}") from error
