"""Two people at two pages: one asks for control, the other hands it over, by keyboard."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect, sync_playwright

from tests.app.conftest import Program
from tests.support.browser import FLAGS_WITHOUT_SCENE, PATIENCE_MS, executable, mode, press

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

ACTIVE = "document.querySelector('#tsd-overlay').shadowRoot.activeElement?.textContent ?? ''"


def notice(page: Page) -> str:
    """Wait for the notice about a request, and return what it says."""
    shown = page.get_by_role("group", name="Request for control")
    expect(shown).to_be_visible(timeout=PATIENCE_MS)
    # Twice: in the notice, and where screen readers hear of it.
    said = shown.locator("strong").inner_text()
    expect(page.get_by_role("alert").filter(has_text=said)).to_have_count(1)
    return said


def test_control_is_asked_for_and_handed_over_by_keyboard(start: Callable[..., Program]) -> None:
    demo = start(
        "tsd_demo", "--no-record", "--no-browser", "--until-eof", "--port", "0", "--bus-port", "0"
    )
    (url,) = re.findall(r"http://\S+", demo.ready())
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=executable(), args=list(FLAGS_WITHOUT_SCENE)
        )
        alice, bob = (browser.new_context().new_page() for _ in range(2))
        for page in (alice, bob):
            page.goto(url)
            mode(page, "disarmed")
            press(page, "Skip")
        press(alice, "Take control")
        expect(alice.get_by_text("you drive", exact=True)).to_be_visible(timeout=PATIENCE_MS)
        link = alice.get_by_role("status", name="Link")
        expect(link).to_contain_text(re.compile(r"(good|fair|poor)\s*\d+ ms"), timeout=PATIENCE_MS)
        before = alice.evaluate(ACTIVE)
        press(bob, "Ask for control")
        assert "You have asked" in notice(bob)
        assert re.fullmatch(r"web-[0-9a-f]{8} asks for control\.", notice(alice))
        assert alice.evaluate(ACTIVE) == before, "the notice takes no focus"
        hand_over = alice.get_by_role("button", name="Hand over")
        hand_over.focus()
        alice.keyboard.press("Enter")
        expect(bob.get_by_text("you drive", exact=True)).to_be_visible(timeout=PATIENCE_MS)
        expect(alice.get_by_role("button", name="Ask for control")).to_be_visible(
            timeout=PATIENCE_MS
        )
        expect(alice.get_by_role("group", name="Request for control")).to_be_hidden()
        # And back, by force, with a reason that both can read.
        press(alice, "Ask for control")
        notice(bob)
        press(alice, "Take over…")
        alice.get_by_label("Reason, for all to see").fill("it is my robot")
        press(alice, "Take over")
        for page in (alice, bob):
            messages = page.get_by_role("log", name="Messages")
            expect(messages).to_contain_text("it is my robot", timeout=PATIENCE_MS)
        expect(alice.get_by_text("you drive", exact=True)).to_be_visible(timeout=PATIENCE_MS)
        browser.close()
