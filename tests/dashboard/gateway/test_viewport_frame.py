"""viser's page in a frame, in a real browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from typing import Any

import numpy as np
import pytest
import viser
from playwright.sync_api import Browser, Frame, Page, Route, sync_playwright

from tests.support.browser import CHEAP_FLAGS, executable
from tests.support.page_client import Site, site
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.gateway.pages import VIEWPORT_PATH
from tsd_twin.dashboard.scene import viser_compat

pytestmark = [pytest.mark.system, pytest.mark.busy]

PAGE = "0123456789abcdef"
STALL_MS = 300.0
TICK_MS = 20.0
ALLOWED_MS = 50.0
TRIALS = 10
STALL = f"""new Promise((done) => setTimeout(() => {{
  const endMs = performance.now() + {STALL_MS};
  while (performance.now() < endMs);
  done();
}}, 100))"""
DRAWN = """new Promise((done) => {
  let count = 0;
  const draw = () => (++count > 20 ? done() : requestAnimationFrame(draw));
  draw();
})"""
PARENT = """
const meta = document.querySelector('meta[name="tsd-viewport"]').content;
const frame = document.createElement("iframe");
const address = new URL("viewport/", document.baseURI);
if (!location.search.includes("shared")) address.port = meta;
address.searchParams.set("parent", location.origin);
address.searchParams.set("page", "%(page)s");
address.searchParams.set("look", "dark");
frame.src = address.href;
frame.setAttribute("sandbox", "allow-scripts allow-same-origin");
frame.style.cssText = "position: fixed; inset: 0; width: 100%%; height: 100%%; border: 0";
window.messages = [];
window.keys = [];
window.gaps = [];
addEventListener("message", (event) => {
  if (event.source === frame.contentWindow && event.origin === address.origin) {
    messages.push(event.data);
  }
});
addEventListener("keydown", (event) => keys.push(event.code));
let lastMs = performance.now();
setInterval(() => {
  const nowMs = performance.now();
  gaps.push(nowMs - lastMs);
  lastMs = nowMs;
}, %(tick)s);
document.body.append(frame);
"""
"""Script of the page around the frame, instead of the dashboard's."""


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=executable(), args=list(CHEAP_FLAGS))
        yield started
        started.close()


@pytest.fixture(scope="module")
def served(server: viser.ViserServer) -> Generator[Site]:
    server.scene.add_box("/box", dimensions=(0.2, 0.2, 0.2))
    with site(server.get_port()) as made:
        yield made


