"""The user file contains only hashes, is private to its owner, and has helpful errors."""

from __future__ import annotations

import re
from pathlib import Path

import argon2
import pytest

from tsd_twin.errors import TwinError
from tsd_twin.security import Role
from tsd_twin.security.router_rules import EVERY_ROBOT, rights_of_flags
from tsd_twin.security.users import User, Users

PHRASE = "correct horse battery"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    users = Users({})
    users.put("alice", Role.OPERATOR, PHRASE, may_stop=False)
    users.put("eve", Role.VIEWER, "another " + PHRASE, may_stop=True)
    file = tmp_path_factory.mktemp("users") / "users.toml"
    users.save(file)
    return file


@pytest.fixture
def file(written: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "users.toml"
    copy.write_bytes(written.read_bytes())
    copy.chmod(0o600)
    return copy


def test_what_was_written_is_read_again_and_holds_no_password(written: Path) -> None:
    text = written.read_text()
    assert PHRASE not in text
    assert len(re.findall(r'"\$argon2id\$v=19\$m=65536,t=3,p=4\$', text)) == 2
    assert written.stat().st_mode & 0o777 == 0o600
    users = Users.load(written)
    assert users.names == ["alice", "eve"]
    assert users.user("eve") == User("eve", Role.VIEWER, may_stop=True)
    assert users.user("alice").may_stop


@pytest.mark.parametrize(
    ("name", "password", "right"),
    [
        ("alice", PHRASE, True),
        ("alice", "another " + PHRASE, False),
        ("alice", PHRASE + "x", False),
        ("alice", "", False),
        ("alice", "x" * 5000, False),
        ("nobody", PHRASE, False),
        ("", "", False),
        ("alice\x00", PHRASE, False),
    ],
)
def test_only_the_password_of_a_name_lets_in(
    written: Path, name: str, password: str, right: bool
) -> None:
    found = Users.load(written).check(name, password)
    assert (found is not None) is right


def test_a_name_that_is_not_there_costs_the_same_work(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both verify one hash with the same parameters, without an earlier return."""
    verified: list[str] = []
    verify = argon2.PasswordHasher.verify

    def counted(hasher: argon2.PasswordHasher, hashed: str, password: str) -> bool:
        verified.append(hashed)
        return verify(hasher, hashed, password)

    monkeypatch.setattr(argon2.PasswordHasher, "verify", counted)
    users = Users.load(written)
    for name in ("alice", "nobody"):
        users.check(name, "wrong")
    assert len(verified) == 2
    assert verified[0].rsplit("$", 2)[0] == verified[1].rsplit("$", 2)[0]


@pytest.mark.parametrize("mode", [0o604, 0o602, 0o620, 0o644, 0o666])
def test_a_file_that_others_can_read_or_change_is_refused_with_what_to_do(
    file: Path, mode: int
) -> None:
    file.chmod(mode)
    with pytest.raises(TwinError, match="chmod 600"):
        Users.load(file)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "lists no user"),
        ("[users.alice]\nrole = 'operator'\nargon2 = 'secret'\n", "no argon2 hash"),
        ("[users.alice]\nrole = 'operator'\npassword = 'secret'\n", "no file of users"),
        ("[users.alice]\nrole = 'robot'\nargon2 = ''\n", "not operator or viewer"),
        ("[users.'A b']\nrole = 'viewer'\nargon2 = ''\n", "A b"),
        ("[users", "no file of users"),
        ("\xff", "no file of users"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_sentence(file: Path, text: str, sentence: str) -> None:
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(TwinError, match=sentence):
        Users.load(file)


def test_short_passwords_bad_names_and_strangers_are_refused(tmp_path: Path) -> None:
    users = Users({})
    with pytest.raises(TwinError, match="characters"):
        users.put("alice", Role.OPERATOR, "short", may_stop=False)
    with pytest.raises(TwinError):
        users.put("Alice!", Role.OPERATOR, PHRASE, may_stop=False)
    with pytest.raises(TwinError, match="no 'bob'"):
        users.remove("bob")
    with pytest.raises(TwinError, match="cannot be read"):
        Users.load(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("robots", "watch", "use", "seen", "hidden"),
    [
        (None, None, ["lab1", "lab9"], ["lab1"], []),
        ("lab1,lab2", None, ["lab1", "lab2"], [], ["lab3"]),
        ("lab1", "lab2", ["lab1"], ["lab2"], ["lab3"]),
        (None, "lab2", [], ["lab2"], ["lab1"]),
        ("lab1", "all", ["lab1"], ["lab2", "lab3"], []),
        ("all", "lab1", ["lab1", "lab2"], ["lab1"], []),
    ],
)
def test_robots_of_a_user_are_kept_in_the_file(
    tmp_path: Path,
    robots: str | None,
    watch: str | None,
    use: list[str],
    seen: list[str],
    hidden: list[str],
) -> None:
    users = Users({})
    rights = rights_of_flags(robots, watch) or EVERY_ROBOT
    users.put("alice", Role.OPERATOR, PHRASE, may_stop=False, rights=rights)
    users.save(tmp_path / "users.toml")
    kept = Users.load(tmp_path / "users.toml").user("alice").rights
    assert all(kept.may_use(robot) and kept.may_watch(robot) for robot in use)
    assert all(kept.may_watch(robot) for robot in seen)
    assert not [robot for robot in hidden if kept.may_watch(robot) or kept.may_use(robot)]
    assert all(robot in use or not kept.may_use(robot) for robot in seen)


@pytest.mark.parametrize("text", ["", ",", "lab1,", "Lab1", "lab 1", "*"])
def test_a_list_of_robots_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(TwinError):
        rights_of_flags(text, None)
