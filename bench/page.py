"""Benchmark of display latency in a real browser, with and without the scene."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

from playwright.sync_api import Page, ViewportSize, sync_playwright

from bench.bus import program
from bench.table import Row, percentile
from tests.support.browser import FLAGS, PATIENCE_MS, executable
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.status import decode_stamp

_SECONDS, _SMALLEST_S = 8.0, 1.0
_SETTLED_MS = 3000.0
_SIZE: ViewportSize = {"width": 1280, "height": 720}
_LONGEST_S = "600"
_TO_REACH_MS = 200.0
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


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure the page with and without viser's frame; the rest is our code."""
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    page = [sys.executable, "-m", "tsd_dashboard", "--port", "0", "--until-eof"]
    with program(mock) as endpoint, program([*page, "--connect", endpoint]) as url:
        driver = [sys.executable, "-m", "bench.viewers", url, "1", _LONGEST_S, "drive"]
        driving = subprocess.Popen(driver, stdout=subprocess.PIPE, text=True)
        assert driving.stdout is not None
        driving.stdout.readline()
        try:
            with_scene_ms, alone_ms = delays_ms(
                endpoint, url, _SMALLEST_S if smallest else _SECONDS
            )
        finally:
            driving.kill()
            driving.wait()
            driving.stdout.close()
    for share in (0.5, 0.95):
        comparison = f"without the scene {percentile(alone_ms, share):.0f} ms"
        what = f"status to the screen of a browser, p{100 * share:.0f}"
        yield Row(what, percentile(with_scene_ms, share), _TO_REACH_MS, "ms", comparison)


def delays_ms(endpoint: str, url: str, seconds: float) -> tuple[list[float], list[float]]:
    """Return the latencies of states from the bus to the screen, with and without the scene."""
    sent_ms: dict[int, float] = {}

    def on_status(sample: Sample) -> None:
        sent_ms[decode_stamp(sample.attachment)[0]] = 1e3 * time.time()

    with Bus(client_config([endpoint])) as bus, sync_playwright() as playwright:
        bus.subscribe(topics.STATUS.key("tsd"), on_status)
        browser = playwright.chromium.launch(executable_path=executable(), args=list(FLAGS))
        page = browser.new_page(viewport=_SIZE)
        page.add_init_script(_NOTES)
        page.goto(url)
        wait_for_scene(page)
        with_scene_ms = watch(page, sent_ms, seconds)
        page.evaluate(HIDE)
        alone_ms = watch(page, sent_ms, seconds)
        browser.close()
    return with_scene_ms, alone_ms


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
