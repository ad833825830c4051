"""The buttons of the page, without the rest of it: their descriptions and the tooltip."""

from __future__ import annotations

from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.browser import FLAGS_WITHOUT_SCENE
from tests.support.page_client import site

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

MADE = """async () => {
  const { Button, tooltip } = await import("/static/button.js");
  window.arm = new Button("Arm", () => {}, { tip: "Switches the motors on" });
  window.hide = new Button("Hide controls", () => {}, { tip: "Hides the stick" });
  document.body.replaceChildren(arm.element, hide.element, tooltip.element);
}"""
TEXTS = """(ms) => new Promise((done) => {
  const seen = new Set();
  const timer = setInterval(() => seen.add(document.querySelector(".tip").textContent), 20);
  setTimeout(() => (clearInterval(timer), done([...seen])), ms);
})"""
"""What the tooltip says in that time."""


@pytest.fixture
def page(browser: Browser) -> Generator[Page]:
    with site() as served:
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{served.port}/healthz")
        page.evaluate(MADE)
        yield page
        page.close()


def test_a_button_that_becomes_another_one_has_its_description(page: Page) -> None:
    hide = page.get_by_role("button", name="Hide controls")
    expect(hide).to_have_accessible_description("Hides the stick")
    page.evaluate("hide.setLabel('Show controls', 'Shows the stick')")
    shown = page.get_by_role("button", name="Show controls")
    expect(shown).to_have_accessible_description("Shows the stick")
    page.evaluate("hide.setDisabledReason('Not now.')")
    expect(shown).to_have_accessible_description("Not now.")


def test_the_tooltip_of_a_focused_button_ends_when_the_pointer_shows_another(page: Page) -> None:
    page.keyboard.press("Tab")
    tip = page.locator(".tip")
    expect(tip).to_have_text("Switches the motors on")
    page.get_by_role("button", name="Hide controls").hover()
    expect(tip).to_have_text("Hides the stick")
    assert page.evaluate(TEXTS, 1500) == ["Hides the stick"]


def test_a_reason_is_shown_no_longer_than_it_holds(page: Page) -> None:
    page.evaluate("hide.setDisabledReason('Not now.'); hide.use()")
    tip = page.locator(".tip")
    expect(tip).to_have_text("Not now.")
    page.evaluate("hide.setDisabledReason(null)")
    expect(tip).to_be_hidden()
