"""`tsd-mock` as a user runs it: ready line, shutdown and error messages."""

from __future__ import annotations

import json
import signal
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.app.mistaken_programs import start_each
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config
from tsd_twin.errors import NoAnswerError
from tsd_twin.messages.status import decode_status
from tsd_twin.messages.topics import STATUS, Sample, Service, alive_key

pytestmark = pytest.mark.system

Start = Callable[..., Program]
ANY_PORT = ("--listen", "tcp/127.0.0.1:0")


def description(bus: Bus, robot: str) -> bytes:
    """Query until a reply arrives, because the session connects in the background."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return bus.query(Service.DESC.key(robot), b"")
        except NoAnswerError:
            assert time.monotonic() < end_s, "no answer"


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_listens_and_ends_with_zero_when_told(
    start: Start, signal_number: int
) -> None:
    mock = start("tsd_mock", *ANY_PORT)
    endpoint = mock.ready().split()[-1]
    with Bus(client_config([endpoint])) as bus:
        reply = json.loads(description(bus, "tsd"))
    assert robots.parse_description(reply["robot"], "desc").name == "tsd"
    assert reply["urdf"].startswith("<")
    assert mock.end(signal_number) == 0
    assert mock.sentence == ""


def test_it_ends_with_its_standard_input(start: Start) -> None:
    mock = start("tsd_mock", *ANY_PORT, "--until-eof")
    mock.ready()
    assert mock.process.stdin is not None
    mock.process.stdin.close()
    assert mock.wait() == 0


def test_a_robot_of_ones_own_runs_under_its_own_name(start: Start, tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    text = robots.read_description("tsd").replace('name = "tsd"', 'name = "mine"')
    mine.write_text(text.replace("pivot_radius_m = 0.15", "pivot_radius_m = 0.2"))
    mock = start("tsd_mock", "--robot", str(mine), *ANY_PORT)
    endpoint = mock.ready().split()[-1]
    with Bus(client_config([endpoint])) as bus:
        assert "0.2" in json.loads(description(bus, "mine"))["robot"]


def test_a_mistake_ends_in_one_clear_sentence(tmp_path: Path) -> None:
    mistakes = [
        (["--robot", "tds"], ["no such robot", "did you mean 'tsd'"]),
        (["--robot", "missing/my.toml"], ["missing/my.toml", "cannot be read"]),
        (["--listen", "nonsense"], ["'nonsense' is no endpoint", "tcp/127.0.0.1:7447"]),
        (["--listen", "tcp/0.0.0.0:7447"], ["TLS and access control", "--zenoh-config"]),
        (["--zenoh-config", "missing.json5"], ["missing.json5"]),
        ([*ANY_PORT, "--id", "Not An Id"], ["'Not An Id' cannot be an id"]),
        ([*ANY_PORT, "--jam", "module9_alpha"], ["'module9_alpha' is no gimbal of tsd"]),
        ([*ANY_PORT, "--robot", "atlas", "--camera"], ["--camera", "only its sphere turns"]),
        (["--colour", "red"], ["unrecognized arguments: --colour red"]),
        (
            ["--robot", "misspelt.toml"],
            ["misspelt.toml", "max_tlit_deg", "did you mean 'max_tilt_deg'"],
        ),
    ]
    misspelt = robots.read_description("tsd").replace("max_tilt_deg", "max_tlit_deg")
    (tmp_path / "misspelt.toml").write_text(misspelt)
    ended = start_each("tsd_mock", [arguments for arguments, _ in mistakes], tmp_path)
    for (arguments, words), mock in zip(mistakes, ended, strict=True):
        assert mock.code != 0, arguments
        assert "Traceback" not in mock.said
        # The usage lines before the error may wrap.
        said = mock.said.splitlines()
        assert len([x for x in said if not x.startswith(("usage:", " ")) and x.strip()]) == 1
        for word in words:
            assert word in mock.said, arguments


def test_a_port_in_use_is_named(start: Start) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        mock = start("tsd_mock", "--listen", f"tcp/127.0.0.1:{port}")
        assert mock.wait() == 1
    assert str(port) in mock.sentence
    assert "already in use" in mock.sentence
    assert len(mock.errors) == 1


def test_a_second_robot_with_the_same_id_refuses_and_the_first_runs_on(start: Start) -> None:
    first = start("tsd_mock", *ANY_PORT)
    endpoint = first.ready().split()[-1]
    second = start("tsd_mock", *ANY_PORT, "--connect", endpoint)
    assert second.wait() == 1
    assert "'tsd' is on the bus already" in second.sentence
    third = start("tsd_mock", *ANY_PORT, "--connect", endpoint, "--id", "other")
    third.ready()
    both = {"twin/tsd/alive", "twin/other/alive"}
    here = threading.Event()
    living: set[str] = set()

    def note(key: str, lives: bool) -> None:
        (living.add if lives else living.discard)(key)
        if living == both:
            here.set()

    with Bus(client_config([endpoint])) as bus:
        bus.subscribe_liveliness(alive_key("*"), note)
        assert here.wait(PATIENCE_S), f"only {living}"
    assert first.process.poll() is None


def test_help_shows_examples(tmp_path: Path) -> None:
    (shown,) = start_each("tsd_mock", [["--help"]], tmp_path)
    assert shown.code == 0
    assert "examples:" in shown.printed
    assert "--robot" in shown.printed


def test_its_camera_tells_the_robot_where_it_is(start: Start) -> None:
    mock = start("tsd_mock", *ANY_PORT, "--camera")
    endpoint = mock.ready().split()[-1]
    seen = threading.Event()

    def look(sample: Sample) -> None:
        pose_sensor = decode_status(sample.payload).pose_sensor
        if pose_sensor is not None and pose_sensor.used > 5 and pose_sensor.latency_s is not None:
            seen.set()

    with Bus(client_config([endpoint])) as bus:
        bus.subscribe(STATUS.key("tsd"), look)
        assert seen.wait(PATIENCE_S)
    assert mock.end(signal.SIGTERM) == 0


def test_it_moves_as_rigid_bodies_when_asked(start: Start) -> None:
    mock = start("tsd_mock", *ANY_PORT, "--plant", "mujoco")
    endpoint = mock.ready().split()[-1]
    heard = threading.Event()
    with Bus(client_config([endpoint])) as bus:
        bus.subscribe(
            STATUS.key("tsd"), lambda sample: heard.set() if b'"mujoco"' in sample.payload else None
        )
        assert heard.wait(PATIENCE_S)
    assert mock.end(signal.SIGTERM) == 0
