"""Writing the folder: what is missing is made, what is there stays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from tsd_twin.access import pki
from tsd_twin.access.folder import KeyFolder
from tsd_twin.access.identity import ROBOT, Identity, merged
from tsd_twin.access.rules import access_control
from tsd_twin.access.settings import LISTEN, client_settings, endpoint, robot_settings
from tsd_twin.errors import TwinError

_ROBOT_HEAD = """\
// Configuration of a robot node. tsd-certs writes `access_control` anew from the certificates
// beside this file; all else is yours to change and is kept, as long as it is JSON.
"""
_CLIENT_HEAD = """\
// Configuration of a dashboard or a tool of {name}. tsd-certs made it once; it is yours to change.
"""


@dataclass(frozen=True, slots=True)
class Order:
    """What there shall be in a folder.

    Raises:
        TwinError: the number of days is impossible.
    """

    hosts: tuple[str, ...] = ()
    """Names and addresses of the robot; clients connect to the first of all."""
    people: tuple[Identity, ...] = ()
    days: int = 365
    """How long new certificates are good."""
    listen: str | None = None
    """None: as it is, or `LISTEN`."""

    def __post_init__(self) -> None:
        if not 1 <= self.days <= pki.AUTHORITY_DAYS:
            raise TwinError(f"certificates are good for 1 to {pki.AUTHORITY_DAYS} days")


def fulfil(
    order: Order,
    folder: KeyFolder,
    now: datetime,
    robot_base: Mapping[str, Any],
    client_base: Callable[[str], Mapping[str, Any]],
) -> None:
    """Write what is missing, and the rules of the robot for all there are.

    `now` is in UTC. `robot_base` are Zenoh settings of a node that listens nowhere, `client_base`
    gives those of a client for an endpoint. Keys and certificates are never overwritten, but for
    the certificate of a robot that gets another name; the one before stays good as well.

    Raises:
        TwinError: two names clash, no host is known or one cannot be, the key of the authority is
            needed and not here, or a file is not what it should be.
    """
    people = merged(folder.people(), order.people)
    before = folder.hosts()
    hosts = list(dict.fromkeys([*before, *map(pki.checked_host, order.hosts)]))
    if not hosts:
        raise TwinError(
            "by which names or addresses is the robot reached? Say --robot-host robot.local, as "
            "often as it has some"
        )
    settings = _robot_settings(folder, order.listen, people, robot_base)
    where = endpoint(hosts[0], settings)
    folder.make()
    if hosts != before:
        authority, key = folder.authority(now), folder.key(ROBOT)
        folder.keep(ROBOT, authority.issue_robot(key, hosts, now, order.days))
    for person in people:
        if not folder.certificate_file(person.name).exists():
            authority, key = folder.authority(now), folder.key(person.name)
            folder.keep(person.name, authority.issue_client(key, person, now, order.days))
    folder.keep_settings(ROBOT, _ROBOT_HEAD, settings)
    for person in people:
        if not folder.settings_file(person.name).exists():
            mine = client_settings(client_base(where), person.name)
            folder.keep_settings(person.name, _CLIENT_HEAD.format(name=person.name), mine)


def _robot_settings(
    folder: KeyFolder,
    listen: str | None,
    people: Sequence[Identity],
    base: Mapping[str, Any],
) -> dict[str, Any]:
    settings = folder.settings(ROBOT)
    if settings is None:
        return robot_settings(base, listen or LISTEN, people)
    settings["access_control"] = access_control(people)
    if listen is not None:
        settings["listen"] = {"endpoints": [listen]}
    return settings
