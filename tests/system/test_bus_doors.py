"""Peers refused by a robot behind TLS; the robot survives every attempt."""

from __future__ import annotations

import dataclasses
import queue
import shutil
import socket
from collections.abc import Generator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tests.support.link_sockets import Relay
from tests.support.robot_node import raw_session
from tests.support.secured_robot import (
    DESCRIPTION,
    ID,
    PEOPLE,
    SecuredRobot,
    make_keys,
    section,
    with_sections,
)
from tests.support.withheld import PATIENCE_S
from tsd_twin import security
from tsd_twin.bus import Bus, Config, client_config, node_config
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages import topics
from tsd_twin.messages.topics import Service
from tsd_twin.security import Role, certificates
from tsd_twin.security.key_folder import KeyFolder

pytestmark = pytest.mark.system

TLS = "transport/link/tls"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Generator[SecuredRobot]:
    guarded = SecuredRobot(make_keys(tmp_path_factory.mktemp("doors") / "keys"))
    yield guarded
    guarded.close()


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> KeyFolder:
    """Keys with the same names from a foreign authority."""
    return make_keys(tmp_path_factory.mktemp("foreign") / "keys")


@pytest.fixture(autouse=True)
def survives(robot: SecuredRobot) -> Generator[None]:
    """After each attempt an operator can connect and gets a reply."""
    yield
    with robot.join("alice") as alice:
        assert DESCRIPTION.urdf.encode() in alice.query(Service.DESC.key(ID), b"")


def at(endpoint: str, config: Config) -> Config:
    """Return a configuration that connects elsewhere."""
    connect = section(config, "connect") | {"endpoints": [endpoint]}
    return with_sections(config, connect=connect)


def with_files(config: Config, folder: Path, **names: str) -> Config:
    """Return a configuration with other files for some TLS settings."""
    changed = {f"{TLS}/{key}": folder / name for key, name in names.items()}
    return dataclasses.replace(config, files={**config.files, **changed})


def is_let_in(endpoint: str, config: Config) -> bool:
    """Return whether a link exists before two attempts have failed."""
    news = queue.SimpleQueue[str]()
    with (
        Relay(endpoint, lambda: news.put("given up")) as relay,
        raw_session(at(relay.endpoint, config)) as session,
        session.info.declare_transport_events_listener(
            lambda _event: news.put("linked"), history=True
        ),
    ):
        return any(news.get(timeout=PATIENCE_S) == "linked" for _ in range(2))


def is_refused(robot: SecuredRobot, client: Config, careless: Config) -> bool:
    """Return whether the robot refuses a session that a less careful robot accepts."""
    with Bus(careless) as other:
        assert is_let_in(other.endpoints()[0], client)
    protocol = section(client, "connect")["endpoints"][0][:3]
    return not is_let_in(robot.endpoint.replace("tls", protocol), client)


def test_somebody_with_a_certificate_of_another_authority_is_refused(
    robot: SecuredRobot, foreign: KeyFolder
) -> None:
    own = {"connect_private_key": "alice.key", "connect_certificate": "alice.pem"}
    client = with_files(robot.config("alice"), foreign.path, **own)
    trusting = with_files(robot.own_config(), foreign.path, root_ca_certificate="ca.pem")
    assert is_refused(robot, client, trusting)


def test_somebody_without_a_certificate_is_refused(robot: SecuredRobot) -> None:
    config, home = robot.config("alice"), robot.own_config()
    own = dict.fromkeys(("connect_private_key", "connect_certificate")) | {"enable_mtls": False}
    nobody = with_sections(config, **{TLS: section(config, TLS) | own})
    files = {key: file for key, file in config.files.items() if "connect" not in key}
    unasking = with_sections(home, **{TLS: section(home, TLS) | {"enable_mtls": False}})
    assert is_refused(robot, dataclasses.replace(nobody, files=files), unasking)


def test_somebody_who_does_not_speak_tls_is_refused(robot: SecuredRobot) -> None:
    plain = client_config(["tcp/127.0.0.1:1"])
    assert is_refused(robot, plain, node_config(["tcp/127.0.0.1:0"]))


