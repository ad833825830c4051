"""The shadow twin on a page: it runs while the page shows it, and names a worn servo."""

from __future__ import annotations

import threading
import time

from tests.support.page_client import PATIENCE_S, Page, Site
from tests.support.robot_node import PATIENT, running
from tsd_twin import robots
from tsd_twin.simulation import Wear, WornRobot

ROBOT = robots.parse_description(PATIENT, "test")


def twins() -> int:
    return sum(thread.name == "shadow" for thread in threading.enumerate())


def drive_to_and_fro(page: Page, seconds: float) -> None:
    end_s, sign = time.monotonic() + seconds, 1.0
    while time.monotonic() < end_s and not (page.state["shadow"] or {"drifts": []})["drifts"]:
        page.drive(0.5 * sign, 0.3 * sign)
        sign = -sign
        time.sleep(0.4)


def test_a_page_that_shows_it_is_told_of_a_servo_that_gets_slow() -> None:
    worn = WornRobot(ROBOT, seed=5, noise=1.0)
    with running(toml=PATIENT, io=worn) as node, node.client() as bus:
        site = Site(bus, 1, None)
        try:
            with site.page() as page:
                page.until(lambda: page.state)
                assert page.state["shadow"] is None
                assert twins() == 0
                page.send(t="shadow", on=True)
                page.make_ready()
                page.drive()
                page.until(lambda: page.state["shadow"]["compared_s"] > 1.5)
                report = page.state["shadow"]
                assert report["drifts"] == []
                assert len(report["joints"]) == 9
                worn.wear(Wear("module2_alpha", 0.3))
                drive_to_and_fro(page, 2.0 * PATIENCE_S)
                (drift,) = page.state["shadow"]["drifts"]
                assert drift["part"] == "module2_alpha"
                assert "servo of module 2 alpha" in drift["text"]
                page.send(t="shadow", on=False)
                page.until(lambda: page.state["shadow"] is None)
        finally:
            site.close()
    assert twins() == 0
