"""Provisioning of the key folder: keys, certificates and configurations for robots and clients."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from tsd_twin.errors import TwinError
from tsd_twin.security import certificates
from tsd_twin.security.access_rules import (
    AUTHORITY,
    LISTEN,
    ROBOT,
    Identity,
    Role,
    access_control,
    client_settings,
    endpoint,
    merged,
    robot_settings,
)
from tsd_twin.security.certificates import CertificateAuthority


class KeyFolder:
    """Folder of keys, certificates and configurations; its certificates are the list of
    identities.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.made: list[Path] = []
        """Files that were written, in order."""

    # Paths.

    def certificate_file(self, name: str) -> Path:
        """Return where a certificate is."""
        return self.path / f"{name}.pem"

    def key_file(self, name: str) -> Path:
        """Return where a private key is."""
        return self.path / f"{name}.key"

    def settings_file(self, name: str) -> Path:
        """Return where the configuration of the robot or of a client is."""
        return self.path / f"{name}.json5"

    def files_of(self, name: str) -> list[Path]:
        """Files for the machine of the robot or of a client; no others may be copied
        there.
        """
        own = [self.certificate_file(name), self.key_file(name), self.settings_file(name)]
        return [self.certificate_file(AUTHORITY), *own]

    # Reading.

    def identities(self) -> list[Identity]:
        """Identities with a certificate in the folder, by name.

        Raises:
            TwinError: a certificate is none of ours.
        """
        files = sorted(f for f in self.path.glob("*.pem") if f.stem != AUTHORITY)
        return [p for p in map(certificate_identity, files) if p.role is not Role.ROBOT]

    def hosts(self) -> list[str]:
        """Names and addresses in the certificate of the robot, if there is one."""
        file = self.certificate_file(ROBOT)
        return certificates.hosts_of(certificates.read_certificate(file)) if file.exists() else []

    def end_of(self, name: str) -> datetime:
        """Return when a certificate runs out."""
        return certificates.read_certificate(self.certificate_file(name)).not_valid_after_utc

    def settings(self, name: str) -> dict[str, Any] | None:
        """Configuration of the robot or of a client, if there is one.

        Raises:
            TwinError: it is not JSON below lines of comment.
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
        """Make the folder, for its owner alone.

        Raises:
            TwinError: it cannot be made.
        """
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(f"{self.path} cannot be made: {error.strerror}") from error

    def authority(self, now: datetime) -> CertificateAuthority:
        """Return the authority; create it when there is none.

        Raises:
            TwinError: a part of it is missing, or its parts do not belong together.
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
        authority = CertificateAuthority(
            certificates.read_key(key_file), certificates.read_certificate(file)
        )
        if authority.key.public_key() != authority.certificate.public_key():
            raise TwinError(f"{key_file} is not the key of {file}")
        return authority

    def key(self, name: str) -> certificates.Key:
        """Existing key, so that a certificate alone can be renewed, or a new one."""
        file = self.key_file(name)
        if file.exists():
            return certificates.read_key(file)
        key = certificates.new_key()
        certificates.write_key(file, key)
        self.made.append(file)
        return key

    def write_certificate(self, name: str, certificate: certificates.Certificate) -> None:
        """Write a certificate."""
        certificates.write_certificate(self.certificate_file(name), certificate)
        self.made.append(self.certificate_file(name))

    def write_settings(self, name: str, head: str, settings: Mapping[str, Any]) -> None:
        """Write a configuration below a head of comments, unless it is so already."""
        if self.settings(name) != settings:
            text = head + json.dumps(settings, indent=2) + "\n"
            certificates.replace_file(self.settings_file(name), text.encode())
            self.made.append(self.settings_file(name))


def certificate_identity(file: Path) -> Identity:
    """Identity of the certificate in a file.

    Raises:
        TwinError: it cannot be read, or is none of ours.
    """
    return certificates.identity_of(certificates.read_certificate(file))


_ROBOT_HEAD = """\
// Configuration of a robot node. tsd-certs writes `access_control` anew from the certificates
// beside this file; all else is yours to change and is kept, as long as it is JSON.
"""
_CLIENT_HEAD = """\
// Configuration of a dashboard or a tool of {name}. tsd-certs made it once; it is yours to change.
"""


@dataclass(frozen=True, slots=True)
class CertificateRequest:
    """Request for certificates: the identities that a key folder shall have.

    Raises:
        TwinError: the number of days is impossible.
    """

    hosts: tuple[str, ...] = ()
    """Names and addresses of the robot; clients connect to the first of all."""
    identities: tuple[Identity, ...] = ()
    days: int = 365
    """Validity of new certificates, days."""
    listen: str | None = None
    """None: as it is, or `LISTEN`."""

    def __post_init__(self) -> None:
        if not 1 <= self.days <= certificates.AUTHORITY_DAYS:
            raise TwinError(f"certificates are good for 1 to {certificates.AUTHORITY_DAYS} days")


def provision(
    order: CertificateRequest,
    folder: KeyFolder,
    now: datetime,
    robot_base: Mapping[str, Any],
    client_base: Callable[[str], Mapping[str, Any]],
) -> None:
    """Write missing files, and the access rules of the robot for all identities.

    `now` is in UTC. `robot_base` are Zenoh settings of a node that listens nowhere, `client_base`
    gives those of a client for an endpoint. Keys and certificates are never overwritten, but for
    the certificate of a robot that gets another name; the one before stays good as well.

    Raises:
        TwinError: two names clash, no host is known or one cannot be, the key of the authority is
            needed and not here, or a file is not what it should be.
    """
    identities = merged(folder.identities(), order.identities)
    before = folder.hosts()
    hosts = list(dict.fromkeys([*before, *map(certificates.checked_host, order.hosts)]))
    if not hosts:
        raise TwinError(
            "by which names or addresses is the robot reached? Say --robot-host robot.local, as "
            "often as it has some"
        )
    settings = _robot_settings(folder, order.listen, identities, robot_base)
    where = endpoint(hosts[0], settings)
    folder.make()
    if hosts != before:
        authority, key = folder.authority(now), folder.key(ROBOT)
        folder.write_certificate(ROBOT, authority.issue_robot(key, hosts, now, order.days))
    for person in identities:
        if not folder.certificate_file(person.name).exists():
            authority, key = folder.authority(now), folder.key(person.name)
            folder.write_certificate(
                person.name, authority.issue_client(key, person, now, order.days)
            )
    folder.write_settings(ROBOT, _ROBOT_HEAD, settings)
    for person in identities:
        if not folder.settings_file(person.name).exists():
            mine = client_settings(client_base(where), person.name)
            folder.write_settings(person.name, _CLIENT_HEAD.format(name=person.name), mine)


def _robot_settings(
    folder: KeyFolder,
    listen: str | None,
    identities: Sequence[Identity],
    base: Mapping[str, Any],
) -> dict[str, Any]:
    settings = folder.settings(ROBOT)
    if settings is None:
        return robot_settings(base, listen or LISTEN, identities)
    settings["access_control"] = access_control(identities)
    if listen is not None:
        settings["listen"] = {"endpoints": [listen]}
    return settings
