"""axe-core finds no serious violation in any page state, in light and dark.

Two further rules cover cases that axe-core leaves undecided: text over a canvas, and small targets
with space around them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.app.legibility import FAINT, SMALL
from tests.app.page_states import REFUSED, STATES, TABS, open_tab
from tests.support.browser import FLAGS_WITHOUT_SCENE
from tests.support.page_stage import PageStage, page_stage, state

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(300),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

AXE = Path(__file__).parents[2] / "web/node_modules/axe-core/axe.min.js"
RUN = """async () => {
  const rules = {
    "target-size": { enabled: true },
    "label-content-name-mismatch": { enabled: true },
  };
  const asked = { iframes: false, resultTypes: ["violations"], rules };
  const { violations } = await axe.run(document, asked);
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .flatMap(({ id, nodes }) => nodes.map(({ target, html }) => `${id}: ${target} ${html}`));
}"""
POINTER_PX = 24


def findings(page: Page) -> list[str]:
    """Return the serious violations on the page."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text("utf-8"))
    return [*page.evaluate(RUN), *page.evaluate(FAINT), *page.evaluate(SMALL, POINTER_PX)]


def report(found: dict[str, list[str]]) -> str:
    """Return all findings, each in a line with its states."""
    return "\n".join(f"{', '.join(names[:4])}: {each}" for each, names in found.items())


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    "size", [(1280, 720), (390, 844), (844, 390)], ids=lambda size: f"{size[0]}x{size[1]}"
)
def test_nothing_serious_in_any_state_or_tab(
    browser: Browser, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    found: dict[str, list[str]] = {}
    with page_stage(browser, recordings=True, touch=size[0] < 1000, size=size) as stage:
        page = stage.page
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        expect(page.locator("html")).to_have_attribute("data-theme", scheme)

        def look(name: str) -> None:
            for each in findings(page):
                found.setdefault(each, []).append(name)

        for name, shown in STATES.items():
            stage.show(shown)
            expect(page.get_by_role("status", name="Mode")).to_have_text(word_of(shown))
            look(name)
        stage.say(REFUSED)
        look("a notice")
        stage.show(STATES["ready"])
        for name in TABS:
            if open_tab(stage, name):
                look(f"tab {name}")
        look_at_what_is_opened(stage, look)
    assert not found, report(found)


def word_of(shown: dict[str, Any]) -> re.Pattern[str]:
    """Return the word that the page shows for the mode, or for a replay or a lost signal."""
    if shown.get("source") == "recording":
        return re.compile("Replay")
    word = "No signal" if shown["age_ms"] else shown["status"]["mode"]
    return re.compile(word, re.IGNORECASE)


def look_at_what_is_opened(stage: PageStage, look: Callable[[str], None]) -> None:
    """Check the dialogs: map, keys, an alarm and the page of all robots."""
    page = stage.page
    page.keyboard.press("Escape")
    page.keyboard.press("n")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys and settings")).to_be_visible()
    look("map, keys and settings")
    page.keyboard.press("Escape")
    take_over = page.get_by_role("button", name="Take over")
    stage.show(state("driving", lease={"holder": "bob"}))
    if take_over.is_visible():  # In a narrow window it is in the sheet.
        take_over.click()
        expect(page.get_by_role("dialog", name="Take over")).to_be_visible()
        look("the question before a take-over")
        page.keyboard.press("Escape")
    stage.show(state("ready", you=True))
    page.keyboard.press(" ")
    expect(page.get_by_role("alert").filter(has_text="not confirmed")).to_be_visible()
    look("a stop that is not confirmed")
    page.evaluate("location.hash = '#fleet'")
    expect(page.get_by_role("button", name="STOP ALL")).to_be_visible()
    look("all robots")
    page.evaluate("location.hash = ''")
