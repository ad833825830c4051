"""Display latency in a real browser, compared with the page without its scene."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

from playwright.sync_api import Page, ViewportSize, sync_playwright

from bench.programs import dashboard, mock, program, python
from bench.table import Row, Run, quantiles
from tests.support.browser import FLAGS, PATIENCE_MS, executable
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import Sample

_SETTLED_MS = 1500.0
_SIZE: ViewportSize = {"width": 1280, "height": 720}
_LEAST, _TRIES = 10, 8
"""Minimum number of states for a result, and maximum attempts."""
_NOTES = """
window.shownMs = {};
const nextFrame = requestAnimationFrame.bind(window);
const Plain = WebSocket;
window.WebSocket = class extends Plain {
  constructor(...words) {
    super(...words);
    if (!String(words[0]).includes("teleop")) return;
    this.addEventListener("message", ({ data }) => {
      const { t, status_seq: seen } = JSON.parse(data);
      const note = () => (shownMs[seen] = performance.timeOrigin + performance.now());
      if (t === "state") nextFrame(() => nextFrame(note));
    });
  }
};
"""
"""Records the start of the frame after each state, by which time the browser has shown it."""
FRAME = ".viewport-frame"
"""Frame of the scene in the page."""
HIDE = f"document.querySelector('{FRAME}').style.display = 'none'"
SHOW = HIDE.replace("none", "block")


def rows(run: Run) -> Iterator[Row]:
    """Measure the page in turn with and without viser's canvas; the rest is our code."""
    seconds = run.pick(3.0, 1.0)
    with ExitStack() as stack:
        endpoint = stack.enter_context(mock())
        url = stack.enter_context(dashboard(endpoint))
        stack.enter_context(program(python("bench.viewers", url, "1", "drive")))
        sent_ms: dict[int, float] = {}

        def on_status(sample: Sample) -> None:
            sent_ms[decode_stamp(sample.attachment)[0]] = 1e3 * time.time()

        bus = stack.enter_context(Bus(client_config([endpoint])))
        bus.subscribe(topics.STATUS.key("tsd"), on_status)
        page = opened(stack)
        page.add_init_script(_NOTES)
        page.goto(url)
        wait_for_scene(page)

        def measure(script: str) -> tuple[float, float]:
            page.evaluate(script)
            return quantiles(watch(page, sent_ms, seconds))

        yield from run.alternate(
            ["page.delay_p50", "page.delay_p90"],
            lambda: measure(SHOW),
            lambda: measure(HIDE),
            rounds=3,
        )


def opened(stack: ExitStack) -> Page:
    """Return an empty page of a browser."""
    playwright = stack.enter_context(sync_playwright())
    browser = playwright.chromium.launch(executable_path=executable(), args=list(FLAGS))
    stack.callback(browser.close)
    return browser.new_page(viewport=_SIZE)


def wait_for_scene(page: Page) -> None:
    """Wait until the frame of the page has a canvas."""
    page.frame_locator(FRAME).locator("canvas[data-engine]").wait_for(timeout=PATIENCE_MS)


def watch(page: Page, sent_ms: dict[int, float], seconds: float) -> list[float]:
    """Return the latencies of all displayed states sent within `seconds`."""
    page.wait_for_timeout(_SETTLED_MS)
    page.evaluate("window.shownMs = {}")
    delays: list[float] = []
    for _ in range(_TRIES):  # A slow browser may not have displayed anything yet.
        page.wait_for_timeout(1000.0 * seconds)
        shown_ms: dict[str, float] = page.evaluate("window.shownMs")
        delays = [at - sent_ms[int(seen)] for seen, at in shown_ms.items() if int(seen) in sent_ms]
        if len(delays) >= _LEAST:
            break
    return delays
