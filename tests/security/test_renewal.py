"""Certificates are renewed only for clients in the folder, with the same key."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from hypothesis import given
from hypothesis import strategies as st

from tests.support.key_folders import content
from tests.support.secured_robot import make_router_keys
from tsd_twin.errors import TwinError
from tsd_twin.security import Role, client
from tsd_twin.security.access_rules import ROUTER, BusIdentity
from tsd_twin.security.authority_client import AuthorityClient, ClientFiles
from tsd_twin.security.authority_server import Answer, AuthorityServer
from tsd_twin.security.certificates import (
    CertificateAuthority,
    certificate_pem,
    hosts_of,
    identity_of,
    new_key,
    read_certificate,
    read_key,
)
from tsd_twin.security.enrolment import EnrolmentError, Refusal
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.operator_keys import provision_operators
from tsd_twin.security.operator_list import OPERATORS, OperatorFile
from tsd_twin.security.renewal import (
    OPERATORS_PATH,
    RENEW_PATH,
    CertificateRenewal,
    Renewals,
    is_due,
    is_for_same,
)
from tsd_twin.security.router_keys import enrol_robot, read_rights, robot_identity

pytestmark = pytest.mark.system

NOW = datetime.now(UTC).replace(microsecond=0)
DAYS = 30
ISSUED = NOW - timedelta(days=25)
_KEY = new_key()
_AUTHORITY = CertificateAuthority.new(new_key(), NOW)
_USAGE = x509.ExtendedKeyUsage


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Router folder whose certificates expire in 5 of 30 days."""
    folder = make_router_keys(tmp_path_factory.mktemp("keys") / "fleet")
    authority = folder.authority(NOW)
    for each in [*folder.robots(), *folder.identities()]:
        key = folder.key(each.name)
        folder.write_certificate(each.name, authority.issue_client(key, each, ISSUED, DAYS))
    router, hosts = BusIdentity(ROUTER, Role.ROUTER), folder.hosts(ROUTER)
    folder.write_certificate(
        ROUTER, authority.issue_server(folder.key(ROUTER), router, hosts, ISSUED, DAYS)
    )
    provision_operators(folder, NOW, rights=read_rights(folder))
    return folder.path


@pytest.fixture
def folder(made_once: Path, tmp_path: Path) -> KeyFolder:
    return KeyFolder(shutil.copytree(made_once, tmp_path / "fleet"))


@contextmanager
def serving(folder: KeyFolder, now: datetime = NOW, **answers: Answer) -> Generator[str]:
    """Serve renewals of a folder at a given time."""
    renewals = Renewals(folder, folder.authority(NOW), DAYS, lambda: now)
    changed = {("POST", f"/{name}"): answer for name, answer in answers.items()}
    with AuthorityServer(folder, 0, renewals.answers | changed) as server:
        yield f"https://127.0.0.1:{server.port}"


def own_copy(folder: KeyFolder, name: str, path: Path) -> Path:
    """Copy the files of a client to a separate folder, as on its machine."""
    path.mkdir(parents=True)
    for file in folder.files_of(name):
        shutil.copy(file, path / file.name)
    return path


def renewal_of(url: str, path: Path, name: str) -> CertificateRenewal:
    own = ClientFiles(path / f"{name}.pem", path / f"{name}.key")
    return CertificateRenewal(url, own, path / "ca.pem", path / OPERATORS)


@given(st.integers(1, 3650), st.floats(0.0, 1.2))
def test_a_certificate_is_due_in_the_last_third_of_its_life(days: int, share: float) -> None:
    certificate = _AUTHORITY.issue_client(
        _KEY, client("alice", Role.OPERATOR), NOW, min(days, 3000)
    )
    start, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    now = start + share * (end - start)
    assert is_due(certificate, now) == (share > 2.0 / 3.0) or abs(share - 2.0 / 3.0) < 1e-6


