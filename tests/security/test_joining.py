"""A robot joins over HTTPS only a gateway with code and authority, and never partially."""

from __future__ import annotations

import shutil
import socket
import ssl
import stat
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from http.client import HTTPSConnection
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from tests.support.key_folders import content
from tests.support.secured_robot import make_router_keys
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import from_file
from tsd_twin.errors import TwinError
from tsd_twin.security import authority_server, joining
from tsd_twin.security.authority_server import AuthorityServer, Request, boot_time_s
from tsd_twin.security.certificates import (
    CertificateAuthority,
    PublicKey,
    certificate_pem,
    new_key,
    read_certificate,
    read_key,
)
from tsd_twin.security.enrolment import (
    JOIN_PATH,
    LARGEST_BYTES,
    EnrolmentCode,
    EnrolmentError,
    Enrolments,
    Joined,
    JoinRequest,
    Refusal,
    fingerprint,
    requested_key,
    seal,
    unseal,
)
from tsd_twin.security.joining import join
from tsd_twin.security.key_folder import KeyFolder, certificate_identity
from tsd_twin.security.operator_keys import provision_operators
from tsd_twin.security.operator_list import OperatorFile
from tsd_twin.security.router_keys import enrol_robot, read_rights, robot_identity

pytestmark = pytest.mark.system

NOW = datetime.now(UTC)


def made(path: Path) -> KeyFolder:
    folder = make_router_keys(path)
    provision_operators(folder, NOW, rights=read_rights(folder))
    return folder


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the folders of two authorities."""
    path = tmp_path_factory.mktemp("authorities")
    return made(path / "ours").path, made(path / "theirs").path


class Desk:
    """Gateway with the keys of a folder, and a code for a robot."""

    def __init__(self, folder: KeyFolder) -> None:
        self.folder = folder
        self.authority = folder.authority(NOW)
        self.issued: list[str] = []
        self.code = EnrolmentCode.new(self.authority.certificate)
        self.key = self.code.key(self.authority.certificate)
        self.enrolments = Enrolments(self.issue)
        self.enrolments.offer("lab1", self.key, boot_time_s())

    def issue(self, robot: str, key: PublicKey) -> Joined:
        self.issued.append(robot)
        return enrol_robot(self.folder, self.authority, robot, key, NOW, 30)

    @contextmanager
    def serving(self, enrolments: Enrolments | None = None) -> Generator[str]:
        """Serve these keys, possibly with the replies of another gateway."""
        served = enrolments or self.enrolments

        def answer(request: Request) -> bytes:
            return served.answer(request.body, request.network, boot_time_s())

        with AuthorityServer(self.folder, 0, {("POST", JOIN_PATH): answer}) as server:
            yield f"https://127.0.0.1:{server.port}"


class Answering:
    """Replaces `Enrolments` in a gateway with chosen replies."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self._answer = answer

    def answer(self, message: bytes, _address: str, _now_s: float) -> bytes:
        return self._answer(message)


def answering(answer: Callable[[bytes], bytes]) -> Enrolments:
    return cast("Enrolments", Answering(answer))


@pytest.fixture
def desk(made_once: tuple[Path, Path], tmp_path: Path) -> Desk:
    return Desk(KeyFolder(shutil.copytree(made_once[0], tmp_path / "fleet")))


@pytest.fixture
def theirs(made_once: tuple[Path, Path], tmp_path: Path) -> Desk:
    return Desk(KeyFolder(shutil.copytree(made_once[1], tmp_path / "theirs")))


def test_a_robot_gets_all_files_with_the_modes_of_tsd_certs(desk: Desk, tmp_path: Path) -> None:
    path = tmp_path / "robot" / "keys"
    old = content(desk.folder.path)
    with desk.serving() as url:
        file = join(url, desk.code, path)
        assert desk.enrolments.open_robots(boot_time_s()) == []
    assert file == path / "lab1.json5"
    assert from_file(str(file)).robot == "lab1"
    assert sorted(content(path)) == [
        "ca.pem",
        "lab1.json5",
        "lab1.key",
        "lab1.pem",
        "operators.json",
    ]
    for name in ("ca.pem", "lab1.json5", "operators.json"):
        assert content(path)[name] == old[name]
    modes = {file.name: stat.S_IMODE(file.stat().st_mode) for file in path.iterdir()}
    assert {name for name, mode in modes.items() if mode == 0o600} == {"lab1.key"}
    assert stat.S_IMODE(path.stat().st_mode) == 0o700
    certificate = read_certificate(path / "lab1.pem")
    assert certificate.public_key() == read_key(path / "lab1.key").public_key()
    assert certificate_identity(path / "lab1.pem") == robot_identity("lab1")
    OperatorFile(path / "operators.json")
    # The private key has not left the robot, and the one from the reservation is gone.
    new = content(desk.folder.path)
    assert {name for name in old if new.get(name) != old[name]} == {"lab1.pem", "lab1.key"}
    assert set(old) - set(new) == {"lab1.key"}


