"""Planned paths while another peer on an open bus forges the robot's pose.

The robot's own limits still apply, and a pose jump ends the path.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from tests.dashboard.recorders import CommandRecorder
from tests.dashboard.sessions.test_navigation import go, let_go, midway, plan
from tests.support.page_client import Site, site
from tests.support.withheld import WithheldTime
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_odometry, encode_odometry
from tsd_twin.messages.topics import QoS

FORGED_S = 0.004
"""Period of forged poses; the robot sends one every 20 ms."""
STOPS_WITHIN_M = 0.3


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


@contextmanager
def forged(served: Site, change: Callable[[Odometry], Odometry]) -> Generator[None]:
    """Publish modified poses, much more often than the robot publishes true ones."""
    key = topics.ODOM.key("tsd")
    publisher = served.bus.publisher(key, QoS.DATA, topics.ODOM.type)
    truths = served.bus.subscriber(topics.TRUTH.key("tsd"), 1)
    ended = threading.Event()

    def forge() -> None:
        while not ended.wait(FORGED_S):
            if (sample := truths.newest()) is not None:
                true = decode_odometry(sample.payload)
                forging[0] = encode_odometry(change(true))
            if forging[0]:
                publisher.put(forging[0])

    forging = [b""]
    thread = threading.Thread(target=forge)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        publisher.close()
        truths.close()


def moved(by: Array) -> Callable[[Odometry], Odometry]:
    return lambda true: replace(true, xy_heading=true.xy_heading + by)


@pytest.mark.parametrize(
    "by", [[2.0, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 1.5], [math.nan, 0.0, 0.0]]
)
def test_a_pose_that_jumps_ends_the_way_and_the_robot_stops(served: Site, by: list[float]) -> None:
    with served.page() as page:
        page.make_ready()
        plan(page, (1.0, 0.0))
        commands = CommandRecorder(served, page)
        go(page, midway(page))
        before = len(page.all("released"))
        with WithheldTime() as withheld:
            at = page.state["truth"]
            with forged(served, moved(np.array(by))):
                page.until(lambda: len(page.all("released")) > before)
                page.until(lambda: page.mode == "ready")
        assert commands.is_put_to_rest()
        late_m = page.state["status"]["limits"]["speed_mps"] * withheld.total_s
        assert math.dist(at[:2], page.state["truth"][:2]) < STOPS_WITHIN_M + late_m
        let_go(page)


def test_a_pose_that_stands_still_drives_the_robot_no_faster_than_it_may_and_not_for_long(
    served: Site,
) -> None:
    with served.page() as page:
        page.make_ready()
        plan(page, (0.5, 0.0))
        commands = CommandRecorder(served, page)
        start = page.state["truth"]
        go(page, midway(page))
        before, held = len(page.all("released")), page.state["truth"]
        with forged(served, lambda true: replace(true, xy_heading=np.array(held))):
            page.until(lambda: len(page.all("released")) > before)
            page.until(lambda: page.mode == "ready")
        limit = page.state["status"]["limits"]["speed_mps"]
        speeds = [math.hypot(*command.twist[:2]) for command in commands.take()]
        assert max(speeds) <= limit + 1e-6
        assert math.dist(start[:2], page.state["truth"][:2]) < 3.0 * limit
        let_go(page)
