"""The picture of a camera in the page, with real programs: seen, driven by, and missed."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Generator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.app.conftest import Program
from tests.support.browser import FLAGS_WITHOUT_SCENE, PATIENCE_MS, mode

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(180),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

Start = Callable[..., Program]
STOPPED = "No new picture"


class Watched:
    """A page that shows the picture of a simulated camera above a mock robot."""

    def __init__(self, start: Start, browser: Browser) -> None:
        endpoint = start("tsd_mock", "--listen", "tcp/127.0.0.1:0").ready().split()[-1]
        self.camera = start("tsd_camera", "--simulate", "--connect", endpoint, "--tag", "3=tsd")
        self.camera.ready()
        dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
        self.page: Page = browser.new_page(viewport={"width": 1280, "height": 720})
        self.page.goto(dashboard.ready().split()[1])
        self.pane = self.page.get_by_role("region", name="Camera")

    def grey(self) -> float:
        """Return the mean brightness of the middle of the picture, 0 to 255."""
        script = """canvas => {
            const {width, height} = canvas;
            const {data} = canvas.getContext("2d").getImageData(width / 4, height / 4, width / 2, height / 2);
            return data.reduce((sum, each, i) => sum + (i % 4 === 0 ? each : 0), 0) / (data.length / 4);
        }"""
        return float(self.pane.get_by_role("img").evaluate(script))


@pytest.fixture
def watched(start: Start, browser: Browser) -> Generator[Watched]:
    opened = Watched(start, browser)
    yield opened
    opened.page.close()


def test_the_picture_shows_its_age_and_the_robot_and_says_when_it_stops(watched: Watched) -> None:
    expect(watched.pane).to_contain_text(re.compile(r"\d+ ms old"), timeout=PATIENCE_MS)
    expect(watched.pane.locator("svg .tag:not(.unused) text")).to_have_text(
        "tsd", timeout=PATIENCE_MS
    )
    assert 20.0 < watched.grey() < 235.0
    watched.camera.process.send_signal(signal.SIGSTOP)
    expect(watched.pane.get_by_role("status")).to_have_text(STOPPED, timeout=PATIENCE_MS)
    expect(watched.pane).to_contain_text(re.compile(r"no picture for \d+ s"))
    watched.camera.process.send_signal(signal.SIGCONT)
    expect(watched.pane.get_by_role("status")).to_have_text("", timeout=PATIENCE_MS)
    watched.camera.end(signal.SIGTERM)
    expect(watched.pane).to_have_count(0, timeout=PATIENCE_MS)


def test_who_drives_by_the_picture_stops_when_it_freezes_and_not_in_another_view(
    watched: Watched,
) -> None:
    page = watched.page
    expect(watched.pane).to_contain_text(re.compile(r"\d+ ms old"), timeout=PATIENCE_MS)
    page.get_by_role("radio", name="Camera").click()
    page.get_by_role("button", name="Take control").click()
    page.get_by_role("button", name="Arm", exact=True).first.click()
    expect(mode(page)).to_have_text("Ready", timeout=PATIENCE_MS)
    page.locator("body").click(position={"x": 640, "y": 200})
    page.keyboard.down("w")
    expect(mode(page)).to_have_text("Driving", timeout=PATIENCE_MS)
    watched.camera.process.send_signal(signal.SIGSTOP)
    expect(mode(page)).to_have_text("Ready", timeout=PATIENCE_MS)
    expect(page.locator("body")).to_contain_text("The picture is too old to drive by")
    page.keyboard.up("w")
    page.keyboard.down("w")
    page.wait_for_timeout(500)
    expect(mode(page)).to_have_text("Ready")
    page.keyboard.up("w")
    page.get_by_role("radio", name="3-D").click()
    page.keyboard.down("w")
    expect(mode(page)).to_have_text("Driving", timeout=PATIENCE_MS)
    page.keyboard.up("w")
    watched.camera.process.send_signal(signal.SIGCONT)


def test_the_pane_moves_by_keys_and_becomes_the_view(watched: Watched) -> None:
    expect(watched.pane).to_contain_text(re.compile(r"\d+ ms old"), timeout=PATIENCE_MS)
    handle = watched.pane.get_by_role("group", name="Move the picture with arrow keys")
    before = watched.pane.bounding_box()
    handle.press("ArrowLeft")
    handle.press("ArrowUp")
    after = watched.pane.bounding_box()
    assert before is not None
    assert after is not None
    assert (before["x"] - after["x"], before["y"] - after["y"]) == (24.0, 24.0)
    for _ in range(100):
        handle.press("ArrowLeft")
    left = watched.pane.bounding_box()
    assert left is not None
    assert left["x"] == 0.0
    watched.pane.get_by_role("button", name="Camera as main view").press("Enter")
    main = watched.pane.bounding_box()
    assert main is not None
    assert main["width"] > 800.0
    watched.pane.get_by_role("button", name="Close the picture").press("Enter")
    expect(watched.page.get_by_role("button", name="Camera")).to_be_visible()
