"""Finding a robot on the bus, and connecting to it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, Config, as_client, client_config, from_file
from tsd_twin.client.link import BusLink
from tsd_twin.client.robot import RobotClient
from tsd_twin.errors import BusError, NoAnswerError, NoRobotFound, SeveralRobotsFound
from tsd_twin.messages import topics
from tsd_twin.security import certificate_identity, client_settings

_PATIENCE_S = 3.0
_OPERATOR = "script"
_HINT = "start one with tsd-demo or tsd-mock, or name its endpoint: connect('tcp/HOST:PORT')"


def connect(
    endpoint: str | Sequence[str] | None = None,
    *,
    robot: str | None = None,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> RobotClient:
    """Connect to a robot on the bus.

    Without an endpoint, that of the demo and the mock on this machine, as `tsd-dashboard` does.
    `robot` is an id, needed when there are several. `certificate` is the `.pem` that `tsd-certs`
    has made for an operator, beside its `.key` and the `ca.pem`; `zenoh_config` is a JSON5 file
    instead of both.

    Raises:
        NoRobotFound: no robot answers there.
        SeveralRobotsFound: there are several, and none was named.
        TwinError: a file cannot be used, or the robot cannot be understood.
    """
    return RobotClient(*open_link(endpoint, robot, certificate, zenoh_config))


def open_link(
    endpoint: str | Sequence[str] | None,
    robot: str | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> tuple[BusLink, str]:
    """Return a connection to a robot, and the default name of its operator; as `connect`."""
    config, operator = _config(endpoint, certificate, zenoh_config)
    try:
        bus = Bus(config)
    except BusError:
        raise NoRobotFound(f"no robot at {config.where}: {_HINT}") from None
    try:
        robot_id = robot or _only_robot(bus, config.where)
        try:
            return BusLink(bus, robot_id), operator
        except NoAnswerError:
            found = robots_on(bus)
            there = f"{config.where} has {', '.join(found)}" if found else _HINT
            raise NoRobotFound(f"no robot '{robot_id}' answers: {there}") from None
    except BaseException:
        bus.close()
        raise


def _only_robot(bus: Bus, where: str) -> str:
    found = robots_on(bus)
    if not found:
        raise NoRobotFound(f"no robot at {where}: {_HINT}")
    if len(found) > 1:
        raise SeveralRobotsFound(
            f"{', '.join(found)} are at {where}: name one, connect(robot='{found[0]}')"
        )
    return found[0]


def robots_on(bus: Bus) -> list[str]:
    """Return the ids of the robots that are on a bus now."""
    return sorted(topics.robot_of(key) for key in bus.living_tokens(topics.alive_key("*")))


def _config(
    endpoint: str | Sequence[str] | None,
    certificate: str | Path | None,
    zenoh_config: str | Path | None,
) -> tuple[Config, str]:
    if zenoh_config is not None:
        config = from_file(str(zenoh_config))
        operator = (
            certificate_identity(config.certificate).name if config.certificate else _OPERATOR
        )
        return as_client(config, _PATIENCE_S), operator
    endpoints = [endpoint] if isinstance(endpoint, str) else list(endpoint or [DEFAULT_ENDPOINT])
    config = client_config(endpoints)
    operator = _OPERATOR
    if certificate is not None:
        config, operator = _with_certificate(config, Path(certificate))
    # A client session connects to one endpoint, and says at once when no robot is there.
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
    operator = certificate_identity(certificate).name
    return Config(json.dumps(settings), config.where, files), operator