def test_a_second_computer_gets_nothing(desk: Desk, tmp_path: Path) -> None:
    with desk.serving() as url:
        join(url, desk.code, tmp_path / "first")
        with pytest.raises(EnrolmentError, match="used already"):
            join(url, desk.code, tmp_path / "second")
    assert not (tmp_path / "second").exists()
    assert desk.issued == ["lab1"]


def test_an_expired_code_gives_nothing(desk: Desk, tmp_path: Path) -> None:
    late = Enrolments(desk.issue)
    late.offer("lab1", desk.key, boot_time_s() - 600.0)
    with desk.serving(late) as url, pytest.raises(EnrolmentError, match="expired"):
        join(url, desk.code, tmp_path / "robot")
    assert not (tmp_path / "robot").exists()
    assert desk.issued == []


def test_another_robot_than_expected_is_refused(desk: Desk, tmp_path: Path) -> None:
    with desk.serving() as url:
        with pytest.raises(EnrolmentError, match="another name"):
            join(url, desk.code, tmp_path / "robot", "lab2")
        assert not (tmp_path / "robot").exists()
        join(url, desk.code, tmp_path / "robot", "lab1")


def test_wrong_codes_are_slowed_down(desk: Desk, tmp_path: Path) -> None:
    wrong = EnrolmentCode("0" * 10, desk.code.fingerprint)
    refusals: list[Refusal] = []
    with desk.serving() as url:
        for _ in range(7):
            with pytest.raises(EnrolmentError) as caught:
                join(url, wrong, tmp_path / "robot")
            refusals.append(caught.value.refusal)
        with pytest.raises(EnrolmentError, match="too many codes were tried"):
            join(url, desk.code, tmp_path / "robot")
    assert refusals == [Refusal.WRONG] * 5 + [Refusal.WAIT] * 2
    assert not (tmp_path / "robot").exists()
    assert desk.issued == []


def test_a_gateway_of_another_authority_learns_nothing(
    desk: Desk, theirs: Desk, tmp_path: Path
) -> None:
    asked: list[bytes] = []
    spy = answering(lambda message: asked.append(message) or b"")
    with theirs.serving(spy) as url, pytest.raises(TwinError, match="another authority"):
        join(url, desk.code, tmp_path / "robot")
    assert asked == []
    assert not (tmp_path / "robot").exists()


def forgeries(theirs: Desk) -> list[Callable[[bytes], bytes]]:
    """Return replies of a gateway without the code."""

    def stolen(message: bytes) -> bytes:  # It generated another code and robot.
        key = new_key().public_key()
        return seal(
            theirs.key, enrol_robot(theirs.folder, theirs.authority, "lab1", key, NOW, 30), message
        )

    return [
        stolen,
        lambda message: message,
        lambda _: b"",
        lambda _: b"{}",
        lambda _: b"[" * 60_000,
    ]


@pytest.mark.parametrize("number", range(5))
def test_a_forged_authority_with_the_same_fingerprint_is_refused(
    desk: Desk, theirs: Desk, tmp_path: Path, number: int
) -> None:
    """An attacker can find an authority with the fingerprint in the code by trying 2^30."""
    code = EnrolmentCode(desk.code.secret, fingerprint(theirs.authority.certificate))
    forged = answering(forgeries(theirs)[number])
    with theirs.serving(forged) as url, pytest.raises(TwinError, match="does not know this code"):
        join(url, code, tmp_path / "robot")
    assert not (tmp_path / "robot").exists()