def until(page: Page, condition: Callable[[], Any]) -> None:
    """Wait for a condition without evaluating code in the page, which its policy forbids."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        page.wait_for_timeout(50)


def open_page(browser: Browser, served: Site, query: str = "") -> tuple[Page, Frame]:
    """Open a page with the frame, and wait until the scene is drawn and connected."""
    page = browser.new_page(viewport={"width": 400, "height": 300})
    script = PARENT % {"page": PAGE, "tick": TICK_MS}

    def answer(route: Route) -> None:
        route.fulfill(body=script, content_type="text/javascript")

    page.route("**/page.js", answer)
    page.goto(f"http://127.0.0.1:{served.port}/{query}")
    until(page, lambda: page.evaluate("window.messages?.some(({ t }) => t === 'drawn')"))
    (frame,) = [each for each in page.frames if VIEWPORT_PATH in each.url]
    return page, frame


def keys_from_frame(page: Page) -> list[dict[str, Any]]:
    return page.evaluate("messages.filter((each) => each.t === 'key' && each.down)")


def hold(page: Page, frame: Frame, key: str) -> None:
    """Hold a key over several redraws, each of which would move the camera."""
    page.keyboard.down(key)
    frame.evaluate(DRAWN)
    page.keyboard.up(key)


def longest_gap_ms(page: Page, frame: Frame, script: str) -> float:
    """Return the maximum delay of a timer in the page while a script ran in the frame."""
    page.evaluate("void (gaps.length = 0)")
    frame.evaluate(script)
    page.wait_for_timeout(2 * TICK_MS)
    return float(page.evaluate("Math.max(...gaps)")) - TICK_MS


@pytest.mark.parametrize(("query", "shares"), [("", False), ("?shared", True)])
def test_a_frame_that_stalls_delays_the_page_only_if_both_have_one_origin(
    served: Site, browser: Browser, query: str, *, shares: bool
) -> None:
    page, frame = open_page(browser, served, query)
    calm = [longest_gap_ms(page, frame, "new Promise((done) => setTimeout(done, 400))")
            for _ in range(TRIALS)]  # fmt: skip
    stalled = [longest_gap_ms(page, frame, STALL) for _ in range(TRIALS)]
    # The machine delays both, but not every time.
    for name, late_ms in (("calm", calm), ("stalled", stalled)):
        print(f"{query} {name}: late by {np.round(sorted(late_ms), 1)} ms")  # noqa: T201
    assert (min(stalled) > STALL_MS / 2) == shares
    if not shares:
        assert np.median(stalled) <= ALLOWED_MS + max(calm)
    until(page, lambda: page.evaluate("messages.some((each) => each.ms > 200)"))
    page.close()


def test_keys_reach_the_page_and_none_moves_the_camera(
    served: Site, server: viser.ViserServer, browser: Browser
) -> None:
    page, frame = open_page(browser, served)
    until(page, lambda: len(server.get_clients()) == 1)
    (client,) = server.get_clients().values()
    until(page, lambda: np.allclose(client.camera.position, viser_compat.CAMERA_OFFSET_M))
    before = client.camera.position
    page.mouse.click(200, 150)  # A click on the scene, after which the page still has the focus.
    hold(page, frame, "w")
    page.keyboard.press("Space")
    assert page.evaluate("keys") == ["KeyW", "Space"]
    page.evaluate("document.querySelector('iframe').focus()")
    hold(page, frame, "w")
    page.keyboard.press("Space")
    until(page, lambda: len(keys_from_frame(page)) == 2)
    assert page.evaluate("keys") == ["KeyW", "Space"]
    space = {"tsd": 1, "t": "key", "code": "Space", "key": " ", "down": True, "repeat": False}
    mods = dict.fromkeys(("ctrl", "alt", "shift", "meta"), False)
    assert keys_from_frame(page)[1] == space | {"mods": mods}
    page.wait_for_timeout(500)
    assert np.array_equal(client.camera.position, before)
    page.mouse.wheel(0, 300)  # Unlike a key, the wheel moves the camera.
    until(page, lambda: not np.array_equal(client.camera.position, before))
    page.close()


def test_only_the_scene_is_shown_and_it_fills_the_frame(served: Site, browser: Browser) -> None:
    page, frame = open_page(browser, served)
    shown = "[...document.body.querySelectorAll('*')].filter((each) => each.checkVisibility())"
    box = "(({ left, top, width, height }) => [left, top, width, height])"
    canvas = f"{box}(document.querySelector('canvas[data-engine]').getBoundingClientRect())"
    until(page, lambda: frame.evaluate(canvas) == [0, 0, 400, 300])
    assert frame.evaluate(f"{shown}.every((each) => each.matches('canvas, :has(canvas)'))")
    page.close()


def test_a_script_in_the_frame_can_neither_read_the_page_nor_drive(
    served: Site, browser: Browser
) -> None:
    page, frame = open_page(browser, served)
    read = "(() => { try { return parent.document.title } catch (error) { return error.name } })()"
    assert frame.evaluate(read) == "SecurityError"
    for path in (f"teleop?page={PAGE}", f"viser/{PAGE}"):
        socket = f"new WebSocket('ws://127.0.0.1:{served.port}/{path}')"
        opened = f"""new Promise((done) => {{
          const socket = {socket};
          socket.onopen = () => done("open");
          socket.onerror = () => done("refused");
        }})"""
        assert frame.evaluate(opened) == "refused"
    fetched = f"fetch('http://127.0.0.1:{served.port}/healthz').then(() => 'read', () => 'refused')"
    assert frame.evaluate(fetched) == "refused"
    moved = f"top.location.href = 'http://127.0.0.1:{served.port}/login'"
    frame.evaluate(f"(() => {{ try {{ {moved} }} catch {{}} }})()")
    page.wait_for_timeout(200)
    assert page.url.endswith("/")
    page.close()
