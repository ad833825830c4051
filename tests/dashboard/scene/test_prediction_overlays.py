"""Predicted path and area of a robot, as sent to a viser client."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest

from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import ViserClient, viser_client
from tsd_twin.client.connection import SentCommand
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import overlay_node
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.wire.view import Layer
from tsd_twin.messages.status import LimitStatus, RobotStatus

ENVELOPE = f"{overlay_node(Layer.ENVELOPE, 'tsd')}/dark/v"
AREA, RIM, HATCH = f"{ENVELOPE}/a", f"{ENVELOPE}/r", f"{ENVELOPE}/h"
CAGE = f"{overlay_node(Layer.PREDICTED, 'tsd')}/dark/c"
GHOST = overlay_node(Layer.PREDICTED, "tsd")
FORWARD = np.array([0.8, 0.0, 0.0])
LIMITS = LimitStatus(1.0, 3.0, 0.25)
EVERY_S = 0.11
"""Interval between states, long enough for a prediction from each."""


@pytest.fixture(scope="module")
def scene() -> Generator[Scene]:
    server = viser_compat.start_server("test")
    yield Scene(server)
    server.stop()


@pytest.fixture
def feed(scene: Scene) -> Generator[RobotFeed]:
    made = RobotFeed()
    made.round_trips.add(0.15)
    scene.add(made)
    yield made
    scene.remove("tsd")


@pytest.fixture
def viewer(scene: Scene, feed: RobotFeed) -> Generator[ViserClient]:
    del feed  # The robot exists before the client connects.
    with viser_client(scene.server.get_port()) as made:
        yield made


def drive(scene: Scene, feed: RobotFeed, x: float) -> None:
    """Publish a robot driving forward, with recent commands in flight."""
    now_s = feed.now_s + EVERY_S
    feed.sent_commands[:] = [
        SentCommand(now_s - 0.02 * i, FORWARD, "base_link") for i in range(40, 0, -1)
    ]
    setpoint = feed.kinematics.inverse(FORWARD)
    status = RobotStatus("driving", limits=LIMITS)
    pose = np.array([x, 0.0, 0.0])
    feed.say(pose=pose, twist=FORWARD, setpoint=setpoint, status=status, after_s=EVERY_S)
    scene.draw()


def rest(scene: Scene, feed: RobotFeed) -> None:
    setpoint = feed.kinematics.inverse(np.zeros(3))
    feed.say(setpoint=setpoint, status=RobotStatus("ready", limits=LIMITS), after_s=EVERY_S)
    scene.draw()


def test_area_and_cage_come_with_driving_and_go_with_it(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    assert not any(viewer.node(name).visible for name in (ENVELOPE, CAGE))
    for i in range(3):
        drive(scene, feed, 0.1 * i)
    viewer.until(lambda: all(viewer.node(name).visible for name in (ENVELOPE, CAGE)))
    area = np.reshape(viewer.node(AREA).props["vertices"], (-1, 3))
    assert area[:, 0].max() > 0.8 * (0.15 + 0.2) - area[:, 0].min()
    assert viewer.node(GHOST).position[0] == pytest.approx(0.8 * 0.15, abs=0.02)
    rest(scene, feed)
    viewer.until(lambda: not any(viewer.node(name).visible for name in (ENVELOPE, CAGE)))


def test_while_it_moves_evenly_nothing_of_it_is_sent_again(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    for i in range(20):
        drive(scene, feed, 0.088 * i)
    viewer.until(lambda: viewer.node("/w/r/tsd").position[0] == pytest.approx(0.088 * 19))
    of_those = [m for m in viewer.messages if m.get("name") in (AREA, RIM, HATCH, CAGE, GHOST)]
    viewer.messages.clear()
    assert of_those
    for i in range(20, 40):
        drive(scene, feed, 0.088 * i)
    viewer.until(lambda: viewer.node("/w/r/tsd").position[0] == pytest.approx(0.088 * 39))
    again = [m for m in viewer.messages if m.get("name") in (AREA, RIM, HATCH, CAGE, GHOST)]
    assert again == []


def test_a_silent_robot_keeps_its_area_and_loses_its_cage(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    for i in range(3):
        drive(scene, feed, 0.1 * i)
    scene.set_stale("tsd", True)
    scene.server.flush()
    viewer.until(lambda: not viewer.node(CAGE).visible and viewer.node(ENVELOPE).visible)


def test_its_messages_are_small(scene: Scene, feed: RobotFeed, viewer: ViserClient) -> None:
    """At 10 Hz, with a stick that is never still."""
    rest(scene, feed)
    drive(scene, feed, 0.0)
    viewer.until(lambda: viewer.node(ENVELOPE).visible)
    lines = sum(viewer.node(name).props["points"].nbytes for name in (RIM, HATCH))
    assert 10 * (viewer.node(AREA).props["vertices"].nbytes + lines) < 20_000
