"""The timeline in a browser: live history, and a recording that drives no robot."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

import tsd_twin
from tests.support.browser import FLAGS_WITHOUT_SCENE, PATIENCE_MS, mode, press_linked
from tests.support.programs import Program
from tests.support.recorded_drives import START_NS, recorded_circle
from tsd_twin.recording.events import Annotation, add_mark, read_marks

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

NAME = "drive.mcap"
MARK_S = 6.0
SECONDS = 12


class Driver:
    """Drives the live robot until stopped."""

    def __init__(self, endpoint: str) -> None:
        self.robot = tsd_twin.connect(endpoint)
        self.ended = threading.Event()
        self._thread = threading.Thread(target=self._drive)
        self._thread.start()

    @property
    def holder(self) -> str | None:
        return self.robot.state.status.lease.holder

    def close(self) -> None:
        self.ended.set()
        self._thread.join()
        self.robot.close()

    def _drive(self) -> None:
        while not self.ended.is_set():
            # A busy machine may stop the robot.
            with (
                suppress(tsd_twin.ClientError),
                self.robot.control("alice", arm=False) as base,
            ):
                if self.robot.state.mode == "fault":
                    base.reset()
                base.arm()
                while not self.ended.is_set():
                    base.set_velocity(vx_mps=0.05, omega_rad_per_s=0.2)
                    self.robot.sleep(0.05)
            if self.robot.state.mode == "stopped":
                return
            self.robot.sleep(0.5)


def shown_s(page: Page) -> float:
    rail = page.get_by_role("slider", name="Time in the recording")
    return float(rail.get_attribute("aria-valuenow") or "nan")


def until(condition: Callable[[], object], page: Page, what: str) -> None:
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while not condition():
        assert time.monotonic() < end_s, what
        page.wait_for_timeout(50)


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, ids=["no scene"])
def test_a_recording_is_looked_at_while_the_live_robot_drives_and_is_stopped(
    browser: Browser, start: Callable[..., Program], tmp_path: Path
) -> None:
    path = recorded_circle(tmp_path / NAME, SECONDS)
    add_mark(path, Annotation(START_NS + round(MARK_S * 1e9), "here <b>"))
    demo = start(
        *("tsd_demo", "--no-browser", "--until-eof", "--port", "0", "--bus-port", "0"),
        *("--record-dir", str(tmp_path)),
    )
    url, endpoint = re.findall(r"(?:http|tcp)\S+?(?=/? |;)", demo.ready())
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.goto(url)
    mode(page, "disarmed")
    timeline = page.get_by_role("contentinfo", name="Timeline")
    word = timeline.get_by_role("status").first
    expect(word).to_have_text("Live")

    # The last half minute: the live robot stays in the page.
    rail = page.get_by_role("slider", name="Time in the last 30 seconds")
    rail.focus()
    page.keyboard.press("ArrowLeft")
    expect(word).to_have_text("1.0 s ago")
    expect(timeline).to_contain_text("Disarmed 0.00 m/s", timeout=PATIENCE_MS)
    page.keyboard.press("l")
    expect(word).to_have_text("Live")

    # The list shows the path and the contents of each recording.
    recordings = page.get_by_role("dialog", name="Recordings")
    press_linked(page, "Recordings", recordings)
    line = recordings.get_by_role("listitem").filter(has_text="1 mark")
    expect(line.locator("polyline")).to_have_count(1, timeout=PATIENCE_MS)
    line.get_by_role("button").first.click()
    line.get_by_role("button", name="Open", exact=True).click()
    page.wait_for_url(f"**recording={NAME}")
    rail = page.get_by_role("slider", name="Time in the recording")
    expect(rail).to_be_visible(timeout=PATIENCE_MS)
    expect(page.get_by_role("status", name="Mode")).to_have_text("Recording", timeout=PATIENCE_MS)
    controls = page.get_by_role("region", name="Controls")
    expect(controls.get_by_role("application")).to_have_count(0)
    expect(controls.get_by_role("slider")).to_have_count(0)

    driver = Driver(endpoint)
    try:
        until(lambda: driver.robot.state.mode == "driving", page, "the live robot does not drive")

        # Scrub, step, play, next mark, new mark.
        until(lambda: float(rail.get_attribute("aria-valuemax") or 0) > SECONDS, page, "no time")
        box = rail.bounding_box()
        assert box is not None
        length_s = float(rail.get_attribute("aria-valuemax") or 0)
        y = box["y"] + 0.4 * box["height"]  # Between lanes, where a click hits no event.
        page.mouse.move(box["x"] + 0.2 * box["width"], y)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.4 * box["width"], y, steps=8)
        page.mouse.up()
        until(lambda: abs(shown_s(page) - 0.4 * length_s) < 0.05, page, "it does not scrub")
        before_s = shown_s(page)
        for _ in range(3):  # The first step may be smaller than the resolution of the time display.
            page.keyboard.press("Shift+Period")
        until(lambda: 0.05 < shown_s(page) - before_s < 0.25, page, "it does not step")
        page.keyboard.press("Period")
        until(lambda: abs(shown_s(page) - MARK_S) < 0.01, page, "it does not go to the mark")
        page.keyboard.press("k")
        until(lambda: shown_s(page) > MARK_S + 0.5, page, "it does not play")
        page.keyboard.press("k")
        play = page.get_by_role("button", name="Play, K", exact=True)
        expect(play).to_be_visible(timeout=PATIENCE_MS)
        page.keyboard.press("m")
        page.keyboard.type("it slipped")
        page.keyboard.press("Enter")
        until(lambda: len(read_marks(path)) == 2, page, "it is not marked")
        assert read_marks(path)[-1].note == "it slipped"

        # Nothing here drives the live robot, and STOP stops it.
        state = driver.robot.state.status.command
        for key in ("w", "e", "g"):
            page.keyboard.down(key)
            page.wait_for_timeout(200)
            page.keyboard.up(key)
        assert driver.holder in ("alice", None)
        assert driver.robot.state.status.command.dropped == state.dropped
        until(lambda: driver.robot.state.mode == "driving", page, "the live robot does not drive")
        page.keyboard.press("Space")
        until(lambda: driver.robot.state.mode == "stopped", page, "STOP does not stop it")
        expect(controls).to_contain_text("The robot itself is now “Stopped”", timeout=PATIENCE_MS)
    finally:
        driver.close()
    expect(rail).to_be_visible()
    page.keyboard.press("l")
    expect(word).to_have_text("Live", timeout=PATIENCE_MS)
    mode(page, "stopped")
    assert "recording=" not in page.url
    page.close()