@pytest.mark.parametrize("name", ["lab2", "alice"])
def test_a_client_of_the_authority_cannot_act_as_gateway(
    desk: Desk, tmp_path: Path, name: str
) -> None:
    for suffix in ("pem", "key"):
        shutil.copy(desk.folder.path / f"{name}.{suffix}", desk.folder.path / f"router.{suffix}")
    with desk.serving() as url, pytest.raises(TwinError, match="no valid certificate of the auth"):
        join(url, desk.code, tmp_path / "robot")
    assert not (tmp_path / "robot").exists()
    assert desk.issued == []


def test_a_forged_authority_in_front_of_a_real_gateway_fails_the_handshake(
    desk: Desk, theirs: Desk, tmp_path: Path
) -> None:
    own = certificate_pem(theirs.authority.certificate).encode()
    shutil.copy(theirs.folder.path / "router.pem", desk.folder.path / "router.pem")
    shutil.copy(theirs.folder.path / "router.key", desk.folder.path / "router.key")
    assert own != (desk.folder.path / "ca.pem").read_bytes()
    with desk.serving() as url, pytest.raises(TwinError, match="no valid certificate of the auth"):
        join(url, desk.code, tmp_path / "robot")
    assert not (tmp_path / "robot").exists()


def test_a_certificate_for_another_key_name_or_role_is_refused(desk: Desk, tmp_path: Path) -> None:
    def answer(certificate: Callable[[PublicKey], str], name: str = "lab1") -> Enrolments:
        def reply(message: bytes) -> bytes:
            request = unseal(desk.key, message, JoinRequest)
            joined = Joined(name, certificate(requested_key(request.csr)), "{}", "{}")
            return seal(desk.key, joined, message)

        return answering(reply)

    def issue(name: str, authority: CertificateAuthority) -> Callable[[PublicKey], str]:
        identity = robot_identity(name)
        return lambda key: certificate_pem(authority.issue_client(key, identity, NOW, 30))

    stranger = CertificateAuthority.new(new_key(), NOW)
    other = issue("lab1", desk.authority)(new_key().public_key())
    wrong = [
        answer(lambda _: other),
        answer(issue("lab2", desk.authority)),
        answer(issue("lab1", stranger)),
        answer(lambda _: "no certificate"),
        answer(issue("lab1", desk.authority), "../lab1"),
        answer(issue("lab1", desk.authority), "ca"),
    ]
    for enrolments in wrong:
        with desk.serving(enrolments) as url, pytest.raises(TwinError):
            join(url, desk.code, tmp_path / "robot")
        assert not (tmp_path / "robot").exists()


def test_a_lost_answer_is_given_again(desk: Desk, tmp_path: Path) -> None:
    def lose(message: bytes) -> bytes:
        desk.enrolments.answer(message, "robot", boot_time_s())
        raise ConnectionAbortedError

    with desk.serving(answering(lose)) as url, pytest.raises(TwinError, match="does not answer"):
        join(url, desk.code, tmp_path / "robot")
    assert [file.name for file in (tmp_path / "robot").iterdir()] == [".joining.key"]
    with desk.serving() as url:
        assert join(url, desk.code, tmp_path / "robot").exists()
    assert desk.issued == ["lab1"]


