"""Private certificate authority (EC P-256, PKCS #8), PEM files with safe permissions, and
provisioning of a key folder for robots and clients.
"""

from __future__ import annotations

import ipaddress
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Self

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import (
    AUTHORITY,
    LISTEN,
    ROBOT,
    ROUTER,
    BusIdentity,
    Role,
    access_control,
    client_settings,
    endpoint,
    merged,
    robot_settings,
)

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


def key_pem(key: Key) -> bytes:
    """Encode a private key as PKCS #8 without a passphrase."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


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

    def issue_robot(
        self, key: Key, hosts: Sequence[str], now: datetime, days: int
    ) -> x509.Certificate:
        """Issue the certificate of a robot that listens; errors as for `issue_server`."""
        return self.issue_server(key, BusIdentity(ROBOT, Role.ROBOT), hosts, now, days)

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


class KeyFolder:
    """Folder of keys, certificates and configurations; its certificates define the identities."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.made: list[Path] = []
        """Files written so far, in order."""

    # Paths.

    def certificate_file(self, name: str) -> Path:
        """Return the path of a certificate."""
        return self.path / f"{name}.pem"

    def key_file(self, name: str) -> Path:
        """Return the path of a private key."""
        return self.path / f"{name}.key"

    def settings_file(self, name: str) -> Path:
        """Return the path of the configuration of the robot or a client."""
        return self.path / f"{name}.json5"

    def files_of(self, name: str) -> list[Path]:
        """Return all files that may be copied to the machine of the robot or a client."""
        own = [self.certificate_file(name), self.key_file(name), self.settings_file(name)]
        extra = [self.path / f"{name}.sign", *self._lists(name)]
        return [self.certificate_file(AUTHORITY), *own, *(file for file in extra if file.exists())]

    def _lists(self, name: str) -> list[Path]:
        role = certificate_identity(self.certificate_file(name)).role
        return [self.path / "operators.json"] if role is Role.ROBOT else []

    # Reading.

    def identities(self) -> list[BusIdentity]:
        """Return the people and tools with a certificate in the folder, by name.

        Raises:
            TwinError: If a certificate was not made by `tsd-certs`.
        """
        return [p for p in self._owners() if p.role not in (Role.ROBOT, Role.ROUTER)]

    def robots(self) -> list[BusIdentity]:
        """Return the robots of a router's folder, by name."""
        return [p for p in self._owners() if p.role is Role.ROBOT and p.name != ROBOT]

    def _owners(self) -> list[BusIdentity]:
        files = sorted(f for f in self.path.glob("*.pem") if f.stem != AUTHORITY)
        return [certificate_identity(file) for file in files]

    @property
    def is_of_router(self) -> bool:
        """Whether the folder belongs to a router rather than to one listening robot."""
        return self.certificate_file(ROUTER).exists()

    def hosts(self, server: str = ROBOT) -> list[str]:
        """Return the names and addresses in the certificate of a server, if it exists."""
        file = self.certificate_file(server)
        return hosts_of(read_certificate(file)) if file.exists() else []

    def end_of(self, name: str) -> datetime:
        """Return the expiry of a certificate."""
        return read_certificate(self.certificate_file(name)).not_valid_after_utc

    def settings(self, name: str) -> dict[str, Any] | None:
        """Return the configuration of the robot or a client, if it exists.

        Raises:
            TwinError: If the file is not JSON with comment lines.
        """
        file = self.settings_file(name)
        if not file.exists():
            return None
        try:
            lines = file.read_text("utf-8").splitlines()
            return json.loads("\n".join(x for x in lines if not x.lstrip().startswith("//")))
        except (OSError, ValueError) as error:
            raise TwinError(
                f"{file} was changed and can no longer be read here: move it away, run this again, "
                "and bring your changes back as JSON"
            ) from error

    # Writing.

    def make(self) -> None:
        """Create the folder, accessible by its owner only.

        Raises:
            TwinError: If it cannot be created.
        """
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(f"{self.path} cannot be made: {error.strerror}") from error

    def authority_certificate(self) -> Certificate:
        """Return the certificate of the authority.

        Raises:
            TwinError: If it cannot be read.
        """
        return read_certificate(self.certificate_file(AUTHORITY))

    def authority(self, now: datetime) -> CertificateAuthority:
        """Return the authority; create it if it does not exist.

        Raises:
            TwinError: If the certificate or key is missing, or they do not match.
        """
        file, key_file = self.certificate_file(AUTHORITY), self.key_file(AUTHORITY)
        if not file.exists() and not key_file.exists():
            authority = CertificateAuthority.new(self.key(AUTHORITY), now)
            self.write_certificate(AUTHORITY, authority.certificate)
            return authority
        for needed in (file, key_file):
            if not needed.exists():
                raise TwinError(
                    f"nothing can be signed without {needed}: bring it back from where it is kept"
                )
        authority = CertificateAuthority(read_key(key_file), read_certificate(file))
        if authority.key.public_key() != authority.certificate.public_key():
            raise TwinError(f"{key_file} is not the key of {file}")
        return authority

    def key(self, name: str) -> Key:
        """Return the existing key, so that only the certificate is renewed, or create one."""
        file = self.key_file(name)
        if file.exists():
            return read_key(file)
        key = new_key()
        write_key(file, key)
        self.made.append(file)
        return key

    def write_certificate(self, name: str, certificate: Certificate) -> None:
        """Write a certificate and record its path."""
        write_certificate(self.certificate_file(name), certificate)
        self.made.append(self.certificate_file(name))

    def write_settings(self, name: str, head: str, settings: Mapping[str, Any]) -> None:
        """Write a configuration below a comment header, unless it is unchanged."""
        if self.settings(name) != settings:
            text = head + json.dumps(settings, indent=2) + "\n"
            replace_file(self.settings_file(name), text.encode())
            self.made.append(self.settings_file(name))


