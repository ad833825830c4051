"""What axe-core finds in the page: nothing serious in six states, in light and dark."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.app.conftest import Program
from tests.support.browser import PATIENCE_MS, QUICK, mode, press, take_control_and_arm

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

AXE = Path(__file__).parents[2] / ".venv/js/node_modules/axe-core/axe.min.js"
RUN = """async () => {
  const rules = { "target-size": { enabled: true } };
  const { violations } = await axe.run(document, { resultTypes: ["violations"], rules });
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .flatMap(({ id, nodes }) => nodes.map(({ target, html }) => `${id}: ${target} ${html}`));
}"""
UNCONFIRMED = "STOP NOT CONFIRMED. Press the hardware stop."


def findings(page: Page) -> list[str]:
    """Return what axe-core finds that is serious."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text("utf-8"))
    return page.evaluate(RUN)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_serious_in_six_states(
    start: Callable[..., Program], browser: Browser, scheme: str
) -> None:
    mock = start("tsd_mock", "--listen", "tcp/127.0.0.1:0")
    served = start("tsd_dashboard", "--port", "0", "--connect", mock.ready().split()[-1])
    url = re.findall(r"http://\S+", served.ready())[0] + QUICK
    options = {"color_scheme": scheme, "viewport": {"width": 1280, "height": 720}}
    found: dict[str, list[str]] = {}
    page = browser.new_context(**options).new_page()
    page.goto(url)
    mode(page, "disarmed")
    expect(page.get_by_role("slider", name="Forward (m/s)")).to_be_visible(timeout=PATIENCE_MS)
    found["first visit, Drive tab"] = findings(page)
    press(page, "Skip")
    take_control_and_arm(page)
    page.get_by_role("tab", name="Gimbals").click(timeout=PATIENCE_MS)
    found["in control and armed, Gimbals tab"] = findings(page)
    page.get_by_role("tab", name="Plots").click(timeout=PATIENCE_MS)
    plots = page.get_by_role("group", name="Plots", exact=True)
    expect(plots.locator(".u-over").first).to_be_visible(timeout=PATIENCE_MS)
    press(page, "Fields")
    expect(page.get_by_role("searchbox", name="Find a field")).to_be_visible()
    found["Plots tab, with the list of fields"] = findings(page)
    press(page, "Fields")
    page.get_by_role("tab", name="Student").click(timeout=PATIENCE_MS)
    student = page.get_by_role("region", name="Student", exact=True)
    expect(student.get_by_text("Top speed forward")).to_be_visible(timeout=PATIENCE_MS)
    found["Student tab"] = findings(page)
    other = browser.new_context(**options).new_page()
    other.goto(url)
    press(other, "Skip")
    press(other, "Ask for control")
    press(other, "Take over…")
    expect(other.get_by_role("alertdialog")).to_be_visible(timeout=PATIENCE_MS)
    found["asking for control, with the question before a take-over"] = findings(other)
    found["asked for control"] = findings(page)
    other.close()
    page.bring_to_front()
    page.get_by_role("tab", name="View").click(timeout=PATIENCE_MS)
    page.keyboard.press("m")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys and colours")).to_be_visible()
    found["map, sheet of keys and colours, View tab"] = findings(page)
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    mode(page, "stopped")
    page.get_by_role("tab", name="Health").click(timeout=PATIENCE_MS)
    found["stopped, Health tab"] = findings(page)
    page.get_by_role("tab", name="Plots").click(timeout=PATIENCE_MS)
    mock.process.send_signal(signal.SIGSTOP)
    mode(page, "no signal")
    page.keyboard.press(" ")
    expect(page.get_by_text(UNCONFIRMED)).to_be_visible(timeout=PATIENCE_MS)
    found["the robot is silent and confirms no stop, Plots tab"] = findings(page)
    mock.process.send_signal(signal.SIGCONT)
    expect(page.get_by_text(UNCONFIRMED)).to_be_hidden(timeout=PATIENCE_MS)
    page.context.close()
    assert {state: each for state, each in found.items() if each} == {}
