"""Folder of the keys and certificates of robots and clients, and its provisioning."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from tsd_twin.errors import TwinError
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
from tsd_twin.security.certificates import (
    AUTHORITY_DAYS,
    Certificate,
    CertificateAuthority,
    Key,
    checked_host,
    hosts_of,
    identity_of,
    new_key,
    read_certificate,
    read_key,
    replace_file,
    write_certificate,
    write_key,
)


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
    """Raise TwinError if no certificate can be valid for that duration."""
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
