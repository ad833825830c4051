"""The page shows true values in each state; `web/tests` covers the details."""

from __future__ import annotations

from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, expect

from tests.support.browser import FLAGS_WITHOUT_SCENE
from tests.support.page_stage import COLOURS, PageStage, page_stage, state

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]


@pytest.fixture
def stage(browser: Browser) -> Generator[PageStage]:
    with page_stage(browser) as opened:
        yield opened


def test_without_a_signal_nothing_looks_live(stage: PageStage) -> None:
    deck = stage.page.get_by_role("region", name="Controls")
    live = stage.page.get_by_role("contentinfo").get_by_role("status")
    mode = stage.page.get_by_role("status", name="Mode")
    stage.show(state("ready", you=True))
    expect(deck).to_contain_text("12.34")
    expect(live.first).to_have_text("Live")
    expect(mode).to_have_text("Ready")
    stage.show(None)
    expect(deck).not_to_contain_text("12.34")
    expect(deck).to_contain_text("Reconnecting")
    expect(live.first).not_to_have_text("Live")
    expect(mode).to_have_text("No signal")
    expect(stage.page.get_by_role("application")).to_have_attribute("aria-disabled", "true")
    stage.show(state("ready", you=True))
    expect(deck).to_contain_text("12.34")
    expect(mode).to_have_text("Ready")


def test_a_page_that_is_loaded_again_in_motion_says_why_the_robot_stopped(stage: PageStage) -> None:
    scene = stage.page.get_by_role("main")
    stage.show(state("driving", you=True))
    expect(stage.page.get_by_role("status", name="Mode")).to_have_text("Driving")
    stage.page.reload()
    stage.choose("tsd")
    stage.show(state("ready"))
    expect(scene).to_contain_text("so the robot stopped")
    stage.page.reload()
    stage.choose("tsd")
    stage.show(state("ready"))
    expect(stage.page.get_by_role("status", name="Mode")).to_have_text("Ready")
    expect(scene).not_to_contain_text("so the robot stopped")


def test_the_bar_names_the_robot_that_is_shown_in_its_colour(stage: PageStage) -> None:
    for shown, other, colour in (("tsd", "atlas", COLOURS[0]), ("atlas", "tsd", COLOURS[0])):
        stage.choose(shown, other)
        menu = stage.page.get_by_role("banner").get_by_role("button", name=f"Robot: {shown}")
        expect(menu).to_contain_text(shown)
        expect(menu.locator(".dot")).to_have_attribute("style", f"--c: {colour};")
