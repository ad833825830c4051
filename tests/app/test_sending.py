"""What the page's scripts put on their socket: never too much, and a release in any case."""

from __future__ import annotations

from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, Page

from tests.support.browser import FLAGS_WITHOUT_SCENE, WATCH_STALLS, trials
from tests.support.page_client import site
from tsd_twin.dashboard.gateway.socket_limits import TELEOP

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

MADE = """async () => {
  const { Link } = await import("/static/link.js");
  const { Drive } = await import("/static/drive.js");
  const link = new Link("0123456789abcdef");
  const sent = [];
  link._socket = {
    readyState: WebSocket.OPEN, bufferedAmount: 0, send: (text) => sent.push(JSON.parse(text).t),
  };
  link.connected = true;
  link.welcome = { role: "operator", may_stop: true };
  link.robot = { panel: "gimbals", twist_scale_m: 1 };
  const status = { mode: "ready", limits: { speed_mps: 1, turn_rate_rad_per_s: 1 } };
  link.state = { has_control: true, status_seq: 1, age_ms: 0, status };
  setInterval(() => (link.stateMs = performance.now()), 5);
  link.stateMs = performance.now();
  const drive = new Drive(link);
  const stick = { unit: { x: 1, y: 0, turn: 0 }, held: false, cancel() { this.held = false; } };
  drive.add(stick);
  Object.assign(window, { link, drive, stick, sent });
}"""


@pytest.fixture(scope="module")
def scripts(browser: Browser) -> Generator[Page]:
    with site() as served:
        page = browser.new_page()
        page.add_init_script(WATCH_STALLS)
        page.goto(f"http://127.0.0.1:{served.port}/healthz")
        page.evaluate(MADE)
        yield page
        page.close()


def test_a_release_and_a_stop_go_out_when_the_browser_holds_back_what_came_before(
    scripts: Page,
) -> None:
    sent = scripts.evaluate(
        """() => {
          sent.length = 0;
          stick.held = true;
          drive.changed();
          link._socket.bufferedAmount = 1e6;
          drive.changed();
          link.send({ t: "heartbeat" });
          stick.held = false;
          drive.changed();
          drive.stop();
          link._socket.bufferedAmount = 0;
          return sent;
        }"""
    )
    assert sent == ["drive", "release", "stop"]


def test_a_stick_that_moves_all_the_time_stays_far_below_the_limit(scripts: Page) -> None:
    """Pointers of some mice say a thousand times a second where they are."""
    for trial in trials(scripts):
        with trial:
            per_s = scripts.evaluate(
                """async () => {
                  sent.length = 0;
                  stick.held = true;
                  const begin = performance.now();
                  while (performance.now() - begin < 2000) {
                    for (let i = 0; i < 10; i++) drive.changed();
                    await new Promise((done) => setTimeout(done));
                  }
                  stick.held = false;
                  drive.changed();
                  return sent.filter((t) => t === "drive").length / 2;
                }"""
            )
            assert 30.0 < per_s <= 0.75 * TELEOP.kinds["drive"].per_s
