"""Plot values: a page receives exactly the fields it requests, as sent by the robot."""

from __future__ import annotations

import re
import time
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.page_client import Page, Site, site
from tests.support.scene_doubles import RobotFeed
from tsd_twin import robots
from tsd_twin.client.connection import SentCommand
from tsd_twin.dashboard.sessions.plot_fields import REQUEST_TIMEOUT_S, PlotFields
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.dashboard.wire.from_page import MAX_FIELD_NAME, MAX_PLOT_FIELDS
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, ODOM, decode_joints
from tsd_twin.messages.status import decode_stamp, decode_status

OTHER = "fedcba9876543210"
ALPHA, SPIN = "joints.module1_alpha.position_rad", "joints.module2_wheel.velocity_rad_per_s"
COVARIANCE = np.diag([0.04, 0.09, 0.25])


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


def fields_of(feed: Any) -> PlotFields:
    return PlotFields(feed, has_alternative=True)


@pytest.mark.parametrize("name", robots.robot_names())
def test_every_field_has_a_unit_and_is_null_until_it_was_received(name: str) -> None:
    feed: Any = RobotFeed(name, robots.load_robot(name))
    fields = fields_of(feed)
    assert all(len(each) <= MAX_FIELD_NAME for each in fields.names)
    assert all(re.search(r"_(mps|rad_per_s|rad|m)$", each) for each in fields.names)
    for each, value in fields.values(fields.names, feed.snapshot).items():
        assert value == (0.0 if each.startswith("requested.") else None), each


@pytest.mark.parametrize("name", robots.robot_names())
def test_the_alternative_estimate_is_offered_by_robots_that_have_one(name: str) -> None:
    feed: Any = RobotFeed(name, robots.load_robot(name))
    info = RobotTelemetry(feed).info()
    offered = any(each.startswith("alternative.") for each in info.plot_fields)
    assert offered is (info.alternative_estimate is not None)


def test_fields_are_the_numbers_of_the_messages() -> None:
    feed = RobotFeed()
    joints = np.arange(1.0, 10.0)
    pose, truth = np.array([1.0, -2.0, 0.3]), np.array([1.5, -2.5, 0.4])
    feed.say(joints=joints, setpoint=-joints, pose=pose, truth=truth, covariance=COVARIANCE)
    fields = fields_of(feed)
    values = fields.values(fields.names, feed.snapshot)
    measured = [value for each, value in values.items() if each.startswith("joints.")]
    wanted = [value for each, value in values.items() if each.startswith("setpoint.")]
    assert measured == list(joints)
    assert wanted == list(-joints)
    for stream, expected in (("odom", pose), ("truth", truth)):
        names = ("x_m", "y_m", "heading_rad")
        assert [values[f"{stream}.pose.{each}"] for each in names] == list(expected)
    assert [values[f"odom.sigma.{each}"] for each in ("x_m", "y_m", "heading_rad")] == [
        pytest.approx(0.2),
        pytest.approx(0.3),
        pytest.approx(0.5),
    ]


def test_a_sphere_offers_angular_velocities_and_no_place() -> None:
    feed: Any = RobotFeed("atlas", robots.load_robot("atlas"))
    feed.say(ball=SO3.identity())
    odom = feed.snapshot.odom
    feed.snapshot = replace(feed.snapshot, odom=replace(odom, twist=np.array([0.1, 0.2, 0.3])))
    fields = fields_of(feed)
    assert not any("pose" in each or "sigma" in each for each in fields.names)
    names = [f"odom.twist.{each}_rad_per_s" for each in ("wx", "wy", "wz")]
    assert list(fields.values(names, feed.snapshot).values()) == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("frame", [BASE, ODOM])
def test_the_requested_twist_is_that_of_the_newest_command_in_axes_of_the_robot(frame: str) -> None:
    feed: Any = RobotFeed()
    pose, twist = np.array([5.0, 6.0, 0.7]), np.array([0.3, -0.2, 0.5])
    feed.say(pose=pose)
    now_s = time.monotonic()
    feed.sent_commands = [
        SentCommand(now_s - 0.02, -twist, BASE),
        SentCommand(now_s, twist, frame),
    ]
    fields = fields_of(feed)
    names = ["requested.vx_mps", "requested.vy_mps", "requested.omega_rad_per_s"]
    expected = twist.copy()
    if frame == ODOM:
        turned = SE2(np.array([0.0, 0.0, pose[2]]))
        expected[:2] = turned.inverse().transform(twist[:2])
    found = list(fields.values(names, feed.snapshot).values())
    assert found == pytest.approx(list(expected))
    feed.sent_commands = [SentCommand(now_s - 1.01 * REQUEST_TIMEOUT_S, twist, frame)]
    assert list(fields.values(names, feed.snapshot).values()) == [0.0, 0.0, 0.0]


def request(page: Page, *names: str) -> None:
    page.send(t="plot_fields", names=list(names))
    page.until(lambda: set(page.state["plot"]) == set(names))


def test_a_page_gets_what_it_requests_and_no_other_page_does(served: Site) -> None:
    with served.page() as page, served.page(OTHER) as other:
        page.until(lambda: page.state)
        assert {ALPHA, SPIN} <= set(page.last("robot")["plot_fields"])
        assert page.state["plot"] == {}
        request(page, ALPHA, SPIN)
        count = len(other.all("state"))
        other.until(lambda: len(other.all("state")) > count)
        assert other.state["plot"] == {}
        request(page, SPIN)
        request(page)


def test_values_and_times_are_those_that_a_subscriber_sees(served: Site) -> None:
    statuses = served.bus.subscriber(topics.STATUS.key("tsd"), 1000)
    joints = served.bus.subscriber(topics.JOINTS.key("tsd"), 1000)
    with served.page() as page:
        page.until(lambda: page.state)
        request(page, ALPHA)
        count = len(page.all("state"))
        page.until(lambda: len(page.all("state")) >= count + 10)
        states = page.all("state")[count:]
    sent = {
        seq: (1e-9 * robot_ns, decode_status(sample.payload))
        for sample in statuses.take_samples()
        for seq, robot_ns in [decode_stamp(sample.attachment)]
    }
    angles = {
        float(message.position_rad[list(message.names).index("module1_alpha")])
        for message in (decode_joints(sample.payload) for sample in joints.take_samples())
    }
    for state in states:
        robot_s, status = sent[state["status_seq"]]
        assert state["robot_s"] == pytest.approx(robot_s, abs=1e-6)
        assert state["status"]["consistency"]["residual_mps"] == status.consistency.residual_mps
        assert state["plot"][ALPHA] in angles
    times_s = [state["robot_s"] for state in states]
    assert times_s == sorted(set(times_s))


@pytest.mark.parametrize(
    "names",
    [["x"] * (MAX_PLOT_FIELDS + 1), ["x" * (MAX_FIELD_NAME + 1)], [1.0], "joints", None],
    ids=["too many", "too long", "no text", "no list", "nothing"],
)
def test_an_invalid_request_changes_nothing(served: Site, names: Any) -> None:
    with served.page() as page:
        request(page, SPIN)
        page.send(t="plot_fields", names=names)
        reply = page.until(lambda: page.last("reply"))
        assert (reply["to"], reply["ok"]) == ("message", False)
        count = len(page.all("state"))
        page.until(lambda: len(page.all("state")) > count)
        assert set(page.state["plot"]) == {SPIN}


def test_unknown_names_are_ignored(served: Site) -> None:
    with served.page() as page:
        page.send(t="plot_fields", names=["joints.nothing.position_rad", "__class__", "", SPIN])
        page.until(lambda: set(page.state["plot"]) == {SPIN})