@pytest.mark.parametrize("name", ["lab1", "alice", "guest", "camera", "tape"])
def test_a_client_gets_a_certificate_with_its_key_name_and_role(
    folder: KeyFolder, tmp_path: Path, name: str
) -> None:
    path = own_copy(folder, name, tmp_path / "own")
    before = content(path)
    with serving(folder) as url:
        renewal_of(url, path, name).update(NOW)
    new = read_certificate(path / f"{name}.pem")
    assert new == read_certificate(folder.certificate_file(name))
    assert new.not_valid_after_utc == NOW + timedelta(days=DAYS)
    assert new.public_key() == read_key(path / f"{name}.key").public_key()
    old = x509.load_pem_x509_certificate(before[f"{name}.pem"])
    assert is_for_same(new, old)
    assert new.extensions.get_extension_for_class(_USAGE) == old.extensions.get_extension_for_class(
        _USAGE
    )
    after = content(path)
    assert {file for file in after if after[file] != before.get(file)} <= {f"{name}.pem", OPERATORS}


def test_a_certificate_that_is_not_due_is_kept(folder: KeyFolder, tmp_path: Path) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    before = content(path), content(folder.path)
    early = ISSUED + timedelta(days=10)
    with serving(folder, early) as url:
        renewal_of(url, path, "lab1").update(early)
        renewal_of(url, path, "lab1").update(NOW)  # A wrong clock makes no difference.
    assert (content(path), content(folder.path)) == before


def remove(folder: KeyFolder) -> None:
    folder.certificate_file("lab1").unlink()


def enrol_again(folder: KeyFolder) -> None:
    enrol_robot(folder, folder.authority(NOW), "lab1", new_key().public_key(), NOW, DAYS)


def change_role(folder: KeyFolder) -> None:
    key = read_key(folder.key_file("lab1"))
    identity = client("lab1", Role.VIEWER)
    folder.write_certificate("lab1", folder.authority(NOW).issue_client(key, identity, NOW, DAYS))


@pytest.mark.parametrize("change", [remove, enrol_again, change_role])
def test_a_certificate_that_the_folder_no_longer_has_is_not_renewed(
    folder: KeyFolder, tmp_path: Path, change: Callable[[KeyFolder], None]
) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    change(folder)
    before = content(path), content(folder.path)
    with serving(folder) as url, pytest.raises(EnrolmentError) as caught:
        renewal_of(url, path, "lab1").update(NOW)
    assert caught.value.refusal is Refusal.REVOKED
    assert (content(path), content(folder.path)) == before


def test_who_has_no_certificate_gets_nothing(folder: KeyFolder) -> None:
    authority = folder.authority_certificate()
    with serving(folder) as url:
        for path, body in ((RENEW_PATH, b""), (OPERATORS_PATH, None)):
            with pytest.raises(EnrolmentError) as caught:
                AuthorityClient(url, 0).send(authority, path, body)
            assert caught.value.refusal is Refusal.REVOKED


@pytest.mark.parametrize("is_expired", [False, True])
def test_an_expired_or_foreign_certificate_gets_nothing(
    folder: KeyFolder, tmp_path: Path, *, is_expired: bool
) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    authority = folder.authority(NOW) if is_expired else CertificateAuthority.new(new_key(), NOW)
    key, start = read_key(path / "lab1.key"), NOW - timedelta(days=2 * is_expired)
    shown = authority.issue_client(key, robot_identity("lab1"), start, 1)
    (path / "lab1.pem").write_text(certificate_pem(shown))
    before = content(folder.path)
    with serving(folder) as url, pytest.raises(TwinError):
        renewal_of(url, path, "lab1").update(NOW)
    assert (path / "lab1.pem").read_text() == certificate_pem(shown)
    assert content(folder.path) == before


def forged(folder: KeyFolder) -> list[bytes]:
    """Return replies of a process with the router's key but not the authority's."""
    ours, theirs = folder.authority(NOW), CertificateAuthority.new(new_key(), NOW)
    key = read_key(folder.key_file("lab1"))

    def pem(
        authority: CertificateAuthority, identity: BusIdentity, own: bool, now: datetime
    ) -> bytes:
        used = key if own else new_key()
        return certificate_pem(authority.issue_client(used, identity, now, DAYS)).encode()

    lab1, lab2 = robot_identity("lab1"), robot_identity("lab2")
    return [
        b"",
        b"[" * 60_000,
        pem(theirs, lab1, True, NOW),
        pem(ours, lab1, False, NOW),
        pem(ours, lab2, True, NOW),
        pem(ours, client("lab1", Role.OPERATOR), True, NOW),
    ]


