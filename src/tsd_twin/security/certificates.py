"""Private certificate authority (EC P-256, PKCS #8), PEM files with safe permissions, and
provisioning of a key folder for robots and clients.
"""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Self

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import (
    BusIdentity,
    Role,
)
from tsd_twin.security.signing_keys import key_pem

with needs_extra("A certificate", "tls"):
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

Key = ec.EllipticCurvePrivateKey
PublicKey = ec.EllipticCurvePublicKey
Certificate = x509.Certificate


def read_certificate(file: Path) -> Certificate:
    """Read a PEM certificate.

    Raises:
        TwinError: If the file cannot be read as a certificate.
    """
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except (OSError, ValueError) as error:
        raise TwinError(f"{file} cannot be read as a certificate") from error


def read_key(file: Path) -> Key:
    """Read a private key.

    Raises:
        TwinError: If the file cannot be read, has a passphrase, or contains another kind of key.
    """
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise TwinError(f"{file} cannot be read as a private key without a passphrase") from error
    if not isinstance(key, Key):
        raise TwinError(f"{file} is not a key on an elliptic curve")
    return key


def create_file(file: Path, content: bytes, mode: int = 0o600) -> None:
    """Write a new file, by default readable by its owner only.

    Raises:
        OSError: If the file exists or cannot be written.
    """
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)


def write_key(file: Path, key: Key) -> None:
    """Write a private key as PKCS #8 without a passphrase, readable by the owner only.

    Raises:
        TwinError: If the file exists or cannot be written.
    """
    try:
        create_file(file, key_pem(key))
    except OSError as error:
        raise TwinError(f"{file} cannot be written: {error.strerror}") from error


def write_certificate(file: Path, certificate: Certificate) -> None:
    """Write a certificate.

    Raises:
        TwinError: If the file cannot be written.
    """
    replace_file(file, certificate_pem(certificate).encode())


def certificate_pem(certificate: Certificate) -> str:
    """Encode a certificate as PEM."""
    return certificate.public_bytes(serialization.Encoding.PEM).decode()


def replace_file(file: Path, content: bytes, mode: int = 0o644) -> None:
    """Write a file atomically.

    Raises:
        TwinError: If the file cannot be written.
    """
    draft = file.with_name(f"{file.name}.new")
    try:
        draft.unlink(missing_ok=True)  # A leftover draft may have public permissions.
        create_file(draft, content, mode)
        draft.replace(file)
    except OSError as error:
        raise TwinError(f"{file} cannot be written: {error.strerror}") from error


AUTHORITY_DAYS = 3650
_EARLIER = timedelta(days=1)
"""Backdates certificates by a day, because a robot's clock may lag."""
_HOST = re.compile(r"([a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?\.)*[a-z]([a-z0-9-]{0,61}[a-z0-9])?", re.I)
"""Labels of letters, digits and dashes. The last starts with a letter, which excludes malformed IP
addresses.
"""


def new_key() -> Key:
    """Generate a private key."""
    return ec.generate_private_key(ec.SECP256R1())


@dataclass(frozen=True, slots=True)
class CertificateAuthority:
    """Private certificate authority of the bus; its key decides who may connect."""

    key: Key
    certificate: x509.Certificate

    @classmethod
    def new(cls, key: Key, now: datetime) -> Self:
        """Create an authority that is valid for ten years from `now` (UTC)."""
        name = _name("tsd-twin private authority", "authority")
        signs = x509.KeyUsage(
            digital_signature=False,
            content_commitment=False,
            key_encipherment=False,
            data_encipherment=False,
            key_agreement=False,
            key_cert_sign=True,
            crl_sign=True,
            encipher_only=False,
            decipher_only=False,
        )
        certificate = (
            _builder(key, name, now, now + timedelta(days=AUTHORITY_DAYS))
            .issuer_name(name)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(signs, critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(key, certificate)

    @property
    def end(self) -> datetime:
        """Expiry of the authority and of all certificates that it has signed."""
        return self.certificate.not_valid_after_utc

    def issue_server(
        self,
        key: Key | PublicKey,
        server: BusIdentity,
        hosts: Sequence[str],
        now: datetime,
        days: int,
    ) -> x509.Certificate:
        """Issue a certificate of a listening robot or router for host names and addresses.

        Raises:
            TwinError: If a host is malformed, or the certificate would outlive the authority.
        """
        alternatives = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
        builder = self._leaf(key, server, now, days)
        builder = builder.add_extension(alternatives, critical=False)
        return self._sign(builder, ExtendedKeyUsageOID.SERVER_AUTH)

    def issue_client(
        self, key: Key | PublicKey, person: BusIdentity, now: datetime, days: int
    ) -> x509.Certificate:
        """Issue a client certificate, which is not valid for servers.

        Raises:
            TwinError: If the certificate would outlive the authority.
        """
        return self._sign(self._leaf(key, person, now, days), ExtendedKeyUsageOID.CLIENT_AUTH)

    def _leaf(
        self, key: Key | PublicKey, identity: BusIdentity, now: datetime, days: int
    ) -> x509.CertificateBuilder:
        # Certificates store whole seconds.
        end, last = (now + timedelta(days=days)).replace(microsecond=0), self.end
        if days < 1 or end > last:
            raise TwinError(f"{days} days are not between 1 day and the authority's end, {last:%F}")
        return (
            _builder(key, _name(identity.name, identity.role), now, end)
            .issuer_name(self.certificate.subject)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()),
                critical=False,
            )
        )

    def _sign(
        self, builder: x509.CertificateBuilder, usage: x509.ObjectIdentifier
    ) -> x509.Certificate:
        builder = builder.add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
        return builder.sign(self.key, hashes.SHA256())


def identity_of(certificate: x509.Certificate) -> BusIdentity:
    """Return the identity in a certificate.

    Raises:
        TwinError: If the certificate lacks the required fields.
    """
    try:
        (name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        (unit,) = certificate.subject.get_attributes_for_oid(NameOID.ORGANIZATIONAL_UNIT_NAME)
        return BusIdentity(str(name.value), Role(str(unit.value)))
    except ValueError as error:
        subject = certificate.subject.rfc4514_string()
        raise TwinError(f"the certificate of {subject} was not made by tsd-certs") from error


def hosts_of(certificate: x509.Certificate) -> list[str]:
    """Return the names and addresses in the certificate of a server; a client has none."""
    try:
        extension = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return []
    return [str(name.value) for name in extension.value]


def checked_host(host: str) -> str:
    """Return a host name or address in the form used in certificates.

    Raises:
        TwinError: If it is neither.
    """
    return str(_general_name(host).value)


def _name(common_name: str, unit: str) -> x509.Name:
    return x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, unit),
            x509.NameAttribute(NameOID.COMMON_NAME, common_name),
        ]
    )


def _builder(
    key: Key | PublicKey, subject: x509.Name, now: datetime, end: datetime
) -> x509.CertificateBuilder:
    public = key.public_key() if isinstance(key, Key) else key
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _EARLIER)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    if not _HOST.fullmatch(host):
        raise TwinError(f"'{host}' is neither a host name nor an address, such as robot.local")
    return x509.DNSName(host.lower())