def certificate_identity(file: Path) -> BusIdentity:
    """Return the identity in a certificate file.

    Raises:
        TwinError: If the file cannot be read or was not made by `tsd-certs`.
    """
    return identity_of(read_certificate(file))


_ROBOT_HEAD = """\
// Configuration of a robot node. tsd-certs writes `access_control` anew from the certificates
// beside this file; all else is yours to change and is kept, as long as it is JSON.
"""
_CLIENT_HEAD = """\
// Configuration of a dashboard or a tool of {name}. tsd-certs made it once; it is yours to change.
"""


def provision(
    folder: KeyFolder,
    now: datetime,
    robot_base: Mapping[str, Any],
    client_base: Callable[[str], Mapping[str, Any]],
    *,
    hosts: Sequence[str] = (),
    identities: Sequence[BusIdentity] = (),
    days: int = 365,
    listen: str | None = None,
) -> None:
    """Write missing files, and update the robot's access rules for all identities.

    Existing keys and certificates are kept, except the robot's certificate when it gets another
    name; the previous one remains valid.

    Args:
        folder: Folder to update.
        now: Current time, UTC.
        robot_base: Zenoh settings of a node that does not listen.
        client_base: Returns the Zenoh settings of a client for an endpoint.
        hosts: Names and addresses of the robot; clients connect to the first.
        identities: New identities.
        days: Validity of new certificates.
        listen: Listening endpoint; None keeps the existing one, or uses `LISTEN`.

    Raises:
        TwinError: If names conflict, a host is missing or malformed, `days` is out of range, the
            authority's key is required but missing, or a file is invalid.
    """
    check_days(days)
    if folder.is_of_router:
        raise TwinError(f"{folder.path} belongs to a router: say --router-host, or use another")
    identities = merged(folder.identities(), identities)
    hosts = list(dict.fromkeys([*folder.hosts(), *map(checked_host, hosts)]))
    if not hosts:
        raise TwinError(
            "by which names or addresses is the robot reached? Say --robot-host robot.local, as "
            "often as it has some"
        )
    settings = _robot_settings(folder, listen, identities, robot_base)
    where = endpoint(hosts[0], settings)
    issue(folder, now, days, BusIdentity(ROBOT, Role.ROBOT), hosts, identities)
    folder.write_settings(ROBOT, _ROBOT_HEAD, settings)
    for person in identities:
        if not folder.settings_file(person.name).exists():
            mine = client_settings(client_base(where), person.name)
            folder.write_settings(person.name, _CLIENT_HEAD.format(name=person.name), mine)


def check_days(days: int) -> None:
    """Raise TwinError if no certificate can be good for so long."""
    if not 1 <= days <= AUTHORITY_DAYS:
        raise TwinError(f"certificates are good for 1 to {AUTHORITY_DAYS} days")


def issue(
    folder: KeyFolder,
    now: datetime,
    days: int,
    server: BusIdentity,
    hosts: Sequence[str],
    clients: Sequence[BusIdentity],
) -> None:
    """Issue the missing certificates, and the server's if it gets another host.

    Raises:
        TwinError: If the authority ends earlier, or its key is required but missing.
    """
    folder.make()
    if hosts != folder.hosts(server.name):
        authority, key = folder.authority(now), folder.key(server.name)
        certificate = authority.issue_server(key, server, hosts, now, days)
        folder.write_certificate(server.name, certificate)
    for person in clients:
        if not folder.certificate_file(person.name).exists():
            authority, key = folder.authority(now), folder.key(person.name)
            folder.write_certificate(person.name, authority.issue_client(key, person, now, days))


def _robot_settings(
    folder: KeyFolder,
    listen: str | None,
    identities: Sequence[BusIdentity],
    base: Mapping[str, Any],
) -> dict[str, Any]:
    settings = folder.settings(ROBOT)
    if settings is None:
        return robot_settings(base, listen or LISTEN, identities)
    settings["access_control"] = access_control(identities)
    if listen is not None:
        settings["listen"] = {"endpoints": [listen]}
    return settings
