"""`tsd-demo` and `tsd-dashboard` as a user runs them."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import time
import urllib.request
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import pytest

import tsd_twin
from tests.support.link_sockets import free_port
from tests.support.programs import Program, alive, children_of
from tests.support.withheld import PATIENCE_S

pytestmark = pytest.mark.system

Start = Callable[..., Program]
QUIET = ("--no-browser", "--no-record", "--until-eof")
ANY_PORTS = ("--port", "0", "--bus-port", "0")


def health(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url + "healthz") as answer:  # noqa: S310  Our own, on the loopback.
        return json.load(answer)


def address(line: str) -> str:
    return re.findall(r"http://\S+", line)[0]


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_one_signal_ends_everything(start: Start, signal_number: int) -> None:
    demo = start("tsd_demo", *QUIET, *ANY_PORTS)
    url = address(demo.ready())
    children = children_of(demo.process.pid)
    assert len(children) == 2
    robots = health(url)["robots"]
    assert health(url)["ready"] is True
    assert robots["tsd"]["mode"] == "disarmed"
    assert robots["tsd"]["age_s"] < 1.0
    assert demo.end(signal_number) == 0
    assert demo.sentence == ""
    assert not any(alive(child) for child in children)


def test_the_robots_of_a_demo_are_on_one_bus_so_that_all_are_found_and_stopped(
    start: Start,
) -> None:
    line = start("tsd_demo", *QUIET, *ANY_PORTS, "--robot", "omni4", "--robot", "kiwi").ready()
    (endpoint,) = re.findall(r"tcp/[\d.:]+\d", line)
    assert tsd_twin.find(endpoint) == ["kiwi", "omni4"]
    with pytest.raises(tsd_twin.SeveralRobotsFound) as several:
        tsd_twin.connect(endpoint)
    assert several.value.robots == ("kiwi", "omni4")
    assert tsd_twin.stop_all(endpoint) == ["kiwi", "omni4"]
    robots, end_s = health(address(line))["robots"], time.monotonic() + PATIENCE_S
    while {robots[name]["mode"] for name in ("kiwi", "omni4")} != {"stopped"}:
        assert time.monotonic() < end_s, robots
        time.sleep(0.05)
        robots = health(address(line))["robots"]


def test_when_the_demo_is_killed_its_children_end_too(start: Start) -> None:
    demo = start("tsd_demo", *QUIET, *ANY_PORTS)
    demo.ready()
    children = children_of(demo.process.pid)
    demo.end(signal.SIGKILL)
    end_s = time.monotonic() + PATIENCE_S
    while any(alive(child) for child in children):
        assert time.monotonic() < end_s, "they outlive it"
        time.sleep(0.05)


def test_when_the_robot_dies_the_demo_ends(start: Start) -> None:
    demo = start("tsd_demo", *QUIET, *ANY_PORTS)
    demo.ready()
    mock = min(children_of(demo.process.pid))
    os.kill(mock, signal.SIGKILL)
    assert demo.wait() == 0


def test_usual_ports_that_are_taken_are_replaced(start: Start) -> None:
    """The demo reports it, because programs on the default port would find another robot."""
    urls: dict[Program, str] = {}
    buses: dict[Program, str] = {}
    for _ in range(2):
        demo = start("tsd_demo", *QUIET)
        urls[demo] = address(demo.ready())
        buses[demo] = re.findall(r"bus at (\S+?);", demo.ready())[0]
    assert len(set(urls.values())) == len(set(buses.values())) == 2
    for demo in urls:
        assert health(urls[demo])["ready"] is True
        page = urlsplit(urls[demo]).port
        said_of_page = f"port 8080 is in use, so the page is at port {page}" in demo.output
        assert said_of_page == (page != 8080)
        said_of_bus = any(
            line.startswith("port 7447 is in use") and buses[demo] in line for line in demo.output
        )
        assert said_of_bus == (not buses[demo].endswith(":7447"))


def test_a_chosen_port_that_is_taken_is_named(start: Start) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        demo = start("tsd_demo", *QUIET, "--bus-port", "0", "--port", port)
        assert demo.wait() == 1
        dashboard = start("tsd_dashboard", "--port", port)
        assert dashboard.wait() == 1
    for program in (demo, dashboard):
        assert f"port {port}" in program.sentence
        assert len(program.errors) == 1


def test_a_mistake_in_the_robot_is_told_once(start: Start) -> None:
    demo = start("tsd_demo", *QUIET, *ANY_PORTS, "--robot", "tds")
    assert demo.wait() == 1
    assert "did you mean 'tsd'" in demo.sentence
    assert "Traceback" not in demo.sentence


def test_a_dashboard_without_a_robot_serves_and_waits_for_one(start: Start) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
    url = address(dashboard.ready())
    report = health(url)
    assert (report["ready"], report["robots"]) == (False, {})
    start("tsd_mock", "--listen", endpoint).ready()
    end_s = time.monotonic() + PATIENCE_S
    while not health(url)["ready"]:
        assert time.monotonic() < end_s, "the robot is not found"
        time.sleep(0.1)
    assert dashboard.end() == 0


def test_other_machines_are_refused_with_a_sentence(start: Start) -> None:
    dashboard = start("tsd_dashboard", "--host", "0.0.0.0", "--port", "0")
    assert dashboard.wait() == 1
    assert "0.0.0.0" in dashboard.sentence
    assert len(dashboard.errors) == 1
