"""A robot joins a router with the line printed by `tsd-certs`, in separate processes."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.link_sockets import free_port
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, from_file
from tsd_twin.messages.topics import Service

pytestmark = pytest.mark.system

Start = Callable[..., Program]


@pytest.fixture
def fleet(start: Start, tmp_path: Path) -> Path:
    """Router folder with two reserved robots."""
    where = f"tls/127.0.0.1:{free_port()}"
    robots = ("--robot", "lab1", "--robot", "lab2", "--operator", "alice", "--robots", "lab1")
    flags = ("--router-host", "127.0.0.1", "--listen", where, *robots)
    assert start("tsd_certs", str(tmp_path / "fleet"), *flags).wait() == 0
    return tmp_path / "fleet"


def printed_flags(certs: Program) -> list[list[str]]:
    """Return the flags in the printed line for each robot."""
    lines = [shlex.split(line) for line in certs.output if "--join" in line]
    assert all(line.pop(0) == "tsd-bridge" for line in lines)
    return lines


def test_a_robot_joins_with_one_line_and_runs_without_a_restart(
    start: Start, fleet: Path, tmp_path: Path
) -> None:
    router = start("tsd_router", str(fleet / "router.json5"))
    router.ready()
    enrolment = ("--enrol", "lab1", "--enrol", "lab2", "--enrol-port", "0")
    certs = start("tsd_certs", str(fleet), *enrolment)
    certs.ready()
    first, second = printed_flags(certs)
    keys = str(tmp_path / "robot")
    mock = start("tsd_mock", *first, "--keys", keys)
    assert mock.ready().split()[2] == "lab1"
    assert f"joined as lab1: using {keys}/lab1.json5" in mock.output
    with Bus(from_file(str(fleet / "alice.json5"))) as alice:
        assert alice.query(Service.DESC.key("lab1"), b"", PATIENCE_S)
        assert alice.query(Service.LEASE.key("lab1"), b"{}", PATIENCE_S)
    assert mock.end() == 0

    # The files exist, so it does not ask again, and a second computer is refused.
    mock = start("tsd_mock", "--join", first[1], "--keys", keys)
    assert mock.ready().split()[2] == "lab1"
    assert f"lab1 has joined already: using {keys}/lab1.json5" in mock.output
    assert mock.end() == 0
    again = start("tsd_mock", *first, "--keys", str(tmp_path / "again"))
    assert again.wait() == 1
    assert "the code has been used already" in again.sentence
    assert not (tmp_path / "again").exists()

    other = start("tsd_mock", *second, "--keys", str(tmp_path / "other"))
    assert other.ready().split()[2] == "lab2"
    assert certs.wait() == 0  # All robots have joined.
    assert other.end() == router.end() == 0
    report = start("tsd_certs", str(fleet))
    assert report.wait() == 0
    assert sum("has its own key" in line for line in report.output) == 2


def test_enrolment_that_is_ended_makes_its_code_worthless(
    start: Start, fleet: Path, tmp_path: Path
) -> None:
    certs = start("tsd_certs", str(fleet), "--enrol", "lab1", "--enrol-port", "0")
    certs.ready()
    assert certs.end() == 0
    restarted = start("tsd_certs", str(fleet), "--enrol", "lab1", "--enrol-port", "0")
    restarted.ready()
    (old,), (new,) = printed_flags(certs), printed_flags(restarted)
    late = start("tsd_mock", "--join", new[1], "--code", old[3], "--keys", str(tmp_path / "robot"))
    assert late.wait() == 1
    assert "the code is not that of a robot" in late.sentence
    gone = start("tsd_mock", *old, "--keys", str(tmp_path / "robot"))
    assert gone.wait() == 1
    assert "does not answer" in gone.sentence
    assert not (tmp_path / "robot").exists()
    assert (fleet / "lab1.key").exists()
    assert restarted.end() == 0


def test_a_folder_that_cannot_be_used_is_named(start: Start, fleet: Path, tmp_path: Path) -> None:
    certs = start("tsd_certs", str(fleet), "--enrol", "lab1", "--enrol-port", "0")
    certs.ready()
    (flags,) = printed_flags(certs)
    (tmp_path / "file").write_text("")
    for keys, words in (("n" * 300, "cannot be used"), ("file", "cannot be made")):
        mock = start("tsd_mock", *flags, "--keys", str(tmp_path / keys))
        assert mock.wait() == 1
        assert words in mock.sentence
        assert len(mock.errors) == 1
    several = start("tsd_mock", *flags, "--keys", str(fleet))
    assert several.wait() == 1
    assert "choose one with --id: alice, lab1, lab2, router" in several.sentence
    assert certs.end() == 0