@pytest.mark.parametrize("number", range(6))
def test_a_client_refuses_a_certificate_that_is_not_its_own(
    folder: KeyFolder, tmp_path: Path, number: int
) -> None:
    path, reply = own_copy(folder, "lab1", tmp_path / "own"), forged(folder)[number]
    before = content(path)
    with serving(folder, renew=lambda _: reply) as url, pytest.raises(TwinError, match="sent"):
        renewal_of(url, path, "lab1").update(NOW)
    assert content(path) == before


def test_an_older_certificate_does_not_replace_a_newer_one(
    folder: KeyFolder, tmp_path: Path
) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    old = folder.certificate_file("lab1").read_bytes()
    with serving(folder) as url:
        renewal_of(url, path, "lab1").update(NOW)
        newer = content(path)
    with serving(folder, renew=lambda _: old) as url:
        renewal_of(url, path, "lab1").update(NOW + timedelta(days=25))
    assert content(path) == newer


def test_a_server_of_another_authority_is_not_asked(folder: KeyFolder, tmp_path: Path) -> None:
    path, asked = own_copy(folder, "lab1", tmp_path / "own"), list[bytes]()
    theirs = make_router_keys(tmp_path / "theirs")

    def spy(_: object) -> bytes:
        asked.append(b"")
        return b""

    with serving(theirs, renew=spy) as url, pytest.raises(TwinError, match="no valid certificate"):
        renewal_of(url, path, "lab1").update(NOW)
    assert asked == []


def test_the_router_is_renewed_in_its_folder_with_the_same_names(folder: KeyFolder) -> None:
    old, key = read_certificate(folder.certificate_file(ROUTER)), folder.key_file(ROUTER)
    before = key.read_bytes()
    early = ISSUED + timedelta(days=10)
    for now, expected in ((early, False), (NOW, True), (NOW, False)):
        renewals = Renewals(folder, folder.authority(NOW), DAYS, lambda now=now: now)
        assert renewals.renew_router() == expected
    new = read_certificate(folder.certificate_file(ROUTER))
    assert new.not_valid_after_utc > old.not_valid_after_utc
    assert hosts_of(new) == hosts_of(old)
    assert is_for_same(new, old)
    assert key.read_bytes() == before
    with serving(folder) as url:  # Clients accept it.
        AuthorityClient(url, 0).send(folder.authority_certificate(), "/ca.pem")


def test_the_list_of_operators_reaches_robots_and_never_goes_back(
    folder: KeyFolder, tmp_path: Path
) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    used = OperatorFile(path / OPERATORS)
    old = (folder.path / OPERATORS).read_bytes()
    provision_operators(folder, NOW, rights=read_rights(folder), revoked=["alice"])
    with serving(folder) as url:
        renewal = renewal_of(url, path, "lab1")
        renewal.update(NOW)
        newer = used.poll()
        assert newer is not None
        assert newer.revoked
        (folder.path / OPERATORS).write_bytes(old)
        renewal.update(NOW)
        assert used.poll() is None
        (folder.path / OPERATORS).write_bytes(b"nonsense")
        with pytest.raises(TwinError, match="not signed"):
            renewal.update(NOW)
        assert used.poll() is None
        (path / OPERATORS).write_bytes(b"damaged")
        (folder.path / OPERATORS).write_bytes(old)
        renewal.update(NOW)  # A robot needs a readable list at startup.
        assert (path / OPERATORS).read_bytes() == old


def test_a_lasting_fault_is_logged_once(
    folder: KeyFolder, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = own_copy(folder, "lab1", tmp_path / "own")
    renewal = renewal_of("https://127.0.0.1:1", path, "lab1")
    ended = threading.Event()
    ended.set()
    for _ in range(3):
        renewal.run(ended, 0.0)
    assert len(caplog.records) == 1
    assert "does not answer" in caplog.text
    assert identity_of(read_certificate(path / "lab1.pem")) == robot_identity("lab1")
