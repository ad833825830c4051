"""The pictures of a camera in a browser, with the real programs."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.app.test_axe import findings
from tests.support.browser import FLAGS_WITHOUT_SCENE, PATIENCE_MS, get_ready, press
from tests.support.link_sockets import free_port
from tests.support.programs import Program
from tests.support.robot_node import patient_robot
from tests.support.withheld import budget
from tsd_twin.dashboard.gateway.pictures import MAX_SOCKETS

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(300),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

Start = Callable[..., Program]
PHRASE = "correct horse battery"
AGE = re.compile(r"^(\d+ ms old|no picture for \d+ s)$")
"""Age of a picture; on a machine that withholds time from its programs, it may be old indeed."""
STOPPED = re.compile(r"^no picture for \d+ s$")
AT_REST = re.compile("ready|disarmed", re.IGNORECASE)
"""Modes of a robot that nobody drives; without an operator for 10 s it is disarmed."""
_PRESSES, _PRESS_MS = 10, 6000.0
DRAWN = """(canvas) => {
  const { width, height } = canvas;
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(canvas, 0, 0);
  return width > 100 && new Set(context.getImageData(0, 0, width, height).data).size > 20;
}"""
THIN = "delay=5ms,bandwidth=6Mbit"
"""Link that carries no JPEG of the camera's size; the simulated one has 60 kB."""
COUNT_PICTURES = """
window.counts = { jpeg: 0, h264: 0 };
window.breaks = false;
const decode = VideoDecoder.prototype.decode;
VideoDecoder.prototype.decode = function (chunk) {
  if (window.breaks) throw new DOMException("as if reclaimed");
  decode.call(this, chunk);
};
const create = window.createImageBitmap;
window.createImageBitmap = async (from) => {
  const bitmap = await create(from);
  window.counts[from instanceof VideoFrame ? "h264" : "jpeg"] += 1;
  return bitmap;
};
"""
WITH_GRAPHICS_CARD = """
addEventListener("message", (event) => {
  if (!event.data?.software) return;
  event.stopImmediatePropagation();
  const { origin, source } = event;
  const data = { ...event.data, software: false };
  dispatchEvent(new MessageEvent("message", { data, origin, source }));
});
"""
"""Pages that draw in software ask for JPEG."""
SMALL = """(canvas) => {
  const [width, height] = [32, 18];
  const small = Object.assign(document.createElement("canvas"), { width, height });
  const context = small.getContext("2d");
  context.imageSmoothingQuality = "high";
  context.drawImage(canvas, 0, 0, width, height);
  return Array.from(context.getImageData(0, 0, width, height).data.filter((_, i) => i % 4 < 3));
}"""


@pytest.fixture(scope="module")
def bus(start_shared: Start) -> str:
    mock = start_shared("tsd_mock", "--listen", "tcp/127.0.0.1:0", *patient_robot())
    return mock.ready().split()[-1]


@pytest.fixture(scope="module")
def url(start_shared: Start, bus: str) -> str:
    return start_shared("tsd_dashboard", "--port", "0", "--connect", bus).ready().split()[1]


@pytest.fixture
def camera(start: Start, bus: str) -> Program:
    camera = start("tsd_camera", "--simulate", "--connect", bus, "--tag", "3=tsd")
    camera.ready()
    return camera


