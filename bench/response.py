"""First picture of the page, main-thread blocking, and delay from input to command.

All while viser renders the scene on the CPU. The first picture is the portrait of the robot with
its mode and STOP; the 3D view takes its place.
"""

from __future__ import annotations

import http.server
import statistics
import threading
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

from bench.page import wait_for_scene
from bench.programs import dashboard, mock
from bench.table import Row, Run, percentile
from tests.support.browser import FLAGS, PATIENCE_MS, executable

PICTURE_S, BLOCK_MS, COMMAND_MS = 1.5, 50.0, 8.0
"""Allowed time to the first picture, block of the thread, and delay in excess of a bare page."""
_MOVES, _PERIOD_MS = 300, 25.0
_NOTES = """
window.blocksMs = [0];
window.delaysMs = [];
let tickMs = performance.now();
setInterval(() => {
  const lateMs = performance.now() - tickMs - 10;
  if (lateMs > 1) blocksMs.push(lateMs);
  tickMs = performance.now();
}, 10);
let movedMs = null;
let knownMs = 0;
const note = ({ timeStamp }) => {
  if (timeStamp > knownMs) [movedMs, knownMs] = [movedMs ?? timeStamp, timeStamp];
};
for (const type of ["pointerrawupdate", "pointermove"]) addEventListener(type, note, true);
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (data) {
  send.call(this, data);
  if (movedMs === null || !String(data).includes('"drive"')) return;
  delaysMs.push(performance.now() - movedMs);
  movedMs = null;
};
"""
"""Records timer delays, and the time from each pointer movement to its command."""
_PICTURE = """new Promise((done) => {
  const look = () => {
    const portrait = document.querySelector(".splash img.portrait");
    const shown = portrait?.complete && portrait.naturalWidth > 0;
    const said = document.querySelector(".stop") && document.querySelector(".mode")?.textContent;
    requestAnimationFrame(shown && said ? () => done(performance.now()) : look);
  };
  look();
})"""
"""Time at which the page shows the robot's portrait, its mode and STOP."""
_BARE = b"""<!doctype html><title>bare page</title>
<div class="stick" style="width: 150px; height: 150px"></div>
<script>
const socket = new WebSocket("ws" + location.origin.slice(4)); // It is refused, and drops all.
document.querySelector(".stick").onpointermove = ({ clientX, clientY }) =>
  socket.send(JSON.stringify({ t: "drive", clientX, clientY }));
</script>"""


def rows(run: Run) -> Iterator[Row]:
    """Open pages in fresh browsers, then move the stick on the page and on a bare one in turn."""
    with ExitStack() as stack:
        url = stack.enter_context(dashboard(stack.enter_context(mock())))
        playwright = stack.enter_context(sync_playwright())
        launch = playwright.chromium.launch

        @contextmanager
        def browser() -> Generator[Browser]:
            fresh = launch(executable_path=executable(), args=list(FLAGS))
            try:
                yield fresh
            finally:
                fresh.close()

        scenes_s: list[float] = []

        def picture_s() -> tuple[float]:
            with browser() as fresh:
                page = opened(fresh, url)
                shown_s = page.evaluate(_PICTURE) / 1000.0
                wait_for_scene(page)
                page.locator(".splash").wait_for(state="hidden", timeout=PATIENCE_MS)
                scenes_s.append(page.evaluate("performance.now()") / 1000.0)
                return (shown_s,)

        yield from run.alternate(
            ["response.picture"],
            picture_s,
            lambda: (PICTURE_S,),
            rounds=5,
            note=lambda: f"3D view after {statistics.median(scenes_s):.1f} s",
        )
        moves = int(run.pick(_MOVES, 20))
        with browser() as fresh, bare_page() as bare_url:
            page, bare = opened(fresh, url), opened(fresh, bare_url)
            take_control(page)
            yield from run.alternate(
                ["response.command", "response.block"],
                lambda: (move(page, moves), max(page.evaluate("blocksMs.splice(0)"), default=1.0)),
                lambda: (move(bare, moves) + COMMAND_MS, BLOCK_MS),
                rounds=3,
            )


def opened(browser: Browser, url: str) -> Page:
    """Return a new page that records these."""
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.add_init_script(_NOTES)
    page.goto(url)
    return page


def take_control(page: Page) -> None:
    """Take control of the robot and arm it."""
    page.locator(".splash").wait_for(state="hidden", timeout=PATIENCE_MS)
    for name in ("Take control", "Arm"):
        page.get_by_role("button", name=name, exact=True).click(timeout=PATIENCE_MS)
    page.get_by_role("status", name="Mode").get_by_text("Ready").wait_for(timeout=PATIENCE_MS)
    page.evaluate("blocksMs.splice(0)")  # Discard records from loading the page.


def move(page: Page, moves: int) -> float:
    """Move the stick in circles; return the 99th percentile of the delay to the command, ms."""
    page.bring_to_front()
    box = page.locator(".stick").first.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate("delaysMs.splice(0)")
    for i in range(moves):
        page.mouse.move(x + 10.0 + i % 7, y - 10.0 - i % 5)
        page.wait_for_timeout(_PERIOD_MS)
    page.mouse.up()
    return percentile(page.evaluate("delaysMs.splice(0)"), 0.99)


@contextmanager
def bare_page() -> Generator[str]:
    """Serve a page with only a stick."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(_BARE)

        def log_message(self, format: str, *_: object) -> None:  # noqa: A002  As in the base class.
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()
