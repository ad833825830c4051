"""Keyboard operation, the list of keys and the operator's name, in a real browser."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Generator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.support.browser import FEW_FRAMES, PATIENCE_MS, give_back, mode, until_linked
from tests.support.programs import Program
from tests.support.withheld import budget

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

MOVING = re.compile(r"^(0\.(0[5-9]|[1-9])|[1-9])")
"""A page that was slow when it took control gets a low speed limit, as over a slow link."""
AT_REST = "0.00"
IS_ON_TOP = """(node) => {
  const { left, top, width, height } = node.getBoundingClientRect();
  return node.contains(document.elementFromPoint(left + width / 2, top + height / 2));
}"""
_TABS = 80
_TRIES = 10
_WAIT_MS = PATIENCE_MS / _TRIES


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Program], browser: Browser) -> Page:
    """One demo and one page for all tests."""
    ports = ("--port", "0", "--bus-port", "0")
    line = start_shared("tsd_demo", "--no-browser", "--no-record", "--until-eof", *ports)
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.add_init_script(FEW_FRAMES)
    page.goto(re.findall(r"http://\S+", line.ready())[0])
    mode(page, "disarmed")
    return page


@pytest.fixture
def page(shared: Page) -> Generator[Page]:
    yield shared
    give_back(shared)


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


def tab_to(page: Page, target: Locator) -> None:
    """Go to a control with the Tab key alone."""
    expect(target).to_be_visible(timeout=_WAIT_MS)
    for _ in range(_TABS):
        # Do not wait for the control, because it may already be gone.
        if target.evaluate_all("(found) => found.includes(document.activeElement)"):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"Tab does not reach {target}")


def speed_is(page: Page, figure: str | re.Pattern[str], patience_ms: float = 5000) -> bool:
    try:
        expect(page.locator(".hero .n")).to_have_text(figure, timeout=patience_ms)
    except AssertionError:
        return False
    return True


def get_ready(page: Page) -> None:
    """Take control, reset and arm with Enter as needed, and wait for standstill.

    A starved page falls silent and loses control; a starved robot enters a fault.
    """
    said = page.get_by_role("status", name="Mode")
    for _ in budget.tries("take control and arm by key", _TRIES):
        with contextlib.suppress(AssertionError):
            for step, hold_ms in (("Take control", 0), ("Hold to reset", 1500), ("Arm", 0)):
                if button(page, step).is_visible():
                    tab_to(page, button(page, step))
                    page.keyboard.down("Enter")
                    page.wait_for_timeout(hold_ms)
                    page.keyboard.up("Enter")
                    page.wait_for_timeout(300)
            expect(said).to_contain_text("Ready", timeout=_WAIT_MS)
            if speed_is(page, AT_REST):
                return
    raise AssertionError(f"not ready: {said.inner_text()}")


def hold_until_it_moves(page: Page, key: str, focused: Locator | None = None) -> None:
    """Hold a key until the robot moves; retry if a stalled page released it."""
    for _ in budget.tries("hold a key", _TRIES):
        get_ready(page)
        if focused is not None:
            tab_to(page, focused)
        page.keyboard.down(key)
        moves = speed_is(page, MOVING)
        page.keyboard.up(key)
        if moves:
            assert speed_is(page, AT_REST, PATIENCE_MS), "it stops when the key is released"
            return
    raise AssertionError(f"{key} does not move the robot")


def hold_to_reset(page: Page) -> None:
    """Hold Enter until the robot is reset, and keep it held; retry if a starved page let it go."""
    for _ in budget.tries("hold Enter to reset", _TRIES):
        with contextlib.suppress(AssertionError):
            if button(page, "Take control").is_visible():
                tab_to(page, button(page, "Take control"))
                page.keyboard.press("Enter")
            tab_to(page, button(page, "Hold to reset"))
            page.keyboard.down("Enter")
            said = page.get_by_role("status", name="Mode")
            expect(said).to_contain_text("Disarmed", timeout=_WAIT_MS)
            return
        page.keyboard.up("Enter")
    raise AssertionError("holding Enter does not reset the robot")


def test_a_robot_is_driven_by_keyboard_alone(page: Page) -> None:
    """Take control, arm, drive by letter, stick and slider, stop, reset, and release control."""
    page.keyboard.press("Tab")
    expect(button(page, "STOP")).to_be_focused()
    hold_until_it_moves(page, "w")
    hold_until_it_moves(page, "ArrowUp", page.get_by_role("application"))
    slider = page.get_by_role("tabpanel").get_by_role("slider", name="Forward")
    hold_until_it_moves(page, "ArrowRight", slider)
    get_ready(page)
    tab_to(page, slider)
    page.keyboard.press(" ")
    mode(page, "stopped")
    expect(page.get_by_text("You pressed STOP")).to_be_visible()
    hold_to_reset(page)
    for _ in range(5):
        page.keyboard.down("Enter")  # Auto-repeat, as with a held key.
    page.keyboard.up("Enter")
    page.wait_for_timeout(500)
    mode(page, "disarmed")
    if not button(page, "Take control").is_visible():
        tab_to(page, button(page, "Release control"))
        page.keyboard.press("Enter")
    expect(button(page, "Take control")).to_be_visible(timeout=PATIENCE_MS)


def test_a_key_opens_the_sheet_which_covers_no_stop_and_gives_the_focus_back(page: Page) -> None:
    stick = page.get_by_role("application")
    stick.focus()
    page.keyboard.press("?")
    sheet = page.get_by_role("dialog")
    expect(sheet).to_contain_text("W A S D")
    assert button(page, "STOP").evaluate(IS_ON_TOP)
    page.keyboard.press("Escape")
    expect(sheet).to_be_hidden()
    expect(stick).to_be_focused()
    page.keyboard.press("?")
    page.keyboard.press(" ")
    mode(page, "stopped")
    page.keyboard.press("Escape")
    expect(sheet).to_be_hidden()


def test_the_name_that_an_operator_types_is_kept_and_shown_to_others(page: Page) -> None:
    button(page, "Your name").click(timeout=PATIENCE_MS)
    page.get_by_label("Your name").last.fill("Анна Müller")
    page.keyboard.press("Enter")
    name = page.get_by_role("banner").get_by_text("Анна Müller")
    expect(name.first).to_be_visible(timeout=PATIENCE_MS)
    page.reload()
    mode(page, "disarmed")
    expect(name.first).to_be_visible(timeout=PATIENCE_MS)
    browser = page.context.browser
    assert browser is not None
    other = browser.new_page()
    other.goto(page.url)
    until_linked(other)
    page.bring_to_front()
    until_linked(page)
    tab_to(page, button(page, "Take control"))
    page.keyboard.press("Enter")
    driven = other.get_by_role("banner").get_by_text("Анна Müller drives")
    expect(driven).to_be_visible(timeout=PATIENCE_MS)
    other.close()
