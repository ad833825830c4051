"""What axe-core finds in the page: nothing serious in nine states, in light and dark.

Beside it, what axe-core leaves open: it judges no text over a canvas, and lets small targets pass
that have room around them.
"""

from __future__ import annotations

import contextlib
import re
import signal
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.app.conftest import Program
from tests.support.browser import (
    FEW_FRAMES,
    PATIENCE_MS,
    QUICK,
    give_back,
    mode,
    press,
    take_control_and_arm,
)
from tests.support.legibility import FAINT, SMALL, STYLED
from tests.support.page_stage import OPERATOR, page_stage, state

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

AXE = Path(__file__).parents[2] / "web/node_modules/axe-core/axe.min.js"
RUN = """async () => {
  const rules = {
    "target-size": { enabled: true },
    "label-content-name-mismatch": { enabled: true },
  };
  const { violations } = await axe.run(document, { resultTypes: ["violations"], rules });
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .flatMap(({ id, nodes }) => nodes.map(({ target, html }) => `${id}: ${target} ${html}`));
}"""
POINTER_PX, FINGER_PX = 24, 44
UNCONFIRMED = "STOP NOT CONFIRMED. Press the hardware stop."
ASKED = {"holder": "bob", "requested_by": OPERATOR, "request_expires_in_s": 9.0}


