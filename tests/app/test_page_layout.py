"""STOP stays in place and on top, and no elements overlap, for all window sizes and states."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser

from tests.app.legibility import SMALL
from tests.app.overlaps import FINE_PRINT, OVERLAPS, STILL, STOP
from tests.app.page_states import (
    FLEET,
    REFUSED,
    STATES,
    TABS,
    WINDOWS,
    fold_panel,
    open_tab,
)
from tests.support.browser import FLAGS_WITHOUT_SCENE
from tests.support.page_stage import PageStage, page_stage, route, state

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

LAYERS = ".shade, .app > .panel, .items"
"""Overlays that a user opens and closes."""
POINTER_PX, FINGER_PX = 24, 44


class Look:
    """Collects layout errors of the page by state."""

    def __init__(self, stage: PageStage, *, touch: bool) -> None:
        self.stage = stage
        self.wrong: dict[str, list[str]] = {}
        self.places: dict[tuple[float, ...], list[str]] = {}
        self._least_px = FINGER_PX if touch else POINTER_PX

    def at_stop(self, name: str) -> None:
        """Check STOP alone; open overlays may cover other elements."""
        stop = self.stage.page.evaluate(STOP)
        self.places.setdefault(tuple(stop["box"]), []).append(name)
        found = [f"on STOP: {each}" for each in stop["covers"]]
        self._note(name, found + ([] if stop["isWhole"] else ["STOP leaves the window"]))

    def at_print(self, name: str) -> None:
        """Check STOP, and that texts are large enough; other elements may be scrolled away."""
        self.at_stop(name)
        self._note(name, self.stage.page.evaluate(FINE_PRINT))

    def at_all(self, name: str) -> None:
        """Check STOP and every other readable or clickable element."""
        self.at_print(name)
        page = self.stage.page
        self._note(name, page.evaluate(OVERLAPS, LAYERS))
        self._note(name, page.evaluate(SMALL, self._least_px))

    def _note(self, name: str, found: list[str]) -> None:
        for each in found:
            self.wrong.setdefault(each, []).append(name)


@pytest.mark.parametrize(
    ("size", "touch"),
    WINDOWS,
    ids=[f"{width}x{height}{' touch' * touch}" for (width, height), touch in WINDOWS],
)
def test_stop_never_moves_and_nothing_overlaps_is_cut_or_small(
    browser: Browser, size: tuple[int, int], *, touch: bool
) -> None:
    with page_stage(browser, recordings=True, touch=touch, size=size) as stage:
        stage.page.emulate_media(reduced_motion="reduce")
        stage.page.add_style_tag(content=STILL)
        look = Look(stage, touch=touch)
        for name, shown in STATES.items():
            stage.show(shown)
            look.at_all(name)
        stage.say(REFUSED)
        look.at_all("a notice")
        stage.show(STATES["ready"])
        stage.choose("tsd")  # Clears the notice.
        opened = [name for name in TABS if open_tab(stage, name)]
        for name in opened:
            open_tab(stage, name)
            stage.page.locator(".panel .body > *").first.wait_for()
            look.at_all(f"tab {name}")
        fold_panel(stage)
        look.at_all("folded")
        show_what_is_opened(stage, look)
    assert len(opened) >= len(TABS) - 1  # A phone in portrait has no room for Student.
    assert len(look.places) == 1, look.places
    assert look.wrong == {}


def show_what_is_opened(stage: PageStage, look: Look) -> None:
    """Check STOP under the dialogs, the map and the page of all robots."""
    stage.page.keyboard.press("n")
    look.at_stop("map")
    stage.page.keyboard.press("n")
    stage.page.keyboard.press("?")
    look.at_stop("keys and settings")
    stage.page.keyboard.press("?")
    stage.show(state("driving", lease={"holder": "bob"}))
    if stage.page.get_by_role("button", name="Take over").is_visible():
        stage.page.get_by_role("button", name="Take over").click()
        look.at_stop("takes over")
        stage.page.keyboard.press("Escape")
    stage.show(state("ready", you=True, route=route("planned")))
    stage.page.keyboard.press(" ")
    stage.page.get_by_role("alert").filter(has_text="not confirmed").wait_for()
    look.at_all("a stop that is not confirmed")
    stage.page.get_by_role("button", name="Acknowledge").click()
    stage.page.evaluate("location.hash = '#fleet'")
    stage.page.get_by_role("button", name="STOP ALL").wait_for()
    stage.say(FLEET)
    stage.page.get_by_role("img", name="Floor").wait_for()
    look.at_print("all robots")
    stage.page.evaluate("location.hash = ''")


def test_the_bar_has_room_for_several_robots_with_long_names(browser: Browser) -> None:
    names = ["robot-with-a-name-of-31-letters", "tsd", "omni4"]
    wrong: dict[int, list[str]] = {}
    with page_stage(browser) as stage:
        stage.page.add_style_tag(content=STILL)
        stage.choose(*names)
        for width in (320, 359, 399, 600, 720, 768, 800, 900, 1023, 1024, 1099, 1100, 1280):
            stage.resize(width, 720)
            for shown in (STATES["driving"], STATES["another drives"]):
                stage.show(shown)
                found = stage.page.evaluate(OVERLAPS, LAYERS)
                wrong.setdefault(width, []).extend(each for each in found if "cut off" in each)
    assert {width: found for width, found in wrong.items() if found} == {}