def test_somebody_whose_certificate_has_run_out_is_refused(
    robot: SecuredRobot, tmp_path: Path
) -> None:
    assert is_let_in(robot.endpoint, robot.config("bob"))
    ended = certificate_until(robot, tmp_path, datetime.now(UTC) - timedelta(hours=1))
    assert not is_let_in(robot.endpoint, ended)


def test_a_certificate_that_runs_out_ends_the_session(robot: SecuredRobot, tmp_path: Path) -> None:
    lives = queue.SimpleQueue[bool]()
    soon = datetime.now(UTC) + timedelta(seconds=3)
    with Bus(certificate_until(robot, tmp_path, soon)) as bus:
        bus.subscribe_liveliness(topics.alive_key("*"), lambda _key, alive: lives.put(alive))
        assert lives.get(timeout=PATIENCE_S)
        assert not lives.get(timeout=PATIENCE_S)


def certificate_until(robot: SecuredRobot, folder: Path, end: datetime) -> Config:
    """Return Bob's configuration with a certificate that expires at a given time."""
    start, key = end - timedelta(days=1), robot.folder.key("bob")
    bob = security.client("bob", Role.OPERATOR)
    certificate = robot.folder.authority(start).issue_client(key, bob, start, days=1)
    certificates.write_certificate(folder / "bob.pem", certificate)
    return with_files(robot.config("bob"), folder, connect_certificate="bob.pem")


def test_an_operator_cannot_pose_as_the_robot(robot: SecuredRobot, foreign: KeyFolder) -> None:
    """Neither with an own certificate nor with one of a foreign authority."""
    for folder, name in ((robot.folder, "alice"), (foreign, "robot")):
        own = {"listen_private_key": f"{name}.key", "listen_certificate": f"{name}.pem"}
        with Bus(with_files(robot.own_config(), folder.path, **own)) as false_robot:
            assert not is_let_in(false_robot.endpoints()[0], robot.config("bob"))


def test_nobody_takes_over_the_session_of_another(robot: SecuredRobot) -> None:
    """A session id proves nothing, so a second session with the same id is refused."""
    with robot.join("alice") as alice:
        stolen = alice.id
        thief = with_sections(robot.config("guest"), id=stolen)
        assert not is_let_in(robot.endpoint, thief)
        assert alice.query(Service.DESC.key(ID), b"")
    assert is_let_in(robot.endpoint, thief)


def test_who_got_a_certificate_after_the_robot_was_started_is_let_in_and_may_nothing(
    robot: SecuredRobot, tmp_path: Path
) -> None:
    """Nor may a peer removed from the rules, which list all permissions."""
    later = tmp_path / "later"
    shutil.copytree(robot.folder.path, later)
    make_keys(later, identities=(*PEOPLE, security.client("carol", Role.OPERATOR)))
    own = {"connect_private_key": "carol.key", "connect_certificate": "carol.pem"}
    with Bus(with_files(robot.config("alice"), later, **own)) as carol:
        assert carol.wait_for_peer(PATIENCE_S)
        for service in (Service.DESC, Service.STOP, Service.LEASE):
            with pytest.raises(NoAnswerError):
                carol.query(service.key(ID), b"{}")
        assert carol.living_tokens(topics.alive_key("*")) == []
    assert robot.status().mode == "disarmed"


@pytest.mark.parametrize(
    "rubbish", [b"GET / HTTP/1.1\r\n\r\n", bytes(4096), b"\x16\x03\x01\xff\xff"]
)
def test_who_talks_rubbish_is_hung_up_on_and_who_is_silent_holds_up_nobody(
    robot: SecuredRobot, rubbish: bytes
) -> None:
    address = ("127.0.0.1", int(robot.endpoint.rpartition(":")[2]))
    with (
        socket.create_connection(address, PATIENCE_S) as silent,
        socket.create_connection(address, PATIENCE_S) as loud,
    ):
        loud.sendall(rubbish)
        loud.shutdown(socket.SHUT_WR)
        try:
            while loud.recv(4096):
                pass
        except ConnectionResetError:
            pass
        with robot.join("bob") as bob:
            assert bob.query(Service.DESC.key(ID), b"")
        silent.sendall(b"\0")
