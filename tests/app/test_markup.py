"""Text from robots and operators is never executed in a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.support.browser import FLAGS_WITHOUT_SCENE, PATIENCE_MS, mode
from tests.support.programs import Program
from tests.support.robot_node import matched
from tsd_twin import robots
from tsd_twin.bus import Bus, as_client, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.events import Event
from tsd_twin.messages.topics import QoS

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]


def markup(where: str) -> str:
    """Markup that leaves a marker in the page if executed."""
    return f"<img src=x onerror=\"document.documentElement.dataset.ran='{where}'\">"


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True)
def test_markup_in_titles_reasons_and_events_is_text(
    browser: Browser, start: Callable[..., Program], tmp_path: Path
) -> None:
    text = re.sub(
        r"(?m)^title = .*$",
        lambda _: f"title = '''{markup('title')}'''",
        robots.read_description("tsd"),
        count=1,
    )
    toml = tmp_path / "mine.toml"
    toml.write_text(text, "utf-8")
    robot_at = (
        start("tsd_mock", "--robot", str(toml), "--listen", "tcp/127.0.0.1:0").ready().split()[-1]
    )
    url = re.findall(
        r"http://\S+", start("tsd_dashboard", "--port", "0", "--connect", robot_at).ready()
    )[0]
    page = browser.new_page()
    page.goto(url)
    mode(page, "disarmed")
    with Bus(as_client(client_config([robot_at]), 10.0)) as bus:
        events = bus.publisher(topics.event_key("tsd", "id"), QoS.EVENT)
        for kind in ("id", "lease", markup("kind")):
            said = Event(kind, markup("event"))
            events.put(json.dumps({"kind": said.kind, "text": said.text}).encode())
        stop = {"operator": markup("operator"), "reason": markup("reason")}
        putting = matched(bus.publisher(topics.STOP.key("tsd"), QoS.REAL_TIME))
        putting.put(json.dumps(stop).encode())
        mode(page, "stopped")
        expect(page.get_by_text(markup("reason")).first).to_be_visible(timeout=PATIENCE_MS)
        expect(page.get_by_text(markup("event")).first).to_be_attached(timeout=PATIENCE_MS)
        page.wait_for_timeout(500)  # A broken image takes a moment to report its error.
    assert page.locator("img[src=x]").count() == 0
    assert page.locator("html").get_attribute("data-ran") is None
    assert markup("title") in page.content() or "&lt;img" in page.content()
    page.close()
