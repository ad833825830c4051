"""The robot driven by keyboard alone, and the sheet of keys and colours: in a real browser."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Generator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.app.conftest import Program
from tests.support.browser import (
    FEW_FRAMES,
    PATIENCE_MS,
    WATCH_STALLS,
    give_back,
    mode,
    trials,
)

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

MOVING = re.compile(r"v\s+(0\.(0[5-9]|[1-9])|[1-9])")
"""A page that was slow when it took control is granted little speed, as over a far link."""
AT_REST = re.compile(r"v\s+0\.00\s")
IS_FOCUSED = "(node) => node.getRootNode().activeElement === node"
IS_ON_TOP = """(node) => {
  const { left, top, width, height } = node.getBoundingClientRect();
  return node.contains(node.getRootNode().elementFromPoint(left + width / 2, top + height / 2));
}"""
_TABS = 80
_TRIES = 10


def tab_to(page: Page, target: Locator, key: str = "Tab", patience_ms: float = PATIENCE_MS) -> None:
    """Go to a control with the Tab key alone, in the other direction when it is not ahead."""
    expect(target).to_be_visible(timeout=patience_ms)
    for pressed in (key, "Shift+Tab" if key == "Tab" else "Tab"):
        for _ in range(_TABS):
            if target.evaluate(IS_FOCUSED):
                return
            page.keyboard.press(pressed)
    raise AssertionError(f"Tab does not reach {target}")


def next_step(page: Page, name: str) -> None:
    """Check that the list of first steps has ticked all before this one."""
    steps = page.get_by_role("region", name="First steps")
    expect(steps.locator("[aria-current=step]")).to_have_text(name, timeout=PATIENCE_MS)


def enter(
    page: Page, role: str, name: str, key: str = "Tab", patience_ms: float = PATIENCE_MS
) -> None:
    """Go to a control and press Enter, once it can be used."""
    target = page.get_by_role(role, name=name, exact=True)
    tab_to(page, target, key, patience_ms)
    expect(target).not_to_have_attribute("aria-disabled", "true", timeout=patience_ms)
    page.keyboard.press("Enter")


def take_control(page: Page) -> None:
    """Take control, again if the page stalls just then: a page that is silent loses it."""
    release = page.get_by_role("button", name="Release control")
    for _ in range(_TRIES):
        enter(page, "button", "Take control")
        try:
            expect(release).to_be_visible(timeout=PATIENCE_MS / _TRIES)
        except AssertionError:
            continue
        return
    raise AssertionError("Enter on Take control does not take it")


def release(page: Page) -> None:
    """Release control; take it first when the page has stalled and lost it."""
    free = page.get_by_role("button", name="Take control")
    for _ in range(_TRIES):
        if free.is_visible():
            take_control(page)
        with contextlib.suppress(AssertionError):
            enter(page, "button", "Release control", patience_ms=PATIENCE_MS / _TRIES)
            break
    expect(free).to_be_visible(timeout=PATIENCE_MS)


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Program], browser: Browser) -> Page:
    """One demo and one page for all tests; the first one is on its first visit."""
    ports = ("--port", "0", "--bus-port", "0")
    line = start_shared("tsd_demo", "--no-browser", "--no-record", "--until-eof", *ports)
    url = re.findall(r"http://\S+", line.ready())[0]
    page = browser.new_page(viewport={"width": 960, "height": 640})
    page.add_init_script(FEW_FRAMES)
    page.add_init_script(WATCH_STALLS)
    page.goto(f"{url}?fixedDpr=0.1")
    mode(page, "disarmed")
    return page


@pytest.fixture
def page(shared: Page) -> Generator[Page]:
    yield shared
    give_back(shared)


def recover(page: Page, patience_ms: float = PATIENCE_MS) -> None:
    """Take control, reset and arm again, whatever of it is lost.

    A page that gets no time is silent, and loses control; a robot that gets none is in a fault.
    """
    said = page.get_by_role("status", name="Mode")
    if page.get_by_role("button", name="Take control").is_visible():
        take_control(page)
    if "FAULT" in said.inner_text():
        reset(page)
    if "DISARMED" in said.inner_text():
        enter(page, "button", "Arm", "Shift+Tab", patience_ms)


def take_control_and_arm(page: Page) -> None:
    """Do both, again if the page stalls in between: a slow machine draws the scene just then."""
    said = page.get_by_role("status", name="Mode")
    for _ in range(_TRIES):
        with contextlib.suppress(AssertionError):
            recover(page, PATIENCE_MS / _TRIES)
            expect(said).to_contain_text("ready", ignore_case=True, timeout=PATIENCE_MS / _TRIES)
            return
    raise AssertionError(f"not armed: {said.inner_text()}")


def get_ready(page: Page) -> None:
    """Recover what is lost, and wait until the robot is at rest and can be driven."""
    take_control_and_arm(page)
    speed = page.get_by_role("status", name="Speed", exact=True)
    expect(speed).to_contain_text(AT_REST, timeout=PATIENCE_MS)


def moves(page: Page) -> bool:
    speed = page.get_by_role("status", name="Speed", exact=True)
    try:
        expect(speed).to_contain_text(MOVING, timeout=5000)
    except AssertionError:
        return False  # The page has stalled, and so has let go; it has to be told again.
    return True


def hold_until_it_moves(page: Page, key: str, focused: Locator | None = None) -> None:
    for _ in range(_TRIES):
        get_ready(page)
        if focused is not None:
            tab_to(page, focused, "Shift+Tab")
        page.keyboard.down(key)
        if moves(page):
            return
        page.keyboard.up(key)
    raise AssertionError(f"{key} does not move the robot")


def choose_drive(page: Page) -> None:
    """Choose the mode of the sliders in its list."""
    chosen = page.locator("input").and_(page.get_by_label("Mode", exact=True))
    tab_to(page, chosen)
    for _ in range(_TRIES):
        if chosen.input_value() == "drive":
            return
        page.keyboard.press("ArrowDown")
        page.wait_for_timeout(200)  # The list opens.
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        page.wait_for_timeout(200)
    expect(chosen).to_have_value("drive")


def drive_with_a_slider_that_keeps_its_value(page: Page) -> None:
    choose_drive(page)
    box = page.get_by_role("checkbox", name="Keep value")
    tab_to(page, box)
    page.keyboard.press("Enter")
    expect(box).to_be_checked(timeout=PATIENCE_MS)
    slider = page.get_by_role("slider", name="Forward (m/s)")
    tab_to(page, slider, "Shift+Tab")
    for _ in range(_TRIES):
        get_ready(page)
        tab_to(page, slider)
        for _ in range(15):
            page.keyboard.press("ArrowRight")
        if moves(page):
            break
    else:
        raise AssertionError("the slider does not move the robot")
    enter(page, "button", "Zero")
    speed = page.get_by_role("status", name="Speed", exact=True)
    expect(speed).to_contain_text(AT_REST, timeout=PATIENCE_MS)


def go_to_a_point(page: Page) -> None:
    """Plan a path by numbers, and hold G until the robot moves along it."""
    form = page.get_by_role("form", name="Go to")
    path = page.get_by_role("status", name="Path")
    for goal_m in range(3, 3 + _TRIES):
        get_ready(page)
        tab_to(page, form.get_by_label("x (m)"))
        page.keyboard.press("Control+a")
        page.keyboard.type(str(goal_m))
        tab_to(page, page.get_by_role("button", name="Plan", exact=True))
        page.keyboard.press("Enter")
        try:
            expect(path).to_contain_text(re.compile(r"\d m, "), timeout=5000)
        except AssertionError:
            continue
        page.keyboard.down("g")
        if moves(page):
            return
        page.keyboard.up("g")
    raise AssertionError("G does not move the robot")


def reset(page: Page) -> None:
    """Hold Enter on Reset stop, and go on holding it, as a hand does: nothing is armed by that."""
    button = page.get_by_role("button", name="Reset stop")
    arm = page.get_by_role("button", name="Arm", exact=True)
    said = page.get_by_role("status", name="Mode")
    for _ in range(_TRIES):
        if page.get_by_role("button", name="Take control").is_visible():
            take_control(page)  # Lost, as above; without it nothing can be reset.
        tab_to(page, button, "Shift+Tab")
        page.keyboard.down("Enter")
        try:
            expect(said).to_contain_text("disarmed", ignore_case=True, timeout=3000)
            break
        except AssertionError:
            page.keyboard.up("Enter")
    mode(page, "disarmed")
    for _ in range(5):
        page.keyboard.down("Enter")  # Repeats itself.
    expect(arm).not_to_be_focused()
    page.keyboard.up("Enter")
    expect(arm).to_be_focused()
    page.wait_for_timeout(500)
    mode(page, "disarmed")


def test_a_robot_is_driven_by_keyboard_alone(page: Page) -> None:
    """Take control, arm, drive, keep a value, go to a point, stop, reset and release.

    The list of first steps ticks itself meanwhile, and does not come back.
    """
    page.keyboard.press("Tab")
    expect(page.get_by_role("button", name="STOP", exact=True)).to_be_focused()
    next_step(page, "Take control")
    take_control(page)
    next_step(page, "Arm")
    take_control_and_arm(page)
    next_step(page, "Drive")
    hold_until_it_moves(page, "w")
    page.keyboard.up("w")
    next_step(page, "Stop")
    hold_until_it_moves(page, "ArrowDown", page.get_by_role("region", name="Drive stick"))
    page.keyboard.up("ArrowDown")
    drive_with_a_slider_that_keeps_its_value(page)
    go_to_a_point(page)
    box = page.get_by_role("checkbox", name="Keep value")
    tab_to(page, box, "Shift+Tab")
    take_control_and_arm(page)
    tab_to(page, box)
    page.keyboard.press(" ")
    page.keyboard.up("g")
    expect(page.get_by_role("log", name="Messages")).to_contain_text("Enter ticks a box")
    mode(page, "stopped")
    expect(box).to_be_checked()
    expect(page.get_by_text("You pressed STOP.")).to_be_visible()
    next_step(page, "Reset")
    reset(page)
    expect(page.get_by_role("region", name="First steps")).to_be_hidden(timeout=PATIENCE_MS)
    assert page.evaluate("localStorage.getItem('tsd.hints')") == "seen"
    release(page)


def test_a_key_opens_the_sheet_which_covers_no_control_and_gives_the_focus_back(
    page: Page,
) -> None:
    stick = page.get_by_role("region", name="Drive stick")
    stick.focus()
    page.keyboard.press("?")
    sheet = page.get_by_role("dialog", name="Keys and colours")
    expect(sheet).to_be_visible()
    expect(sheet.get_by_role("button", name="Close")).to_be_focused()
    stop = page.get_by_role("button", name="STOP", exact=True)
    assert stop.evaluate(IS_ON_TOP)
    page.keyboard.press("Escape")
    expect(sheet).to_be_hidden()
    expect(stick).to_be_focused()
    page.keyboard.press("?")
    page.keyboard.press(" ")
    mode(page, "stopped")


def test_the_name_that_an_operator_types_is_kept_and_shown_to_others(page: Page) -> None:
    page.get_by_role("tab", name="View").click(timeout=PATIENCE_MS)
    field = page.get_by_label("Your name")
    field.fill("Anna Müller")
    field.press("Enter")
    expect(field).to_have_value("anna-muller")
    page.reload()
    mode(page, "disarmed")
    browser = page.context.browser
    assert browser is not None
    other = browser.new_page()
    other.goto(page.url)
    mode(other, "disarmed")
    for trial in trials(page):
        with trial:
            if page.get_by_role("button", name="Take control").is_visible():
                take_control(page)
            for shown, who in ((page, "you drive"), (other, "anna-muller drives")):
                expect(shown.get_by_text(who, exact=True)).to_be_visible(timeout=PATIENCE_MS / 4)
    other.close()
