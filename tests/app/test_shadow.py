"""Shadow twin of a robot that wears while driving: mock, dashboard and page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.page_client import Page
from tests.support.programs import Program
from tests.support.robot_node import PATIENT
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots

pytestmark = pytest.mark.system

MOST_RAD_PER_S = robots.load_robot("tsd").limits.turn_rate_rad_per_s
Start = Callable[..., Program]
WORN_S, PUSH_S = 3.0, 0.35
"""Driving time before the wear, and duration of each push of the stick."""


def drive_at_full_stick(page: Page, until: Callable[[], bool]) -> None:
    """Push in changing directions, because servos show nothing if gimbals hardly move.

    Each push is a new one, so a dashboard that stalled on a busy machine ends one push only.
    """
    end_s, random = time.monotonic() + PATIENCE_S, np.random.default_rng(3)
    while not until():
        assert time.monotonic() < end_s, page.state["shadow"]
        assert page.mode in ("ready", "driving", "stopping"), page.state["status"].get("stop")
        direction_rad = random.uniform(0.0, 2.0 * math.pi)
        turn = random.choice([-MOST_RAD_PER_S, MOST_RAD_PER_S])
        page.let_go()
        page.holds = {
            "vx": math.cos(direction_rad),
            "vy": math.sin(direction_rad),
            "omega": float(turn),
        }
        time.sleep(PUSH_S)


def test_the_page_of_a_robot_that_wears_while_driven_names_the_part(
    start: Start, tmp_path: Path
) -> None:
    toml = tmp_path / "robot.toml"
    toml.write_text(PATIENT)
    wear = ("--noise", "1", "--wear", f"module2_alpha=-30%@{WORN_S:g}")
    mock = start("tsd_mock", "--listen", "tcp/127.0.0.1:0", "--robot", str(toml), *wear)
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", mock.ready().split()[-1])
    port = int(dashboard.ready().rstrip("/").rpartition(":")[2])
    page = Page(port, "0123456789abcdef")

    def shadow() -> dict[str, Any]:
        return page.state["shadow"] or {"compared_s": 0.0, "drifts": []}

    try:
        page.until(lambda: page.state)
        assert page.state["shadow"] is None
        page.send(t="shadow", on=True)
        page.make_ready()
        drive_at_full_stick(page, lambda: bool(shadow()["drifts"]))
        (drift,) = shadow()["drifts"]
        assert drift["part"] == "module2_alpha"
        assert drift["why"]["code"] == "servo_slower"
        assert len(shadow()["joints"]) == 9
        page.holds = None
        page.send(t="shadow", on=False)
        page.until(lambda: page.state["shadow"] is None)
    finally:
        page.close()
    assert dashboard.end() == 0
    assert mock.end() == 0
