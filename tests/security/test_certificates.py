"""Certificates, checked by OpenSSL in a handshake without a network."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tsd_twin.errors import TwinError
from tsd_twin.security import Role, certificates, client
from tsd_twin.security.access_rules import ROBOT, BusIdentity
from tsd_twin.security.certificates import CertificateAuthority

NOW = datetime.now(UTC)
HOSTS = ("robot.local", "192.168.1.7", "fe80::1")


class Party:
    """An authority with a robot and an operator."""

    def __init__(self, path: Path, start: datetime = NOW) -> None:
        self.path = path
        self.authority = CertificateAuthority.new(certificates.new_key(), NOW)
        certificates.write_certificate(path / "ca.pem", self.authority.certificate)
        for name in ("robot", "alice"):
            key = certificates.new_key()
            certificates.write_key(path / f"{name}.key", key)
            certificate = (
                self.authority.issue_server(key, BusIdentity(ROBOT, Role.ROBOT), HOSTS, start, 10)
                if name == "robot"
                else self.authority.issue_client(key, client(name, Role.OPERATOR), start, 10)
            )
            certificates.write_certificate(path / f"{name}.pem", certificate)


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Party:
    return Party(tmp_path_factory.mktemp("ours"))


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Party:
    return Party(tmp_path_factory.mktemp("theirs"))


def shake_hands(
    server: Party,
    client_: Party,
    host: str = "robot.local",
    *,
    server_name: str = "robot",
    client_name: str = "alice",
    trusted_by_server: Party | None = None,
    trusted_by_client: Party | None = None,
) -> str:
    """Return the common name by which the server knows the client.

    Raises:
        ssl.SSLError: one does not trust the other.
    """
    at_home = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    at_home.load_cert_chain(server.path / f"{server_name}.pem", server.path / f"{server_name}.key")
    at_home.load_verify_locations((trusted_by_server or server).path / "ca.pem")
    at_home.verify_mode = ssl.CERT_REQUIRED
    away = ssl.create_default_context(cafile=(trusted_by_client or client_).path / "ca.pem")
    away.load_cert_chain(client_.path / f"{client_name}.pem", client_.path / f"{client_name}.key")
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        away.wrap_bio(down, up, server_hostname=host),
        at_home.wrap_bio(up, down, server_side=True),
    ]
    for _ in range(4):
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
    subject = ends[1].getpeercert() or {}
    return dict(pair for part in subject["subject"] for pair in part)["commonName"]


@pytest.mark.parametrize("host", HOSTS)
def test_robot_and_operator_trust_each_other_by_every_name_of_the_robot(
    ours: Party, host: str
) -> None:
    assert shake_hands(ours, ours, host) == "alice"


@pytest.mark.parametrize("host", ["other.local", "192.168.1.8", "local", "x.robot.local"])
def test_another_name_is_not_that_of_the_robot(ours: Party, host: str) -> None:
    with pytest.raises(ssl.SSLCertVerificationError, match="match"):
        shake_hands(ours, ours, host)


def test_authorities_do_not_trust_each_others_people(ours: Party, theirs: Party) -> None:
    assert shake_hands(ours, theirs, trusted_by_server=theirs, trusted_by_client=ours) == "alice"
    with pytest.raises(ssl.SSLCertVerificationError, match="certificate"):
        shake_hands(ours, theirs, trusted_by_client=ours)
    with pytest.raises(ssl.SSLCertVerificationError, match="certificate"):
        shake_hands(ours, theirs, trusted_by_server=theirs)


def test_nobody_poses_as_the_robot_nor_the_robot_as_somebody(ours: Party) -> None:
    with pytest.raises(ssl.SSLCertVerificationError, match="purpose"):
        shake_hands(ours, ours, server_name="alice")
    with pytest.raises(ssl.SSLCertVerificationError, match="purpose"):
        shake_hands(ours, ours, client_name="robot")


def test_what_has_run_out_is_refused_and_what_begins_a_little_later_is_not(tmp_path: Path) -> None:
    """A robot whose clock is half a day behind still accepts a certificate issued today."""
    (tmp_path / "late").mkdir()
    late = Party(tmp_path / "late", NOW + timedelta(hours=12))
    assert shake_hands(late, late) == "alice"
    (tmp_path / "old").mkdir()
    old = Party(tmp_path / "old", NOW - timedelta(days=10, seconds=1))
    with pytest.raises(ssl.SSLCertVerificationError, match="expired"):
        shake_hands(old, old)


def test_a_certificate_says_who_its_owner_is(ours: Party) -> None:
    alice = certificates.identity_of(certificates.read_certificate(ours.path / "alice.pem"))
    assert (alice.name, alice.role) == ("alice", Role.OPERATOR)
    robot = certificates.read_certificate(ours.path / "robot.pem")
    assert certificates.identity_of(robot).role is Role.ROBOT
    assert tuple(certificates.hosts_of(robot)) == HOSTS
    with pytest.raises(TwinError, match="not made by tsd-certs"):
        certificates.identity_of(ours.authority.certificate)


def test_no_certificate_outlives_the_authority(ours: Party) -> None:
    days = certificates.AUTHORITY_DAYS
    alice, key = client("alice", Role.VIEWER), certificates.new_key()
    assert ours.authority.issue_client(key, alice, NOW, days)
    with pytest.raises(TwinError, match="authority's end"):
        ours.authority.issue_client(key, alice, NOW + timedelta(days=1), days)


@pytest.mark.parametrize(
    "host", ["", "robot local", "300.1.1.1", "-robot", "r..local", "1.2.3", "*"]
)
def test_what_is_no_host_is_refused(host: str) -> None:
    with pytest.raises(TwinError, match="neither a host name nor an address"):
        certificates.checked_host(host)


@pytest.mark.parametrize(
    ("host", "written"),
    [("Robot.Local", "robot.local"), ("FE80:0::1", "fe80::1"), ("r2-d2", "r2-d2"), ("::1", "::1")],
)
def test_a_host_is_written_in_one_way(host: str, written: str) -> None:
    assert certificates.checked_host(host) == written
