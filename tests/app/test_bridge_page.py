"""End to end: input on the real page, through dashboard, bus, bridge, pty and firmware."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect, sync_playwright

from tests.app.bridge_machine import Machine, wait_until
from tests.support.browser import (
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    centre,
    click_through,
    executable,
    mode,
)
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S, budget
from tsd_twin import robots

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

UPRIGHT = [2048] * 6
WAYS = {"w": (1.0, 0.0, 0.0), "s": (-1.0, 0.0, 0.0), "a": (0.0, 1.0, 0.0), "q": (0.0, 0.0, 1.0)}
"""Keys and their drive directions."""
_STEPS = ("Take control", "Hold to reset", "Arm")
_STOPS = 5
_GAP_STEPS = 20
"""Minimum tilt of a driven gimbal, in servo steps; smaller goals count as upright."""


@dataclass
class Desk:
    """Page connected to a machine."""

    machine: Machine
    page: Page

    def holding(self, down: Callable[[], object], up: Callable[[], object], way: str) -> None:
        """Hold a control until the gimbals tilt as the kinematics predicts, then release it.

        On a busy machine, late messages may stop the robot correctly; then release, get ready and
        push again, as a person would.
        """
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.get_ready()
            down()
            try:
                self.wait(lambda: self.tilts(way) or self.machine.mode == "fault", 5.0)
            except AssertionError:
                continue
            finally:
                up()
            if self.machine.mode == "fault":
                continue
            wait_until(lambda: self.machine.box.show()["goals"] == UPRIGHT, "upright, let go of")
            return
        raise AssertionError(f"never {way}: {self.machine.reason} {self.machine.box.show()}")

    @staticmethod
    def wait(condition: Callable[[], object], seconds: float) -> None:
        """Poll until a condition holds."""
        end_s = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end_s
            time.sleep(0.02)

    def tilts(self, way: str) -> bool:
        """Return whether wheels spin and the gimbal goals match the key's direction."""
        seen = self.machine.box.show()
        drive = robots.load_robot("tsd").kinematics()
        wanted = drive.inverse(0.2 * np.array(WAYS[way]))[[0, 1, 3, 4, 6, 7]] * 4096 / (2 * np.pi)
        told = np.array(seen["goals"]) - 2048
        clear = np.abs(wanted) > _GAP_STEPS
        return bool(
            min(seen["pulses_us"]) > 1100.0
            and (told[clear] * np.sign(wanted[clear]) > _GAP_STEPS).all()
            and (np.abs(told[np.abs(wanted) < 1.0]) < _GAP_STEPS).all()
        )

    def get_ready(self) -> None:
        """Press the buttons that lead to ready, from any state.

        Arming takes seconds, and faults can interrupt it on a busy machine.
        """
        end_s = time.monotonic() + PATIENCE_S
        while self.machine.mode != "ready":
            assert time.monotonic() < end_s, (self.machine.mode, self.machine.reason)
            click_through(self.page, *_STEPS)


@pytest.fixture
def desk(start: Callable[..., Program], tmp_path: Path) -> Iterator[Desk]:
    machine = Machine(start, tmp_path)
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", machine.endpoint)
    url = re.findall(r"http://\S+", dashboard.ready())[0]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=executable(), args=list(FLAGS_WITHOUT_SCENE)
        )
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(url)
        mode(page, "disarmed")
        yield Desk(machine, page)
        browser.close()
    machine.close()


def test_a_hand_on_the_page_moves_pulses_and_gimbals_and_its_health_is_shown(desk: Desk) -> None:
    page, machine = desk.page, desk.machine
    assert machine.box.at_rest
    desk.get_ready()
    x, y, reach = centre(page, "application", "Stick")

    def pull() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - reach)

    desk.holding(pull, page.mouse.up, "w")
    for name in WAYS:
        desk.holding(lambda n=name: page.keyboard.down(n), lambda n=name: page.keyboard.up(n), name)
    for _ in budget.tries(
        "stop", _STOPS
    ):  # A busy machine may cause a fault, in which case STOP has no effect.
        desk.get_ready()
        page.keyboard.press(" ")
        wait_until(lambda: machine.box.at_rest, "STOP shuts off the wheels")
        if machine.mode == "stopped":
            break
    mode(page, "stopped")
    page.get_by_role("tab", name="Health").click()
    shows(page, "Link", {"Dashboard to robot and back": r"\d+(\.\d+)?ms"})
    voltages = r"1\d(\.\d+)?(, 1\d(\.\d+)?){5}V"
    shows(
        page,
        "Hardware",
        {
            "board": "disarmed",
            "Battery": r"1\d\.\dV",
            "last trip": ".+",
            "link round trip": r"\d+(\.\d+)?ms",
            "Errors in 10 s: link missed": r"\d+",
            "Errors in 10 s: link broken": r"\d+",
            "Errors in 10 s: link reconnects": r"\d+",
            "counters crc errors": r"\d+",
            "counters rx errors": r"\d+",
            "Servos that answer": "6 / 6",
            "Hottest servo": r"\d\d°C",
            "servos voltage": voltages,
        },
    )


def shows(page: Page, group: str, readings: dict[str, str]) -> None:
    """Check the readings in a group of the Health tab or among those outside their band."""
    panel = page.get_by_role("tabpanel", name="Health")
    panel.locator("summary", has_text=group).first.click(timeout=PATIENCE_MS)
    for name, figure in readings.items():
        named = page.get_by_text(name, exact=True)
        reading = panel.get_by_role("listitem").filter(has=named).locator(".v")
        expect(reading).to_have_text(re.compile(f"^{figure}$"), timeout=PATIENCE_MS)
