"""Module controls and fault display of a singularity drive."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.browser import PATIENCE_MS, get_ready, mode
from tests.support.programs import Program
from tests.support.withheld import budget, wait_for
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.status import RobotStatus, WheelSpeedStatus, decode_status
from tsd_twin.messages.topics import Sample

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

STUCK = "module2_alpha"
STUCK_DEG = 1.0
_PRESSES = 20


class Watcher:
    """Subscribes to status and wheel speeds."""

    def __init__(self, bus: Bus) -> None:
        self._news = threading.Condition()
        self._status: RobotStatus | None = None
        bus.subscribe(topics.STATUS.key("tsd"), self._on_status)

    def _on_status(self, sample: Sample) -> None:
        with self._news:
            self._status = decode_status(sample.payload)
            self._news.notify_all()

    def until(self, condition: Callable[[RobotStatus], bool]) -> RobotStatus:
        """Wait for a matching status and return it."""
        with self._news:
            assert wait_for(
                self._news, lambda: self._status is not None and condition(self._status)
            ), f"never: {self._status}"
            assert self._status is not None
            return self._status

    def until_wheels(self, condition: Callable[[WheelSpeedStatus], bool]) -> None:
        """Wait for a matching wheel speed."""
        self.until(lambda status: status.wheel_speed is not None and condition(status.wheel_speed))


def choose_speed(page: Page, watcher: Watcher) -> None:
    """Set the wheel speed by number, key and slider; the wheels follow."""
    spins = page.get_by_role("spinbutton", name="Wheel speed in rpm")
    expect(spins).to_be_enabled(timeout=PATIENCE_MS)
    spins.fill("3000")
    spins.press("Enter")
    watcher.until_wheels(lambda wheels: wheels.requested_rpm == 3000.0)
    said = page.get_by_text("3,000 rpm reach 6.3 m/s at 30° tilt. One servo step changes 19 mm/s.")
    expect(said).to_be_visible(timeout=PATIENCE_MS)
    expect(said).to_contain_text("1 m/s needs 4.6° tilt.")
    watcher.until_wheels(lambda wheels: abs(wheels.spin_rpm - 3000) < 30)
    page.get_by_role("slider", name="Wheel speed").press("ArrowLeft")
    watcher.until_wheels(lambda wheels: wheels.requested_rpm == 2950.0)
    top = page.get_by_role("spinbutton", name="Wheel speed for up to this many m/s")
    top.fill("4.5")
    top.press("Tab")  # 4.5 m/s at 30° tilt needs a rim speed of 9 m/s.
    watcher.until_wheels(lambda wheels: wheels.requested_rpm == 2149.0)


def drive_until(page: Page, seen: Callable[[], None]) -> None:
    """Hold a key until `seen` passes."""
    stick = page.get_by_role("application", name="Stick")
    for _ in budget.tries("hold a key", _PRESSES):
        get_ready(page)
        stick.focus()  # Focus the stick, where number keys do not set the wheel speed.
        page.keyboard.down("d")
        try:
            seen()
        except AssertionError:
            continue  # A slow page has released the stick and asks for another push.
        finally:
            page.keyboard.up("d")
        return
    seen()


def test_an_operator_chooses_the_wheel_speed_and_is_told_which_module_sticks(
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
        page.goto(address)
        mode(page, "disarmed")
        page.locator("summary", has_text="Wheel speed").click(timeout=PATIENCE_MS)
        slider = page.get_by_role("slider", name="Wheel speed")
        expect(slider).to_be_disabled(timeout=PATIENCE_MS)
        expect(slider.locator("..")).to_contain_text("Take control first.")
        get_ready(page)
        choose_speed(page, watcher)
        panel = page.get_by_role("tabpanel")
        notice = page.get_by_role("status").filter(has_text="module2 contradicts the others.")
        expect(notice).to_have_count(0)
        drive_until(page, lambda: expect(notice).to_be_visible(timeout=3000))
        suspect = watcher.until(lambda s: s.consistency.suspect is not None).consistency.suspect
        assert suspect == "module2"
        # The stuck gimbal pushes while its wheel spins, so the robot shuts off the wheels.
        fault = watcher.until(lambda status: status.mode == "fault")
        assert f"{STUCK} does not follow" in fault.stop_reason
        watcher.until_wheels(lambda wheels: wheels.spin_rpm < 100)
        press_tab(page, "Health")
        expect(panel).to_contain_text("Module 2 contradicts the others.", timeout=PATIENCE_MS)
        press_tab(page, "Modules")
        module = panel.get_by_role("heading", name="Module 2")
        expect(module).to_contain_text("Suspect", timeout=PATIENCE_MS)
        expect(panel.get_by_text("The wheels are shut off.")).to_be_visible(timeout=PATIENCE_MS)
    assert errors == []


def press_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click(timeout=PATIENCE_MS)
