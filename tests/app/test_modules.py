"""What an operator does about the wheels of a singularity drive, and sees of one that sticks."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Callable, Generator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.app.conftest import PATIENCE_S, Program
from tests.support.browser import (
    CHEAP_FLAGS,
    PATIENCE_MS,
    QUICK,
    WATCH_STALLS,
    executable,
    get_ready,
    mode,
    trials,
)
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

STUCK = "module2_alpha"
STUCK_DEG = 1.0
_PRESSES = 20
_SHOWN = """() => {
window.shownMs = new Promise((resolve) => {
  const look = () => {
    const notice = document.querySelector("#tsd-overlay")?.shadowRoot.querySelector(".consistency");
    if (notice && !notice.hidden) resolve(Date.now());
    else eachFrame(look);
  };
  look();
});
}"""
"""Keeps, without waiting, the promise of when the notice is shown."""
_EACH_FRAME = "window.eachFrame = requestAnimationFrame.bind(window)"
"""The browser's own, before the page leaves out some for the scene."""


@pytest.fixture
def browser() -> Generator[Browser]:
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=executable(), args=list(CHEAP_FLAGS))
        yield running
        running.close()


class Watcher:
    """Notes when the robot measures that a gimbal sticks, and when it says so."""

    def __init__(self, bus: Bus) -> None:
        self._news = threading.Condition()
        self._set_deg = 0.0
        self.status: RobotStatus | None = None
        self.visible_ns = self.named_ns = 0
        self.named_ms = 0.0
        bus.subscribe(topics.SETPOINT.key("tsd"), self._on_setpoint)
        bus.subscribe(topics.JOINTS.key("tsd"), self._on_joints)
        bus.subscribe(topics.STATUS.key("tsd"), self._on_status)

    def _on_setpoint(self, sample: Sample) -> None:
        self._set_deg = self._angle_deg(sample)

    def _on_joints(self, sample: Sample) -> None:
        angle_deg = self._angle_deg(sample)
        # A sound servo is late by half a degree as well, but does not stand there.
        stands = abs(abs(angle_deg) - STUCK_DEG) < 0.1
        if not self.visible_ns and stands and abs(angle_deg - self._set_deg) > 0.5:
            self.visible_ns = decode_stamp(sample.attachment)[1]

    def _on_status(self, sample: Sample) -> None:
        with self._news:
            self.status = decode_status(sample.payload)
            if self.status.consistency.suspect is not None and not self.named_ns:
                self.named_ns, self.named_ms = decode_stamp(sample.attachment)[1], 1e3 * time.time()
            self._news.notify_all()

    @staticmethod
    def _angle_deg(sample: Sample) -> float:
        joints = decode_joints(sample.payload)
        return float(np.degrees(joints.position_rad[list(joints.names).index(STUCK)]))

    def until(self, condition: Callable[[RobotStatus], bool]) -> RobotStatus:
        with self._news:
            assert self._news.wait_for(
                lambda: self.status is not None and condition(self.status), PATIENCE_S
            ), f"never: {self.status}"
            assert self.status is not None
            return self.status


def choose_speed(page: Page, watcher: Watcher) -> None:
    """By number, by key and by the speed range: the robot spins as the page says."""
    spins = page.get_by_role("spinbutton", name="Drive speed, rpm")
    figures = page.get_by_role("status", name="Drive speed")
    expect(spins).to_be_enabled(timeout=PATIENCE_MS)
    spins.fill("3000")
    spins.press("Enter")
    watcher.until(
        lambda status: status.wheel_speed is not None and status.wheel_speed.requested_rpm == 3000.0
    )
    expect(figures).to_contain_text(
        "3,000 rpm: up to 6.3 m/s by tilt 30°, one servo step = 19 mm/s, 1 m/s needs 4.6° tilt",
        timeout=PATIENCE_MS,
    )
    watcher.until(
        lambda status: (
            status.wheel_speed is not None and abs(status.wheel_speed.spin_rpm - 3000) < 30
        )
    )
    page.get_by_role("slider", name="Drive speed").press("ArrowLeft")
    watcher.until(
        lambda status: status.wheel_speed is not None and status.wheel_speed.requested_rpm == 2950.0
    )
    top = page.get_by_role("spinbutton", name="Drive speed, up to m/s")
    top.fill("4.5")
    top.press("Tab")  # 4.5 m/s at 30 degrees is a rim of 9 m/s, with 40 mm 2,148.6 rpm.
    watcher.until(
        lambda status: status.wheel_speed is not None and status.wheel_speed.requested_rpm == 2149.0
    )


