"""`tsd-certs` as a user runs it: following its printed instructions works."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, from_file
from tsd_twin.messages.topics import Service, alive_key

pytestmark = pytest.mark.system

Start = Callable[..., Program]
ROBOT = ("--robot-host", "127.0.0.1", "--listen", "tls/127.0.0.1:0")


def printed(program: Program, word: str) -> list[list[str]]:
    """Return the arguments after `word` on each output line that contains it."""
    found = [line.partition(f"{word}  ")[2] for line in program.output if f"{word}  " in line]
    return [shlex.split(text) for text in found]


def test_what_it_prints_makes_a_robot_that_is_reached_with_tls(
    start: Start, tmp_path: Path
) -> None:
    keys, machine = tmp_path / "my keys", tmp_path / "robot"
    certs = start("tsd_certs", str(keys), *ROBOT, "--operator", "alice", "--viewer", "guest")
    assert certs.wait() == 0
    assert certs.sentence == ""
    of_robot, of_alice, of_guest = printed(certs, "copy to its machine")
    machine.mkdir()
    for file in of_robot:
        shutil.copy(file, machine)
    assert str(keys / "ca.key") not in of_robot + of_alice + of_guest
    assert any(str(keys / "ca.key") in line and "offline" in line for line in certs.output)

    command, flag, config = printed(certs, "and run there")[0]
    assert (command, flag) == ("tsd-mock", "--zenoh-config")
    mock = start("tsd_mock", flag, str(machine / Path(config).name))
    endpoint = mock.ready().split()[-1]
    assert endpoint.startswith("tls/127.0.0.1:")

    # The robot chose a free port, so a new guest configuration is needed.
    (keys / "guest.json5").unlink()
    assert start("tsd_certs", str(keys), "--listen", endpoint).wait() == 0
    with Bus(from_file(str(keys / "guest.json5"))) as guest:
        assert guest.wait_for_peer(PATIENCE_S)
        assert set(guest.living_tokens(alive_key("*"), PATIENCE_S)) == {alive_key("tsd")}
        assert guest.query(Service.DESC.key("tsd"), b"", PATIENCE_S)
    assert mock.end() == 0
    assert mock.sentence == ""


def test_it_says_who_there_is_and_whose_time_is_nearly_over(start: Start, tmp_path: Path) -> None:
    keys = str(tmp_path / "keys")
    assert start("tsd_certs", keys, *ROBOT, "--operator", "alice").wait() == 0
    assert start("tsd_certs", keys, "--viewer", "guest", "--days", "3").wait() == 0
    third = start("tsd_certs", keys)
    assert third.wait() == 0
    said = "\n".join(third.output)
    assert "everything is there already" in said
    assert "operator alice, until" in said
    assert "remove guest.pem" in said
    assert "remove alice.pem" not in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["--robot-host"]),
        (["--robot-host", "no host"], ["'no host'", "neither a host name nor an address"]),
        ([*ROBOT, "--operator", "Alice"], ["'Alice' cannot be an id", "a-z"]),
        ([*ROBOT, "--operator", "a", "--viewer", "a"], ["'a' is an operator"]),
        ([*ROBOT, "--operator", "a", "--viewer", "a-b"], ["'a-b' could be a page of 'a'"]),
        ([*ROBOT, "--days", "0"], ["from 1 to 3650"]),
        (["--robot-host", "r", "--listen", "tcp/0.0.0.0:1"], ["robot.json5", "tls/0.0.0.0:7447"]),
        (["--operators", "a"], ["unrecognized arguments"]),
    ],
)
def test_a_mistake_ends_in_one_clear_sentence_and_makes_nothing(
    start: Start, tmp_path: Path, arguments: list[str], words: list[str]
) -> None:
    certs = start("tsd_certs", str(tmp_path / "keys"), *arguments)
    assert certs.wait() != 0
    assert "Traceback" not in certs.sentence
    for word in words:
        assert word in certs.sentence
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_named(start: Start, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    certs = start("tsd_certs", str(tmp_path / "file" / "keys"), *ROBOT)
    assert certs.wait() == 1
    assert f"{tmp_path}/file/keys cannot be made" in certs.sentence
    assert len(certs.errors) == 1


def test_a_key_that_is_missing_on_the_robot_is_named(start: Start, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    assert start("tsd_certs", str(keys), *ROBOT).wait() == 0
    (keys / "robot.key").unlink()
    mock = start("tsd_mock", "--zenoh-config", str(keys / "robot.json5"))
    assert mock.wait() == 1
    assert mock.errors == [
        f"tsd-mock: {keys}/robot.json5 needs {keys}/robot.key, which is not there"
    ]


def test_a_router_with_rights_per_robot_is_reached_as_it_prints(
    start: Start, tmp_path: Path
) -> None:
    keys = tmp_path / "fleet"
    router = ("--router-host", "127.0.0.1", "--listen", "tls/127.0.0.1:0")
    robots = ("--robot", "lab1", "--robot", "lab2")
    assert start("tsd_certs", str(keys), *router, *robots).wait() == 0
    routing = start("tsd_router", str(keys / "router.json5"))
    endpoint = routing.ready().split()[-1]
    people = ("--operator", "alice", "--robots", "lab1", "--watch", "lab2", "--listen", endpoint)
    for file in keys.glob("lab*.json5"):
        file.unlink()  # The router chose a free port, so new configurations are needed.
    certs = start("tsd_certs", str(keys), *people)
    assert certs.wait() == 0
    assert any("operator alice, robots lab1, watches lab2, until" in x for x in certs.output)
    mock = start("tsd_mock", "--id", "lab", "--count", "2", "--zenoh-config", str(keys))
    routing.end()
    start("tsd_router", str(keys / "router.json5")).ready()
    assert "lab2" in mock.ready()
    with Bus(from_file(str(keys / "alice.json5"))) as alice:
        assert alice.query(Service.DESC.key("lab1"), b"", PATIENCE_S)
        assert alice.query(Service.LEASE.key("lab1"), b"{}", PATIENCE_S)
        assert alice.query(Service.DESC.key("lab2"), b"", PATIENCE_S)
        assert alice.query_all(Service.LEASE.key("lab2"), b"{}", 1.0) == []
    other = start("tsd_mock", "--zenoh-config", str(keys / "lab1.json5"), "--id", "lab2")
    assert other.wait() == 1
    assert "no other id is allowed" in other.sentence
    assert mock.end() == 0
    assert start("tsd_certs", str(keys), "--operator", "alice", "--robots", "all").wait() == 0
    assert start("tsd_certs", str(keys), "--viewer", "guest").wait() == 1
