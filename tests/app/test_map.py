"""The map in a browser: a click plans the same path as a click in the scene."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.support.browser import (
    FLAGS,
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    mode,
    press_linked,
    until_linked,
)
from tests.support.page_stage import PageStage, page_stage, state
from tests.support.programs import Program

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(180)]

ROBOTS = [
    {"id": "tsd", "pose": [1.24, -0.31, 0.73], "reach_m": 0.25, "stale": False},
    {"id": "atlas", "pose": [0.0, 1.0, 0.0], "reach_m": 0.25, "stale": True},
]
MAP: dict[str, Any] = {"map": {"robots": ROBOTS, "envelope": None}}
SPAN_M = 4.0
PATH = re.compile(r"\d m, \d")
MIDDLE = (0.24, 0.0)
"""Centre of the map, which scrolls until the robot is within 1 m of it."""


@pytest.fixture
def stage(browser: Browser) -> Generator[PageStage]:
    with page_stage(browser) as opened:
        opened.choose("tsd", "atlas")
        yield opened


def picture(page: Page) -> Locator:
    return page.get_by_role("img", name="Map from above, x up")


def points_of(stage: PageStage) -> list[Any]:
    """Return kind and points of the only path requested."""
    (plan,) = stage.sent("plan")
    assert (plan["on"], plan["level"]) == ("floor", 50)
    return [plan["kind"], *plan["points"]]


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, ids=["no scene"])
def test_a_click_on_the_map_asks_as_one_in_the_scene_does(stage: PageStage) -> None:
    page = stage.page
    stage.show(state("ready", **MAP))
    page.get_by_role("button", name="Larger map").click()
    # The map follows the robot at its next redraw.
    page.wait_for_timeout(500)
    stage.sent()
    box = picture(page).bounding_box()
    assert box is not None
    scale = min(box["width"], box["height"]) / SPAN_M
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def at(x: float, y: float) -> tuple[float, float]:
        return middle[0] - (y - MIDDLE[1]) * scale, middle[1] - (x - MIDDLE[0]) * scale

    # Without control, a click plans no path and shows the reason.
    page.mouse.click(*at(1.0, 0.5))
    expect(page.locator(".notice")).to_have_text("Take control first.")
    assert stage.sent("plan", "lease", "drive", "follow_plan") == []
    stage.show(state("ready", you=True, **MAP))
    expect(page.get_by_role("button", name="Release control")).to_be_visible()
    page.mouse.click(*at(1.0, 0.5))
    kind, point = points_of(stage)
    assert kind == "to"
    assert point == pytest.approx([1.0, 0.5], abs=1.0 / scale)
    # In point mode, a drag sets the heading by a second point.
    expect(page.get_by_role("radio", name="Go to")).to_be_checked()
    page.mouse.move(*at(0.0, 0.0))
    page.mouse.down()
    page.mouse.move(*at(0.3, 0.3), steps=4)
    page.mouse.up()
    kind, start, end = points_of(stage)
    assert kind == "to"
    assert [*start, *end] == pytest.approx([0.0, 0.0, 0.3, 0.3], abs=1.0 / scale)
    # A line, when one is to be drawn.
    page.get_by_role("radio", name="Draw").click()
    page.mouse.move(*at(0.0, 0.0))
    page.mouse.down()
    for x in (0.2, 0.4, 0.6):
        page.mouse.move(*at(x, 0.3))
    page.mouse.up()
    kind, *line = points_of(stage)
    assert kind == "draw"
    assert line[-1] == pytest.approx([0.6, 0.3], abs=1.0 / scale)
    assert len(line) == 4
    # At another scale, the same pixel is another point.
    page.get_by_role("radio", name="Go to").click()
    page.get_by_role("button", name="Zoom out").click()
    page.mouse.click(*at(1.0, 0.5))
    _, point = points_of(stage)
    far = [MIDDLE[0] + 2.0 * (1.0 - MIDDLE[0]), 2.0 * 0.5]
    assert point == pytest.approx(far, abs=2.0 / scale)
    page.keyboard.press("n")
    expect(picture(page)).to_be_hidden()
    assert stage.sent("map") == [{"t": "map", "on": False}]
    page.keyboard.press("n")
    expect(picture(page)).to_be_visible()
    assert stage.sent("map") == [{"t": "map", "on": True}]


@pytest.mark.parametrize("browser", [FLAGS], indirect=True, ids=["scene"])
def test_a_real_robot_plans_to_a_click_and_the_view_is_kept_over_a_reload(
    browser: Browser, start: Callable[..., Program]
) -> None:
    """On the real page, in one go: starting it takes most of the time."""
    demo = ("--no-browser", "--no-record", "--until-eof", "--port", "0", "--bus-port", "0")
    address = re.findall(r"http://\S+", start("tsd_demo", *demo).ready())[0]
    page = browser.new_page(viewport={"width": 1000, "height": 640})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    mode(page, "disarmed")
    press_linked(page, "Take control", page.get_by_role("button", name="Release control"))
    until_linked(page)
    picture(page).click(timeout=PATIENCE_MS, position={"x": 60, "y": 40})
    path = page.get_by_role("status", name="Path")
    expect(path).to_contain_text(PATH, timeout=PATIENCE_MS)
    page.keyboard.press("3")
    page.keyboard.press("n")
    expect(picture(page)).to_be_hidden()
    tab(page, "View").click(timeout=PATIENCE_MS)
    trail = page.get_by_role("checkbox", name="Trail")
    expect(trail).to_be_checked(timeout=PATIENCE_MS)
    trail.click()
    page.reload()
    mode(page, "disarmed")
    expect(tab(page, "View")).to_have_attribute("aria-selected", "true")
    expect(trail).not_to_be_checked()
    expect(page.get_by_role("radio", name="Chase")).to_be_checked()
    expect(picture(page)).to_be_hidden()
    assert page.evaluate("JSON.parse(localStorage.getItem('tsd-view')).camera") == "chase"
    page.close()
    assert errors == []


def tab(page: Page, name: str) -> Locator:
    return page.get_by_role("tab", name=name, exact=True)
