"""The shadow twin of a robot that wears while it is driven: mock, dashboard and page."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.app.conftest import PATIENCE_S, Program
from tests.support.page_client import Page
from tests.support.robot_node import PATIENT

pytestmark = pytest.mark.system

Start = Callable[..., Program]
WORN_S, BACK_S = 3.0, 0.7
"""Time of driving before it wears, and of each direction of the stick."""


def drive_to_and_fro(page: Page, until: Callable[[], bool]) -> None:
    """Reverse the stick again and again: where gimbals stand still, their servos show nothing."""
    end_s, sign = time.monotonic() + PATIENCE_S, 1.0
    while not until():
        assert time.monotonic() < end_s, page.state["shadow"]
        page.drive(0.5 * sign, 0.4 * sign)
        sign = -sign
        time.sleep(BACK_S)


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
        drive_to_and_fro(page, lambda: bool(shadow()["drifts"]))
        (drift,) = shadow()["drifts"]
        assert drift["part"] == "module2_alpha"
        assert "servo of module 2 alpha" in drift["text"]
        assert len(shadow()["joints"]) == 9
        page.holds = None
        page.send(t="shadow", on=False)
        page.until(lambda: page.state["shadow"] is None)
    finally:
        page.close()
    assert dashboard.end() == 0
    assert mock.end() == 0