@contextmanager
def opened(browser: Browser, url: str, script: str = "") -> Generator[Page]:
    page = browser.new_page(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
    failures: list[str] = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.add_init_script(script)
    page.goto(url)
    yield page
    page.close()
    assert [each for each in failures if "WebGL" not in each] == []


def pane(page: Page) -> Locator:
    return page.get_by_role("region", name="Camera", exact=True)


def age(page: Page) -> Locator:
    return pane(page).locator(".age")


def shows_a_picture(page: Page) -> None:
    picture = pane(page).get_by_role("img", name="Picture of the camera")
    expect(picture).to_be_visible()
    page.wait_for_function(DRAWN, arg=picture.element_handle(), timeout=PATIENCE_MS)
    expect(age(page)).to_have_text(AGE)


def drive(page: Page) -> None:
    """Hold a key until the robot drives.

    A page without processor time shows an old picture or no signal. It then releases the controls,
    and obeys the key again only after a new press.
    """
    for _ in budget.tries("hold a key by a picture", _PRESSES):
        get_ready(page)
        page.keyboard.down("w")
        with contextlib.suppress(AssertionError):
            expect(page.get_by_role("status", name="Mode")).to_contain_text(
                "driving", ignore_case=True, timeout=_PRESS_MS
            )
            return
        page.keyboard.up("w")
    raise AssertionError("the robot does not drive")


def at_rest(page: Page) -> None:
    expect(page.get_by_role("status", name="Mode")).to_contain_text(AT_REST)


@pytest.mark.usefixtures("camera")
def test_a_picture_is_shown_with_its_age_and_its_tags(browser: Browser, url: str) -> None:
    with opened(browser, url) as page:
        shows_a_picture(page)
        expect(pane(page).locator("svg text", has_text="tsd")).to_be_visible()
        assert findings(page) == []
        press(page, "Camera as main view")
        shows_a_picture(page)
        for scheme in ("dark", "light"):
            page.emulate_media(color_scheme=scheme)
            expect(page.locator("html")).to_have_attribute("data-theme", scheme)
            assert findings(page) == []


@pytest.mark.usefixtures("camera")
def test_the_pane_is_moved_enlarged_and_closed_with_keys(browser: Browser, url: str) -> None:
    with opened(browser, url) as page:
        handle = page.get_by_role("group", name="Move the picture with arrow keys")
        before = pane(page).bounding_box()
        handle.press("ArrowUp")
        handle.press("ArrowLeft")
        after = pane(page).bounding_box()
        assert before is not None
        assert after is not None
        assert (before["x"] - after["x"], before["y"] - after["y"]) == (24, 24)
        for _ in range(100):
            handle.press("ArrowLeft")
        view = page.get_by_role("main").bounding_box()
        held = pane(page).bounding_box()
        assert view is not None
        assert held is not None
        assert held["x"] == view["x"]
        page.get_by_role("button", name="Camera as main view").press("Enter")
        page.get_by_role("button", name="Scene as main view").press("Enter")
        page.get_by_role("button", name="Close the picture").press("Enter")
        expect(pane(page)).to_be_hidden()
        page.reload()
        chip = page.get_by_role("button", name="Camera", exact=True)
        expect(chip).to_be_visible()
        expect(pane(page)).to_be_hidden()
        chip.press("Enter")
        shows_a_picture(page)


def test_driving_ends_where_the_picture_that_one_drives_by_stops(
    browser: Browser, url: str, camera: Program
) -> None:
    with opened(browser, url) as page:
        press(page, "Camera as main view")
        shows_a_picture(page)
        drive(page)
        camera.process.send_signal(signal.SIGSTOP)
        try:
            expect(age(page)).to_have_text(STOPPED)
            expect(pane(page).get_by_role("status")).to_have_text("No new picture")
            expect(pane(page).locator(".frame")).to_have_class(re.compile("old"))
            at_rest(page)  # Although the key is still held.
            assert findings(page) == []
        finally:
            camera.process.send_signal(signal.SIGCONT)
        page.keyboard.up("w")
        drive(page)
        camera.process.kill()
        at_rest(page)
        expect(age(page)).to_have_text(STOPPED)  # One that is gone for good is no other view.
        page.keyboard.up("w")
        page.get_by_role("radio", name="3-D").click()
        expect(pane(page)).to_be_hidden()


@pytest.mark.usefixtures("camera")
def test_a_thin_link_shows_the_same_by_h264_as_by_jpeg_after_the_decoder_fails(
    start: Start, browser: Browser, bus: str
) -> None:
    near = f"127.0.0.1:{free_port()}"
    flags = ("--port", "0", "--connect", bus, "--allow-host", near)
    url = start("tsd_dashboard", *flags).ready().split()[1]
    target = url.replace("http://", "tcp/").rstrip("/")
    start("tsd_link", "--link", THIN, "--target", target, "--listen", f"tcp/{near}").ready()
    with opened(browser, f"http://{near}/", COUNT_PICTURES + WITH_GRAPHICS_CARD) as page:
        press(page, "Camera as main view")
        page.wait_for_function("() => counts.h264 > 30", timeout=PATIENCE_MS)
        shows_a_picture(page)
        canvas = pane(page).get_by_role("img", name="Picture of the camera")
        by_h264 = np.array(canvas.evaluate(SMALL))
        page.evaluate("breaks = true; counts.jpeg = counts.h264 = 0")
        page.wait_for_function("() => counts.jpeg > 30", timeout=PATIENCE_MS)
        by_jpeg = np.array(canvas.evaluate(SMALL))
        assert page.evaluate("counts.h264") <= MAX_SOCKETS  # Those in flight.
        assert np.corrcoef(by_h264, by_jpeg)[0, 1] > 0.7
        assert np.abs(by_h264 - by_jpeg).mean() < 3.0
        expect(age(page)).to_have_text(AGE)


@pytest.mark.usefixtures("camera")
def test_a_user_of_some_robots_sees_no_camera_above_the_floor(
    start: Start, browser: Browser, bus: str, tmp_path: Path
) -> None:
    users = str(tmp_path / "users.toml")
    for name, *flags in (("alice",), ("bob", "--robots", "tsd")):
        subprocess.run(
            [sys.executable, "-m", "tsd_users", users, "--operator", name, *flags],
            input=f"{PHRASE}\n",
            text=True,
            check=True,
            stdout=subprocess.DEVNULL,
        )
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", bus, "--users", users)
    url = dashboard.ready().split()[1]
    for name, sees in (("alice", True), ("bob", False)):
        context = browser.new_context(viewport={"width": 1280, "height": 720})
        page = context.new_page()
        page.goto(url)
        page.get_by_label("Name").fill(name)
        page.get_by_label("Password").fill(PHRASE)
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("button", name="Take control")).to_be_visible()
        if sees:
            shows_a_picture(page)
        else:
            assert page.evaluate("fetch('cameras').then((answer) => answer.json())") == []
            expect(pane(page)).to_be_hidden()
            expect(page.get_by_role("radio", name="Camera", exact=True)).to_have_count(0)
        context.close()