def findings(page: Page) -> list[str]:
    """Return what is found that is serious."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text("utf-8"))
    return [*page.evaluate(RUN), *page.evaluate(FAINT), *page.evaluate(SMALL, POINTER_PX)]


def report(found: dict[str, list[str]]) -> str:
    """Return all findings, each in a line with its state."""
    return "\n".join(f"{name}: {each}" for name, of_state in found.items() for each in of_state)


@dataclass
class Served:
    """A simulated robot with its dashboard."""

    mock: Program
    url: str


@pytest.fixture(scope="module")
def served(start_shared: Callable[..., Program]) -> Served:
    """Programs that all tests share: starting them takes its time."""
    mock = start_shared("tsd_mock", "--listen", "tcp/127.0.0.1:0")
    dashboard = start_shared("tsd_dashboard", "--port", "0", "--connect", mock.ready().split()[-1])
    return Served(mock, re.findall(r"http://\S+", dashboard.ready())[0] + QUICK)


@pytest.fixture
def open_page(browser: Browser) -> Generator[Callable[..., Page]]:
    """Open pages in light or dark; none goes on drawing after the test."""
    with contextlib.ExitStack() as ends:

        def opened(scheme: str, **settings: Any) -> Page:
            viewport = {"width": 1280, "height": 720}
            wanted = {"color_scheme": scheme, "viewport": viewport} | settings
            context = browser.new_context(**wanted)
            ends.callback(context.close)
            return context.new_page()

        yield opened


def show_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click(timeout=PATIENCE_MS)
    page.wait_for_function(STYLED)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_serious_in_six_states(
    served: Served, open_page: Callable[..., Page], scheme: str
) -> None:
    found: dict[str, list[str]] = {}
    page = open_page(scheme)
    page.add_init_script(FEW_FRAMES)
    page.goto(served.url)
    mode(page, "disarmed")
    expect(page.get_by_role("slider", name="Forward (m/s)")).to_be_visible(timeout=PATIENCE_MS)
    found["first visit, Drive tab"] = findings(page)
    boxes = [tab.bounding_box() for tab in page.get_by_role("tab").all()]
    assert len({box["y"] for box in boxes if box is not None}) == 1, "tabs stand in one row"
    press(page, "Skip")
    take_control_and_arm(page)
    show_tab(page, "Gimbals")
    found["in control and armed, Gimbals tab"] = findings(page)
    show_tab(page, "Plots")
    plots = page.get_by_role("group", name="Plots", exact=True)
    expect(plots.locator(".u-over").first).to_be_visible(timeout=PATIENCE_MS)
    press(page, "Fields")
    expect(page.get_by_role("searchbox", name="Find a field")).to_be_visible()
    found["Plots tab, with the list of fields"] = findings(page)
    press(page, "Fields")
    show_tab(page, "Student")
    student = page.get_by_role("region", name="Student", exact=True)
    expect(student.get_by_text("Top speed forward")).to_be_visible(timeout=PATIENCE_MS)
    found["Student tab"] = findings(page)
    show_tab(page, "View")
    page.keyboard.press("m")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys and colours")).to_be_visible()
    found["map, sheet of keys and colours, View tab"] = findings(page)
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    mode(page, "stopped")
    show_tab(page, "Health")
    found["stopped, Health tab"] = findings(page)
    show_tab(page, "Plots")
    served.mock.process.send_signal(signal.SIGSTOP)
    mode(page, "no signal")
    page.keyboard.press(" ")
    expect(page.get_by_text(UNCONFIRMED)).to_be_visible(timeout=PATIENCE_MS)
    found["the robot is silent and confirms no stop, Plots tab"] = findings(page)
    served.mock.process.send_signal(signal.SIGCONT)
    expect(page.get_by_text(UNCONFIRMED)).to_be_hidden(timeout=PATIENCE_MS)
    give_back(page)
    assert not any(found.values()), report(found)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_serious_while_control_changes_hands(browser: Browser, scheme: str) -> None:
    """Without a robot: a page is silent, and loses control, for as long as axe-core looks at it."""
    with page_stage(browser) as stage:
        page, found = stage.page, dict[str, list[str]]()
        page.evaluate("(to) => (document.documentElement.dataset.mantineColorScheme = to)", scheme)
        page.add_style_tag(content="aside, #connection { display: none }")  # No panel of viser.
        stage.show(state("driving", lease=ASKED))
        press(page, "Take over…")
        expect(page.get_by_role("alertdialog")).to_be_visible()
        found["asking for control, with the question before a take-over"] = findings(page)
        stage.show(
            state("driving", you=True, lease={"requested_by": "bob", "request_expires_in_s": 9.0})
        )
        expect(page.get_by_role("button", name="Hand over")).to_be_visible()
        found["asked for control"] = findings(page)
    assert not any(found.values()), report(found)


def test_targets_are_large_enough_for_fingers(
    served: Served, open_page: Callable[..., Page]
) -> None:
    """On a phone, in each tab of its drawer; and on a tablet, beside the scene."""
    touch = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    page = open_page("light", **touch)
    page.goto(served.url)
    mode(page, "disarmed")
    found = {"first visit": too_small(page)}
    press(page, "Skip")
    for name in open_drawer(page):
        show_tab(page, name)
        found[name] = too_small(page)
    assert not any(found.values()), report(found)
    page.set_viewport_size({"width": 768, "height": 1024})
    page.wait_for_function("document.querySelector('[data-tsd-drawer]') === null")
    expect(page.get_by_role("tab").first).to_be_visible(timeout=PATIENCE_MS)
    page.wait_for_function(STYLED)
    beside = page.evaluate(SMALL, FINGER_PX)
    assert not [each for each in beside if 'role="tab"' in each], report({"tablet": beside})


def too_small(page: Page) -> list[str]:
    """Return what is too small for fingers, once what has been opened is there with its styles."""
    found, looks = list[str](), 0
    for _ in range(30):
        found = page.evaluate(SMALL, FINGER_PX)
        looks = 0 if found else looks + 1
        if looks == 3:
            break
        page.wait_for_timeout(100)
    return found


def open_drawer(page: Page) -> Iterator[str]:
    """Open the panel of a phone, and yield the names of its tabs."""
    page.locator("[data-tsd-drawer]").click(position={"x": 180, "y": 16}, timeout=PATIENCE_MS)
    tabs = page.get_by_role("tab")
    expect(tabs.first).to_be_visible(timeout=PATIENCE_MS)
    yield from tabs.all_inner_texts()
