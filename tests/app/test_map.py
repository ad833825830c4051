"""The map in a browser: a click asks for the same as a click in the scene, under the same rules."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Generator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.app.conftest import Program
from tests.support.browser import (
    FLAGS,
    FLAGS_WITHOUT_SCENE,
    PATIENCE_MS,
    QUICK,
    mode,
    press_now,
    press_until,
)
from tests.support.page_stage import PageStage, page_stage, route, state

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(180)]

ROBOTS = [
    {"id": "tsd", "pose": [1.24, -0.31, 0.73], "reach_m": 0.25, "stale": False},
    {"id": "atlas", "pose": [0.0, 1.0, 0.0], "reach_m": 0.25, "stale": True},
]
MAP: dict[str, Any] = {"map": {"robots": ROBOTS, "envelope": None}}
SPAN_M = 4.0
CLICKS = 6
PATH = re.compile(r"\d m, \d")
MIDDLE = (0.24, 0.0)
"""Of the map: it moves until the robot is within a metre of its middle."""


@pytest.fixture
def stage(browser: Browser) -> Generator[PageStage]:
    with page_stage(browser) as opened:
        opened.choose("tsd", "atlas")
        yield opened


def points_of(stage: PageStage) -> list[list[float]]:
    """Points of the one path that was asked for."""
    (plan,) = stage.sent("plan")
    assert (plan["on"], plan["level"]) == ("floor", 50)
    return [plan["kind"], *plan["points"]]


@pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, ids=["no scene"])
def test_a_click_on_the_map_asks_as_one_in_the_scene_does(stage: PageStage) -> None:
    page = stage.page
    stage.show(state("ready", **MAP))
    stage.sent()
    page.get_by_role("button", name="Map", exact=True).click()
    assert stage.sent("map") == [{"t": "map", "on": True}]
    canvas = page.get_by_role("img", name="Map")
    box = canvas.bounding_box()
    assert box is not None
    scale = min(box["width"], box["height"]) / SPAN_M
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def at(x: float, y: float) -> tuple[float, float]:
        return middle[0] - (y - MIDDLE[1]) * scale, middle[1] - (x - MIDDLE[0]) * scale

    # Who is not in control plans nothing, and is told why.
    page.mouse.click(*at(1.0, 0.5))
    notices = page.locator("#tsd-overlay .messages")
    expect(notices).to_contain_text("Take control first.")
    assert stage.sent("plan", "lease", "drive", "follow_plan") == []
    stage.show(state("ready", you=True, **MAP))
    page.mouse.click(*at(1.0, 0.5))
    kind, point = points_of(stage)
    assert kind == "to"
    assert point == pytest.approx([1.0, 0.5], abs=1.0 / scale)
    # A drag sets the heading by a second point.
    page.mouse.move(*at(0.0, 0.0))
    page.mouse.down()
    page.mouse.move(*at(0.3, 0.3), steps=4)
    page.mouse.up()
    kind, start, end = points_of(stage)
    assert kind == "to"
    assert [*start, *end] == pytest.approx([0.0, 0.0, 0.3, 0.3], abs=1.0 / scale)
    # While the path is held, it is not changed by a click, as in the scene.
    stage.show(state("ready", you=True, route=route("planned"), **MAP))
    for _ in range(5):
        page.keyboard.down("g")
        page.wait_for_function("sent.some(({t}) => t === 'follow_plan')")
        page.mouse.click(*at(1.0, 0.5))
        has_stalled = page.evaluate("sent.some(({t}) => t === 'release')")
        page.keyboard.up("g")
        page.wait_for_function("sent.some(({t}) => t === 'release')")
        changed = stage.sent("plan", "clear_plan")
        if not has_stalled:  # A page that stalls on a busy machine lets go by itself.
            break
    assert changed == []
    # A line, when one is to be drawn.
    page.get_by_role("button", name="Draw", exact=True).click()
    page.mouse.move(*at(0.0, 0.0))
    page.mouse.down()
    for x in (0.2, 0.4, 0.6):
        page.mouse.move(*at(x, 0.3))
    page.mouse.up()
    kind, *line = points_of(stage)
    assert kind == "draw"
    assert line[-1] == pytest.approx([0.6, 0.3], abs=1.0 / scale)
    assert len(line) == 4
    # Another scale, another place for the same pixel.
    page.get_by_role("button", name="Go to", exact=True).click()
    page.get_by_role("button", name="Zoom out").click()
    page.mouse.click(*at(1.0, 0.5))
    _, point = points_of(stage)
    far = [MIDDLE[0] + 2.0 * (1.0 - MIDDLE[0]), 2.0 * 0.5]
    assert point == pytest.approx(far, abs=2.0 / scale)
    page.keyboard.press("m")
    expect(canvas).to_be_hidden()
    assert stage.sent("map") == [{"t": "map", "on": False}]


@pytest.mark.parametrize("browser", [FLAGS], indirect=True, ids=["scene"])
def test_map_camera_presets_and_the_window_of_the_plots(
    browser: Browser, start: Callable[..., Program]
) -> None:
    """On the real page, in one go: starting it takes most of the time."""
    demo = ("--no-browser", "--no-record", "--until-eof", "--port", "0", "--bus-port", "0")
    address = re.findall(r"http://\S+", start("tsd_demo", *demo).ready())[0]
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    context.add_init_script("localStorage.setItem('tsd.hints', 'seen')")
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address + QUICK)
    mode(page, "disarmed")
    press_until(page, "Take control", page.get_by_role("button", name="Release control"))
    page.keyboard.press("m")
    path = page.get_by_role("status", name="Path")
    for _ in range(CLICKS):
        # A page that stalls as it loads plans nothing, since the robot seems silent, or is not in
        # control any more.
        press_now(page, "Take control")
        page.get_by_role("img", name="Map").click(timeout=PATIENCE_MS, position={"x": 60, "y": 40})
        with contextlib.suppress(AssertionError):
            expect(path).to_contain_text(PATH, timeout=PATIENCE_MS / CLICKS)
            break
    expect(path).to_contain_text(PATH)
    # viser's notice of a missing graphics card does not lie on map and robot.
    notice = page.locator(".mantine-Notification-root:visible").filter(has_text="WebGL")
    expect(notice).to_have_count(0, timeout=PATIENCE_MS)
    page.keyboard.press("3")
    tab(page, "View").click(timeout=PATIENCE_MS)
    operator = page.get_by_role("button", name="Operator", exact=True)
    operator.click(timeout=PATIENCE_MS)
    region = page.get_by_role("checkbox", name="region of the pose")
    expect(region).not_to_be_checked(timeout=PATIENCE_MS)
    expect(tab(page, "Plots")).to_be_hidden()
    # All of it is there again after a reload.
    page.reload()
    expect(page.get_by_role("img", name="Map")).to_be_visible(timeout=PATIENCE_MS)
    tab(page, "View").click(timeout=PATIENCE_MS)
    expect(operator).to_have_attribute("aria-pressed", "true", timeout=PATIENCE_MS)
    expect(region).not_to_be_checked(timeout=PATIENCE_MS)
    expect(tab(page, "Plots")).to_be_hidden()
    assert page.evaluate("JSON.parse(localStorage.getItem('tsd.view')).camera") == "chase"
    page.get_by_role("button", name="Debug", exact=True).click()
    expect(region).to_be_checked(timeout=PATIENCE_MS)
    tab(page, "Plots").click(timeout=PATIENCE_MS)
    with page.expect_popup(timeout=PATIENCE_MS) as opened:
        page.get_by_role("button", name="Window", exact=True).click(timeout=PATIENCE_MS)
    plots = opened.value
    plots.on("pageerror", lambda error: errors.append(str(error)))
    group = plots.get_by_role("group", name="Plots", exact=True)
    expect(group.locator(".u-over").first).to_be_visible(timeout=PATIENCE_MS)
    # It shows the same session, and only stops.
    expect(plots.get_by_role("button", name="Window", exact=True)).to_have_count(0)
    mode(page, "disarmed")
    plots.keyboard.press("Space")
    mode(page, "stopped")
    context.close()
    assert errors == []


def tab(page: Page, name: str) -> Any:
    return page.get_by_role("tab", name=name, exact=True)
