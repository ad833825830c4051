"""Two operators at two pages: one requests control, the other grants it, by keyboard."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect, sync_playwright

from tests.support.browser import (
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    click_through,
    executable,
    mode,
    press,
)
from tests.support.programs import Program

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

ACTIVE = "document.activeElement?.textContent ?? ''"
SOON_MS = 30_000
"""A stalled page loses control, so an expected change may never occur."""


def deck(page: Page) -> Locator:
    return page.get_by_role("region", name="Controls")


def drives(page: Page) -> Locator:
    return page.get_by_role("banner").get_by_text("You drive", exact=True)


def give_control(page: Page, other: Page) -> None:
    """Give control to one page, from any state, so that the other can request it."""
    ask = other.get_by_role("button", name="Ask for control")
    for _ in range(PATIENCE_MS // 200):  # Each turn waits for 200 ms.
        if drives(page).is_visible() and ask.is_visible():
            break
        click_through(page, "Take control", "Keep control")
        click_through(other, "Withdraw", "Release control")
    expect(drives(page)).to_be_visible()
    link = page.get_by_role("button", name=re.compile("^Link"))
    expect(link).to_contain_text(re.compile(r"\d+\s*ms"), timeout=SOON_MS)


def hand_over_by_keyboard(alice: Page, bob: Page) -> None:
    before = alice.evaluate(ACTIVE)
    press(bob, "Ask for control", SOON_MS)
    expect(deck(bob)).to_contain_text("You asked Guest ", timeout=SOON_MS)
    asks = re.compile(r"Guest [0-9A-F]{4} asks for control\.")
    expect(deck(alice)).to_contain_text(asks, timeout=SOON_MS)
    # Once, and so that screen readers hear of it.
    expect(alice.locator("[aria-live=polite]").filter(has_text=asks)).to_have_count(1)
    assert alice.evaluate(ACTIVE) == before, "the question takes no focus"
    expect(drives(alice)).to_be_visible()  # A stalled page loses control to the requester.
    expect(drives(bob)).to_be_hidden()
    alice.get_by_role("button", name="Hand over").focus()
    alice.keyboard.press("Enter")
    expect(drives(bob)).to_be_visible(timeout=SOON_MS)
    expect(alice.get_by_role("button", name="Ask for control")).to_be_visible(timeout=SOON_MS)
    expect(deck(alice)).not_to_contain_text(asks)


def take_over_by_force(alice: Page, bob: Page) -> None:
    """Take over with a reason, which both pages show."""
    press(alice, "Take over", SOON_MS)
    dialog = alice.get_by_role("dialog", name="Take over")
    dialog.get_by_label("Reason, for all to see").fill("it is my robot")
    dialog.get_by_role("button", name="Take over").click(timeout=SOON_MS)
    for page in (alice, bob):
        events = page.get_by_role("log", name="Last events")
        expect(events).to_contain_text("it is my robot", timeout=SOON_MS)
    expect(drives(alice)).to_be_visible(timeout=SOON_MS)


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
            page.get_by_role("tab", name="Health").click()
        give_control(alice, bob)
        hand_over_by_keyboard(alice, bob)
        give_control(bob, alice)
        take_over_by_force(alice, bob)
        browser.close()