@pytest.mark.parametrize("writes", range(6))
def test_a_robot_that_is_killed_while_writing_continues(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    class Killed(BaseException):
        pass

    path, left = tmp_path / "robot", [writes]
    replace_file = joining.replace_file

    def replace(file: Path, text: bytes, mode: int = 0o644) -> None:
        if left[0] == 0:
            file.with_name(f"{file.name}.new").write_bytes(text[: len(text) // 2])
            raise Killed
        left[0] -= 1
        replace_file(file, text, mode)

    with desk.serving() as url:
        with monkeypatch.context() as patch:
            patch.setattr(joining, "replace_file", replace)
            with pytest.raises(Killed):
                join(url, desk.code, path)
        assert not (path / "lab1.json5").exists()
        assert from_file(str(join(url, desk.code, path))).robot == "lab1"
    assert desk.issued == ["lab1"]
    assert not [name for name in content(path) if name.startswith(".") or name.endswith(".new")]


def test_keys_that_are_there_are_kept(desk: Desk, theirs: Desk, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    with theirs.serving() as url:
        join(url, theirs.code, first)
    second.mkdir()
    (second / "lab1.key").write_bytes((theirs.folder.path / "lab2.key").read_bytes())
    before = content(first), content(second)
    with desk.serving() as url:
        with pytest.raises(TwinError, match="keys of another authority"):
            join(url, desk.code, first)
        with pytest.raises(TwinError, match=r"lab1\.key exists already"):
            join(url, desk.code, second)
        assert content(first) == before[0]
        assert content(second)["lab1.key"] == before[1]["lab1.key"]
        (second / "lab1.key").unlink()
        assert join(url, desk.code, second).exists()


def test_clients_that_stall_or_send_junk_delay_nobody(desk: Desk, tmp_path: Path) -> None:
    with desk.serving() as url, ExitStack() as stack:
        port = int(url.rpartition(":")[2])
        for junk in (b"", b"", b"", b"GET / HTTP/1.0\r\n\r\n", b"\x16\x03\x01\xff\xff" + bytes(99)):
            idle = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            idle.sendall(junk)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(desk.folder.path / "ca.pem")
        for method, target, headers, status in [
            ("GET", "/ca.key", {}, 404),
            ("GET", "/../ca.key", {}, 404),
            ("POST", "/", {}, 404),
            ("POST", "/join", {"Content-Length": str(LARGEST_BYTES + 1)}, 413),
            ("POST", "/join", {"Content-Length": "-1"}, 413),
            ("POST", "/join", {"Content-Length": "0"}, 403),
            ("PUT", "/join", {}, 501),
        ]:
            connection = HTTPSConnection("127.0.0.1", port, timeout=5.0, context=context)
            connection.request(method, target, headers=headers)
            response = connection.getresponse()
            assert response.status == status
            assert b"PRIVATE" not in response.read()
            connection.close()
        join(url, desk.code, tmp_path / "robot")


def test_connections_are_limited_and_free_again(desk: Desk, tmp_path: Path) -> None:
    with desk.serving() as url:
        with ExitStack() as stack:
            address = ("127.0.0.1", int(url.rpartition(":")[2]))
            for _ in range(authority_server.CONNECTIONS):
                stack.enter_context(socket.create_connection(address))
            with pytest.raises(TwinError, match="does not answer"):
                join(url, desk.code, tmp_path / "robot")
        end_s = boot_time_s() + PATIENCE_S
        while not (tmp_path / "robot").exists() and boot_time_s() < end_s:
            with suppress(TwinError):
                join(url, desk.code, tmp_path / "robot")
    assert desk.issued == ["lab1"]


def test_one_of_several_computers_at_the_same_time_gets_the_code(
    desk: Desk, tmp_path: Path
) -> None:
    def attempt(number: int) -> bool:
        try:
            return join(url, desk.code, tmp_path / str(number)).exists()
        except EnrolmentError:
            return False

    with desk.serving() as url, ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(attempt, range(4))) == [False, False, False, True]
    assert desk.issued == ["lab1"]
    assert len(list(tmp_path.glob("*/lab1.key"))) == 1


@pytest.mark.parametrize(
    "url", ["", "lab", "http://lab.example", "https://", "https://lab:port", "https://lab/x"]
)
def test_an_address_of_another_form_is_refused(desk: Desk, tmp_path: Path, url: str) -> None:
    with pytest.raises(TwinError, match="is not like https://"):
        join(url, desk.code, tmp_path / "robot")


def test_names_that_are_not_reserved_are_not_enrolled(desk: Desk) -> None:
    for name in ("lab3", "alice"):
        with pytest.raises(TwinError, match="is not a robot of this router"):
            enrol_robot(desk.folder, desk.authority, name, new_key().public_key(), NOW, 30)


@pytest.mark.parametrize(
    "reply", [b"", b"\xff", b"[]", b'{"refusal":"none"}', b'{"x":' + b"[" * 9000]
)
def test_a_gateway_that_fails_in_another_way_is_named(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reply: bytes
) -> None:
    encoder = SimpleNamespace(json=SimpleNamespace(encode=lambda _: reply))
    monkeypatch.setattr(authority_server, "msgspec", encoder)

    def refuse(_message: bytes) -> bytes:
        raise EnrolmentError(Refusal.USED)

    with (
        desk.serving(answering(refuse)) as url,
        pytest.raises(TwinError, match=r"failed, see the output of tsd-certs there \(status 403\)"),
    ):
        join(url, desk.code, tmp_path / "robot")
    assert not (tmp_path / "robot").exists()
