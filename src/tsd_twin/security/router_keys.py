"""Key folder of a router: certificates of its robots and clients, their rights, its rules."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.security.access_rules import (
    LISTEN,
    ROUTER,
    BusIdentity,
    Role,
    client,
    client_settings,
    endpoint,
    merged,
)
from tsd_twin.security.certificates import (
    CertificateAuthority,
    PublicKey,
    certificate_pem,
    checked_host,
    replace_file,
)
from tsd_twin.security.enrolment import Joined
from tsd_twin.security.key_folder import KeyFolder, check_days, issue
from tsd_twin.security.operator_list import OPERATORS
from tsd_twin.security.router_rules import (
    EVERY_ROBOT,
    RobotRights,
    router_access_control,
    router_settings,
)

LASTING_DAYS, RENEWED_DAYS = 365, 30
_RIGHTS, _RENEWAL = "rights.json", "renewal"
_ROUTER_HEAD = """\
// Configuration of a router, for tsd-router or zenohd. tsd-certs writes `access_control` anew from
// the certificates and rights.json; all else is yours to change and is kept, as long as it is JSON.
"""
_DIALLING_HEAD = """\
// Configuration of {name}, which dials the router. tsd-certs made it once; it is yours to change.
"""


class _Rights(msgspec.Struct, forbid_unknown_fields=True):
    use: frozenset[str] = frozenset()
    watch: frozenset[str] = frozenset()


def rights_file(folder: KeyFolder) -> Path:
    """Return the path of the rights of all clients."""
    return folder.path / _RIGHTS


def read_rights(folder: KeyFolder) -> dict[str, RobotRights]:
    """Return the rights of each client by name.

    Raises:
        TwinError: If the file is invalid.
    """
    file = rights_file(folder)
    try:
        content = file.read_bytes() if file.exists() else b"{}"
        found = msgspec.json.decode(content, type=dict[str, _Rights])
    except (OSError, msgspec.DecodeError) as error:
        raise TwinError(f"{file} cannot be read: {error}") from error
    return {name: RobotRights(each.use, each.watch) for name, each in found.items()}


def robot_identity(name: str) -> BusIdentity:
    """Return the identity of a robot behind a router; its name is its id on the bus.

    Raises:
        TwinError: If the name is not valid as an id, too long, or reserved.
    """
    return client(name, Role.ROBOT)


def enrol_robot(
    folder: KeyFolder,
    authority: CertificateAuthority,
    name: str,
    key: PublicKey,
    now: datetime,
    days: int,
) -> Joined:
    """Issue the certificate of a reserved robot for its own key, and return its files.

    The certificate replaces the one that reserved the name, whose private key is deleted.

    Raises:
        TwinError: If the name is not reserved, or a file cannot be read or written.
    """
    robot = robot_identity(name)
    if robot not in folder.robots():
        raise TwinError(f"'{name}' is not a robot of this router: add --robot {name}")
    try:
        settings = folder.settings_file(name).read_text("utf-8")
        operators = (folder.path / OPERATORS).read_text("utf-8")
    except OSError as error:
        raise TwinError(f"{error.filename} cannot be read: {error.strerror}") from error
    certificate = authority.issue_client(key, robot, now, days)
    folder.write_certificate(name, certificate)
    folder.key_file(name).unlink(missing_ok=True)
    return Joined(name, certificate_pem(certificate), settings, operators)


def provision_router(
    folder: KeyFolder,
    now: datetime,
    router_base: Mapping[str, Any],
    client_base: Callable[[str], Mapping[str, Any]],
    *,
    hosts: Sequence[str] = (),
    robots: Sequence[BusIdentity] = (),
    identities: Sequence[BusIdentity] = (),
    rights: Mapping[str, RobotRights],
    days: int | None = None,
    listen: str | None = None,
    renewal_port: int | None = None,
) -> None:
    """Write missing files of a router, and update its rules for all robots, clients and rights.

    Existing keys and certificates are kept, as for `provision`.

    Args:
        folder: Folder to update.
        now: Current time, UTC.
        router_base: Zenoh settings of a node that does not listen.
        client_base: Returns the Zenoh settings of a session that dials an endpoint.
        hosts: Names and addresses of the router; robots and clients dial the first.
        robots: New robots.
        identities: New people and tools.
        rights: New or changed rights, by name.
        days: Validity of new certificates; None is 30 days if they are renewed, else a year.
        listen: Listening endpoint; None keeps the existing one, or uses `LISTEN`.
        renewal_port: Port of the router's first host at which new clients renew their certificates;
            None keeps the existing one, or none.

    Raises:
        TwinError: If names conflict, rights are missing or name an unknown robot, a host is missing
            or malformed, `days` is out of range, or a file is invalid.
    """
    everyone = merged([*folder.robots(), *folder.identities()], [*robots, *identities])
    robot_ids = [each.name for each in everyone if each.role is Role.ROBOT]
    people = [each for each in everyone if each.role is not Role.ROBOT]
    granted = _checked_rights(read_rights(folder) | dict(rights), robot_ids, people)
    hosts = list(dict.fromkeys([*folder.hosts(ROUTER), *map(checked_host, hosts)]))
    if not hosts:
        raise TwinError("by which names or addresses is the router reached? Say --router-host")
    settings = folder.settings(ROUTER)
    if settings is None:
        settings = router_settings(router_base, listen or LISTEN, robot_ids, people, granted)
    else:
        settings["access_control"] = router_access_control(robot_ids, people, granted)
        if listen is not None:
            settings["listen"] = {"endpoints": [listen]}
    if renewal_port is not None:
        host = f"[{hosts[0]}]" if ":" in hosts[0] else hosts[0]
        settings["metadata"] = {_RENEWAL: f"https://{host}:{renewal_port}"}
    renewal = _renewal(settings)
    days = days or default_days(renewal)
    check_days(days)
    where = endpoint(hosts[0], settings, ROUTER)
    issue(folder, now, days, BusIdentity(ROUTER, Role.ROUTER), hosts, everyone)
    _write_rights(folder, granted)
    folder.write_settings(ROUTER, _ROUTER_HEAD, settings)
    for each in everyone:
        if not folder.settings_file(each.name).exists():
            own = _dialling_settings(client_base(where), each, renewal)
            folder.write_settings(each.name, _DIALLING_HEAD.format(name=each.name), own)


def renewal_url(folder: KeyFolder) -> str | None:
    """Return the URL at which clients of a router renew their certificates, None if they do not."""
    return _renewal(folder.settings(ROUTER) or {})


def _renewal(router: Mapping[str, Any]) -> str | None:
    metadata: dict[str, str] = router.get("metadata") or {}
    return metadata.get(_RENEWAL)


def default_days(renewal: str | None) -> int:
    """Return the validity of certificates that are renewed at a URL, or not."""
    return LASTING_DAYS if renewal is None else RENEWED_DAYS


def _checked_rights(
    rights: Mapping[str, RobotRights], robots: Sequence[str], people: Sequence[BusIdentity]
) -> dict[str, RobotRights]:
    """Return the rights of people with a certificate.

    Raises:
        TwinError: If an operator has no key, or a robot is unknown.
    """
    kept: dict[str, RobotRights] = {}
    for person in people:
        own = rights.get(person.name)
        if own is None:
            raise TwinError(
                f"which robots are for '{person.name}'? Say --robots lab1,lab2 or --robots all"
            )
        for robot in sorted((own.use | own.watch) - EVERY_ROBOT.use):
            if robot not in robots:
                raise TwinError(f"'{robot}' is not a robot of this router: add --robot {robot}")
        kept[person.name] = own
    return kept


def _write_rights(folder: KeyFolder, rights: Mapping[str, RobotRights]) -> None:
    content = {
        name: {"use": sorted(each.use), "watch": sorted(each.watch)}
        for name, each in sorted(rights.items())
    }
    file, text = rights_file(folder), json.dumps(content, indent=2) + "\n"
    if not file.exists() or file.read_text("utf-8") != text:
        replace_file(file, text.encode())
        folder.made.append(file)


def _dialling_settings(
    base: Mapping[str, Any], owner: BusIdentity, renewal: str | None
) -> dict[str, Any]:
    settings = copy.deepcopy(dict(base))
    # For programs without the package of certificates.
    settings["metadata"] = {_RENEWAL: renewal} if renewal else {}
    if owner.role is Role.ROBOT:
        settings["metadata"]["robot"] = owner.name  # The id that the router's rules allow.
    return client_settings(settings, owner.name)
