"""Certificates expire and rights change while robots, router and operators keep running."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tests.support.link_sockets import free_port
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, from_file
from tsd_twin.errors import BusError, NoAnswerError
from tsd_twin.messages.topics import Service
from tsd_twin.security import Role
from tsd_twin.security.access_rules import ROUTER, BusIdentity
from tsd_twin.security.certificates import read_certificate
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.router_keys import robot_identity

pytestmark = pytest.mark.system

Start = Callable[..., Program]
LEFT_S = 8.0


@pytest.fixture
def fleet(start: Start, tmp_path: Path) -> KeyFolder:
    """Router folder with one robot and Alice, whose certificates are renewed."""
    flags = ["--router-host", "127.0.0.1", "--listen", f"tls/127.0.0.1:{free_port()}"]
    flags += ["--robot", "lab1", "--operator", "alice", "--robots", "lab1"]
    made = start("tsd_certs", str(tmp_path / "fleet"), *flags, "--renewal-port", str(free_port()))
    assert made.wait() == 0
    return KeyFolder(tmp_path / "fleet")


def shorten(folder: KeyFolder) -> None:
    """Replace the certificates of robot and router by some that expire in seconds."""
    now = datetime.now(UTC)
    authority, start = folder.authority(now), now - timedelta(days=30) + timedelta(seconds=LEFT_S)
    robot = authority.issue_client(folder.key("lab1"), robot_identity("lab1"), start, 30)
    folder.write_certificate("lab1", robot)
    identity, hosts = BusIdentity(ROUTER, Role.ROUTER), folder.hosts(ROUTER)
    router = authority.issue_server(folder.key(ROUTER), identity, hosts, start, 30)
    folder.write_certificate(ROUTER, router)


def answers(bus: Bus) -> bool:
    try:
        return bool(bus.query(Service.DESC.key("lab1"), b"", 1.0))
    except (BusError, NoAnswerError):
        return False


def wait_until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.1)


def test_a_fleet_outlives_its_certificates(start: Start, fleet: KeyFolder) -> None:
    shorten(fleet)
    ended_s = time.monotonic() + LEFT_S
    router = start("tsd_router", str(fleet.settings_file(ROUTER)))
    router.ready()
    renewing = start("tsd_certs", str(fleet.path), "--renew")
    renewing.ready()
    mock = start("tsd_mock", "--zenoh-config", str(fleet.settings_file("lab1")))
    assert mock.ready().split()[2] == "lab1"
    with Bus(from_file(str(fleet.settings_file("alice")))) as alice:
        wait_until(lambda: time.monotonic() > ended_s + 1.0)
        wait_until(lambda: answers(alice))
    days = {
        name: (read_certificate(fleet.certificate_file(name)).not_valid_after_utc
               - datetime.now(UTC)).days
        for name in ("lab1", ROUTER)
    }  # fmt: skip
    assert days == {"lab1": 29, ROUTER: 29}
    assert sum("reopened" in line for line in router.output) == 1
    assert mock.end() == router.end() == renewing.end() == 0
    assert not [line for line in mock.errors if "not renewed" in line]


def test_changed_rights_take_effect_without_a_restart_and_unchanged_ones_change_nothing(
    start: Start, fleet: KeyFolder, tmp_path: Path
) -> None:
    router = start("tsd_router", str(fleet.settings_file(ROUTER)))
    router.ready()
    mock = start("tsd_mock", "--zenoh-config", str(fleet.settings_file("lab1")))
    mock.ready()
    shutil.copytree(fleet.path, tmp_path / "hers")
    with Bus(from_file(str(tmp_path / "hers/alice.json5"))) as alice:
        wait_until(lambda: answers(alice))
        assert start("tsd_certs", str(fleet.path)).wait() == 0  # Has no effect.
        fleet.certificate_file("alice").unlink()
        assert start("tsd_certs", str(fleet.path)).wait() == 0
        wait_until(lambda: any("reopened" in line for line in router.output))
        end_s = time.monotonic() + 3.0
        while time.monotonic() < end_s:
            assert not answers(alice)
    added = start("tsd_certs", str(fleet.path), "--operator", "bob", "--robots", "lab1")
    assert added.wait() == 0
    with Bus(from_file(str(fleet.settings_file("bob")))) as bob:
        wait_until(lambda: answers(bob))
    settings = fleet.settings_file(ROUTER)
    good = settings.read_bytes()
    settings.write_bytes(good[:100])
    wait_until(lambda: "the former configuration stays" in router.sentence)
    settings.write_bytes(good)
    with Bus(from_file(str(fleet.settings_file("bob")))) as bob:
        wait_until(lambda: answers(bob))
    assert mock.end() == router.end() == 0
    assert sum("reopened" in line for line in router.output) <= 4
