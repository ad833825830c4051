"""Drive every built-in robot in a real browser."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.browser import (
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    centre,
    click_through,
    get_ready,
    mode,
    press_linked,
    take_control_and_arm,
)
from tests.support.programs import Program
from tests.support.withheld import budget
from tsd_twin import robots

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

ROBOTS = robots.robot_names()
MOVING = re.compile(r"0\.[1-9]|[1-9]\.\d")
_PRESSES = 20


@contextlib.contextmanager
def demo(*names: str) -> Generator[str]:
    """Start robots and their dashboard; yield its address."""
    flags = [flag for name in names for flag in ("--robot", name)]
    program = Program(
        [
            "tsd_demo",
            "--no-record",
            "--no-browser",
            "--until-eof",
            "--port",
            "0",
            "--bus-port",
            "0",
            *flags,
        ]
    )
    try:
        yield re.findall(r"http://\S+", program.ready())[0]
    finally:
        program.clean_up()


@contextlib.contextmanager
def opened(browser: Browser, address: str, *, drawn: bool) -> Generator[Page]:
    """Open the page in a browser with or without the scene."""
    errors: list[str] = []
    page = browser.new_page(viewport={"width": 960, "height": 640})
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    yield page
    page.close()
    assert [error for error in errors if drawn or "WebGL" not in error] == []


def choose(page: Page, name: str) -> None:
    """Select a robot in the menu bar."""
    if name not in page.get_by_role("button", name="Choose another").inner_text():
        page.get_by_role("button", name="Choose another").click(timeout=PATIENCE_MS)
        page.get_by_role("menuitemradio", name=re.compile(f"^{name}")).click(timeout=PATIENCE_MS)
    expect(page).to_have_title(
        re.compile(re.escape(robots.load_robot(name).title)), timeout=PATIENCE_MS
    )


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, ids=["no scene"])
@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_driven(browser: Browser, name: str) -> None:
    """Armed and pushed with the stick, the robot moves; it stops on release."""
    with demo(name) as address, opened(browser, address, drawn=False) as page:
        drive(page, name)


def drive(page: Page, name: str) -> None:
    """Push the stick, then release it."""
    mode(page, "disarmed")
    spins = isinstance(robots.load_robot(name), robots.SingularityDescription)
    what = "Arming spins the wheels up" if spins else "Arming switches the motors on"
    press_linked(page, "Take control", page.get_by_text(what))
    get_ready(page)
    speed = page.locator(".hero .n")
    x, y, half = centre(page, "application", "Stick")
    for _ in budget.tries("push the stick", _PRESSES):
        # A starved robot correctly enters a fault.
        click_through(page, "Take control", "Hold to reset", "Arm")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - 0.8 * half)
        try:
            expect(speed).to_contain_text(MOVING, timeout=3000)
            break
        except AssertionError:
            # A slow page counts the stick as released and asks for another push.
            page.mouse.up()
    else:
        pytest.fail(f"{name} was not moved")
    page.mouse.up()
    mode(page, "ready")
    expect(speed).not_to_contain_text(re.compile(r"[1-9]"), timeout=PATIENCE_MS)


def test_the_panel_of_each_robot_has_what_it_has(browser: Browser) -> None:
    """Panels show only joints that a robot has, and sliders named after its twist."""
    shown = {"omni4": ("Wheel 4", "Forward"), "atlas": ("Sphere", "Roll forward")}
    with demo(*shown) as address, opened(browser, address, drawn=True) as page:
        menu = page.get_by_role("button", name="Robot: omni4. Choose another")
        expect(menu).to_be_visible(timeout=PATIENCE_MS)  # The first robot by name.
        for name, (heading, slider) in shown.items():
            choose(page, name)
            panel = page.get_by_role("tabpanel")
            page.get_by_role("tab", name="Drive").click(timeout=PATIENCE_MS)
            expect(panel.get_by_role("slider", name=slider)).to_be_visible(timeout=PATIENCE_MS)
            page.get_by_role("tab", name="Modules").click(timeout=PATIENCE_MS)
            headings = panel.get_by_role("heading").or_(panel.get_by_role("rowheader"))
            expect(headings.filter(has_text=heading)).to_be_visible(timeout=PATIENCE_MS)
            for other in {"Module 1", "Wheel 4", "Sphere"} - {heading}:
                expect(headings.filter(has_text=other)).to_have_count(0)
        bring_up_by_key(page)


def bring_up_by_key(page: Page) -> None:
    """Bring the sphere's front mark up by keyboard instead of a click."""
    front = page.get_by_role("group", name="Bring a mark to the top").get_by_role(
        "button", name="Front"
    )
    expect(front).to_have_attribute("aria-disabled", "true", timeout=PATIENCE_MS)
    take_control_and_arm(page)
    mark = page.locator(".mark.front")
    expect(mark).to_have_attribute("cy", re.compile(r"^-3[56]"))  # Seen from above, in front.
    for _ in budget.tries("bring a mark up", _PRESSES):
        front.press("Enter", timeout=PATIENCE_MS)
        with contextlib.suppress(AssertionError):
            expect(mark).to_have_attribute("cy", re.compile(r"^-?[01](\.|$)"), timeout=8000)
            break
        get_ready(page)  # A slow page counts the key as released and asks for another press.
    expect(mark).to_have_attribute("cy", re.compile(r"^-?[01](\.|$)"))
    mode(page, "ready")