def test_an_operator_chooses_the_drive_speed_and_is_told_which_module_sticks(
    start: Callable[..., Program], browser: Browser
) -> None:
    mock = start("tsd_mock", "--listen", "tcp/127.0.0.1:0", "--jam", f"{STUCK}@{STUCK_DEG}")
    endpoint = mock.ready().split()[-1]
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
    address = re.findall(r"http://\S+", dashboard.ready())[0]
    errors: list[str] = []
    with Bus(client_config([endpoint])) as bus:
        watcher = Watcher(bus)
        page = browser.new_page(viewport={"width": 960, "height": 640})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.add_init_script("localStorage.setItem('tsd.hints', 'seen')")
        page.add_init_script(_EACH_FRAME)
        page.add_init_script(WATCH_STALLS)
        page.goto(address + QUICK)
        slider = page.get_by_role("slider", name="Drive speed")
        expect(slider).to_be_visible(timeout=PATIENCE_MS)
        expect(slider).to_be_disabled()
        expect(page.get_by_text("Take control first.").last).to_be_visible()
        mode(page, "disarmed")
        for trial in trials(page):
            with trial:
                get_ready(page)
                choose_speed(page, watcher)
        notice = page.get_by_role("alert").filter(has_text="Module 2 does not follow")
        expect(notice).to_have_count(0)
        page.evaluate(_SHOWN)
        slider.press("Shift")  # The focus is where a key is no number: it drives.
        for _ in range(_PRESSES):
            page.keyboard.down("d")
            try:
                expect(notice).to_be_visible(timeout=3000)
                break
            except AssertionError:
                page.keyboard.up("d")  # A page that was too slow is let go: push again, as it says.
                get_ready(page)
                slider.press("Shift")
        page.keyboard.up("d")
        expect(notice).to_be_visible(timeout=PATIENCE_MS)
        assert (
            watcher.until(lambda s: s.consistency.suspect is not None).consistency.suspect
            == "module2"
        )
        late_ms = page.evaluate("window.shownMs") - watcher.named_ms
        rtt_ms = (watcher.named_ns - watcher.visible_ns) / 1e6
        sys.stdout.write(
            f"\nnamed {rtt_ms:.0f} ms after it had to move on, shown {late_ms:.0f} ms later\n"
        )
        row = page.get_by_role("row").filter(has_text="suspect")
        press_tab(page, "Health")
        expect(row).to_contain_text("Module 2", timeout=PATIENCE_MS)
        expect(page.get_by_text("module2 contradicts the others.")).to_be_visible()
        press_tab(page, "Gimbals")
        expect(page.get_by_role("region", name="Module 2")).to_contain_text("suspect")
        # It pushes as long as its wheel spins, so the robot shuts the wheels off by itself.
        fault = watcher.until(lambda status: status.mode == "fault")
        assert f"{STUCK} does not follow" in fault.stop_reason
        expect(page.get_by_text("The wheels are shut off.")).to_be_visible(timeout=PATIENCE_MS)
        watcher.until(
            lambda status: status.wheel_speed is not None and status.wheel_speed.spin_rpm < 100
        )
    assert errors == []


def press_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click(timeout=PATIENCE_MS)
