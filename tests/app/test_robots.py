"""Every robot that comes with the program, driven in a real browser, all in one page."""

from __future__ import annotations

import re
from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.app.browser import (
    FLAGS,
    PATIENCE_MS,
    QUICK,
    centre,
    executable,
    mode,
    press,
    take_control_and_arm,
)
from tests.app.conftest import Program
from tsd_twin import robots

pytestmark = pytest.mark.system

ROBOTS = robots.names()
TABS = {"singularity": "Gimbals", "omni": "Wheels", "sphere": "Sphere"}


@pytest.fixture(scope="module")
def demo() -> Generator[str]:
    """Start all robots and their dashboard; return its address."""
    flags = [flag for name in ROBOTS for flag in ("--robot", name)]
    program = Program(
        ["tsd_demo", "--no-browser", "--until-eof", "--port", "0", "--bus-port", "0", *flags]
    )
    try:
        yield re.findall(r"http://\S+", program.ready())[0]
    finally:
        program.clean_up()


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=executable(), args=list(FLAGS))
        yield started
        started.close()


def opened(browser: Browser, address: str, errors: list[str], *, drawn: bool) -> Page:
    """Open the page; not `drawn` is without the scene, which costs a test machine most."""
    page = browser.new_page(viewport={"width": 900, "height": 500})
    page.add_init_script("localStorage.setItem('tsd.hints', 'seen')")
    page.on("pageerror", lambda error: errors.append(str(error)))
    if not drawn:
        page.route_web_socket(re.compile("/viser/"), lambda socket: socket.close())
    page.goto(address + QUICK)
    return page


@pytest.fixture(scope="module")
def page(browser: Browser, demo: str) -> Generator[Page]:
    errors: list[str] = []
    page = opened(browser, demo, errors, drawn=False)
    yield page
    page.close()
    assert errors == []


def choose(page: Page, name: str) -> None:
    """Turn the page to a robot by the menu in the bar."""
    page.locator("#tsd-overlay select").select_option(name, timeout=PATIENCE_MS)
    expect(page).to_have_title(re.compile(re.escape(robots.load(name).title)), timeout=PATIENCE_MS)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_driven(page: Page, name: str) -> None:
    """Chosen, armed, pushed with the stick; it moves, and rests when the stick is let go."""
    choose(page, name)
    take_control_and_arm(page)
    x, y, half = centre(page, "region", "Drive stick")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 0.8 * half)
    speed = page.get_by_role("status", name="Speed")
    expect(speed).to_contain_text(re.compile(r"0\.[1-9]|[1-9]\.\d"), timeout=PATIENCE_MS)
    page.mouse.up()
    mode(page, "ready")
    expect(speed).not_to_contain_text(re.compile(r"[1-9]"), timeout=PATIENCE_MS)
    press(page, "Disarm")
    mode(page, "disarmed")


def test_the_panel_of_each_robot_has_what_it_has(browser: Browser, demo: str) -> None:
    """All in one scene; no gimbals where there are none, and sliders by the names of its twist."""
    errors: list[str] = []
    page = opened(browser, demo, errors, drawn=True)
    for name in ROBOTS:
        choose(page, name)
        kind = next(kind for kind, of in robots.KINDS.items() if isinstance(robots.load(name), of))
        expect(page.get_by_role("tab", name=TABS[kind])).to_be_visible(timeout=PATIENCE_MS)
        for other in set(TABS.values()) - {TABS[kind]}:
            expect(page.get_by_role("tab", name=other)).to_have_count(0)
        first = "wx (rad/s)" if kind == "sphere" else "vx (m/s)"
        expect(page.get_by_text(first, exact=True)).to_be_visible(timeout=PATIENCE_MS)
    page.close()
    assert errors == []
