"""Find robots on the bus and open the connection of a script to one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, Config, as_client, client_config, from_file
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.errors import NoRobotFound, SeveralRobotsFound
from tsd_twin.client.instances import live_count
from tsd_twin.errors import BusError, NoAnswerError
from tsd_twin.messages import topics
from tsd_twin.security import client_settings

_PATIENCE_S = 3.0
_OPERATOR = "script"
_HINT = "start one with tsd-demo or tsd-mock, or name its endpoint: connect('tcp/HOST:PORT')"


def open_link(
    endpoint: str | Sequence[str] | None,
    robot: str | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> tuple[BusLink, str]:
    """Connect like `connect`; return the link and the default operator name."""
    bus, where, operator = open_bus(endpoint, certificate, zenoh_config)
    try:
        robot_id = robot or _only_robot(bus, where)
        try:
            return BusLink(bus, robot_id), operator
        except NoAnswerError:
            found = robots_on(bus)
            there = f"{where} has {', '.join(found)}" if found else _HINT
            raise NoRobotFound(f"no robot '{robot_id}' answers: {there}", "no_robot") from None
    except BaseException:
        bus.close()
        raise


def open_bus(
    endpoint: str | Sequence[str] | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> tuple[Bus, str, str]:
    """Open a session like `connect`; return it with its location (for errors) and operator.

    Raises:
        NoRobotFound: If nothing responds.
        TwinError: If a file is invalid.
    """
    config, operator = _config(endpoint, certificate, zenoh_config)
    try:
        return Bus(config), config.where, operator
    except BusError:
        raise NoRobotFound(f"no robot at {config.where}: {_HINT}", "no_robot") from None


def _only_robot(bus: Bus, where: str) -> str:
    instances = instances_on(bus)
    found = robots_among(instances)
    if not found:
        replays = f"{min(instances)} is a recording; " if instances else ""
        raise NoRobotFound(f"no robot at {where}: {replays}{_HINT}", "no_robot")
    if len(found) > 1:
        raise SeveralRobotsFound(found, where)
    return found[0]


def instances_on(bus: Bus) -> dict[str, frozenset[str]]:
    """Return the ids currently on the bus, including replays, with their instance keys."""
    ids = {topics.robot_of(key) for key in bus.living_tokens(topics.alive_key("*"))}
    keys = bus.living_tokens(topics.instance_key("*", "*")) if ids else []
    return {
        robot_id: frozenset(key for key in keys if topics.robot_of(key) == robot_id)
        for robot_id in sorted(ids)
    }


def robots_on(bus: Bus) -> list[str]:
    """Return the ids of the robots currently on the bus, excluding replays."""
    return robots_among(instances_on(bus))


def robots_among(instances: dict[str, frozenset[str]]) -> list[str]:
    """Return the ids of robots; an id without instance tokens counts as one."""
    return [robot_id for robot_id, keys in instances.items() if not keys or live_count(keys)]


def _config(
    endpoint: str | Sequence[str] | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> tuple[Config, str]:
    if zenoh_config is not None:
        config = from_file(str(zenoh_config))
        operator = _operator_in(config.certificate) if config.certificate else _OPERATOR
        return as_client(config, _PATIENCE_S), operator
    endpoints = [endpoint] if isinstance(endpoint, str) else list(endpoint or [DEFAULT_ENDPOINT])
    config = client_config(endpoints)
    operator = _OPERATOR
    if certificate is not None:
        config, operator = _with_certificate(config, Path(certificate))
    # A client session connects to one endpoint and fails fast if no robot responds.
    return (as_client(config, _PATIENCE_S) if len(endpoints) == 1 else config), operator


def _with_certificate(config: Config, certificate: Path) -> tuple[Config, str]:
    folder, name = certificate.parent, certificate.stem
    tls = "transport/link/tls"
    files = {
        f"{tls}/root_ca_certificate": folder / "ca.pem",
        f"{tls}/connect_certificate": certificate,
        f"{tls}/connect_private_key": folder / f"{name}.key",
    }
    for file in files.values():
        if not file.is_file():
            raise BusError(f"the certificate needs {file}, which is not there")
    settings = client_settings(json.loads(config.json5), name)
    return Config(json.dumps(settings), config.where, files), _operator_in(certificate)


def _operator_in(certificate: Path) -> str:
    # Late, because it needs the extra `tls`.
    from tsd_twin.security.key_folder import certificate_identity

    return certificate_identity(certificate).name
