"""The scene as rendered by Chromium."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, cast

import numpy as np
import pytest
import viser
from imageio.v3 import imread
from playwright.sync_api import Browser, Page, sync_playwright

from tests.support.browser import CHEAP_FLAGS, PATIENCE_MS, executable
from tests.support.scene_doubles import RobotFeed
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.client_view import ClientView
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.lie import Array

SIZE = (540, 450)
SCENE_ONLY = "body :not(canvas, :has(canvas)) { display: none !important }"
"""Same style as in the frame of the page."""

pytestmark = [pytest.mark.system, pytest.mark.busy]


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=executable(), args=list(CHEAP_FLAGS))
        yield started
        started.close()


class Desk:
    """A scene with browsers that show it."""

    def __init__(self, server: viser.ViserServer, browser: Browser) -> None:
        self.server = server
        self.scene = Scene(server)
        self.views = ClientViews(server, self.scene)
        self.feed = RobotFeed()
        self.scene.add(self.feed)
        self.feed.say(pose=np.zeros(3))  # The camera is placed once the pose is known.
        self.scene.draw()
        self.errors: list[str] = []
        self._browser = browser

    def open(self) -> tuple[Page, ClientView]:
        """Return a page that shows its robot, and its view."""
        before = self.server.get_clients().keys()
        width, height = SIZE
        page = self._browser.new_page(viewport={"width": width, "height": height})
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(f"http://127.0.0.1:{self.server.get_port()}/?fixedDpr=0.5")
        page.add_style_tag(content=SCENE_ONLY)
        until(page, lambda shown: orange(shown) > 20)
        (new,) = self.server.get_clients().keys() - before
        views = self.views.of_page(cast("Any", None))  # A browser without the gateway has no page.
        return page, next(each for each in views if each.client.client_id == new)


@pytest.fixture(scope="module")
def desk(browser: Browser) -> Generator[Desk]:
    with pytest.MonkeyPatch.context() as unlocked:
        # The browser loads viser's own page without the gateway, which would add the access key.
        unlocked.setattr(viser_compat, "has_access_key", lambda _request: True)
        server = viser_compat.start_server("test")
        made = Desk(server, browser)
        yield made
        for context in browser.contexts:
            context.close()
        server.stop()
    assert made.errors == []


@pytest.fixture(scope="module")
def opened(desk: Desk) -> tuple[Page, ClientView]:
    return desk.open()


@pytest.fixture
def page(opened: tuple[Page, ClientView]) -> Page:
    return opened[0]


@pytest.fixture
def view(opened: tuple[Page, ClientView]) -> ClientView:
    return opened[1]


def picture(page: Page) -> Array:
    """Return a screenshot of the scene, (height, width, 3), 0 to 255."""
    return np.asarray(imread(page.screenshot(timeout=PATIENCE_MS)), float)[..., :3]


def until(page: Page, seen: Callable[[Array], bool]) -> Array:
    """Return the first screenshot that meets a condition."""
    for _ in range(100):
        shown = picture(page)
        if seen(shown):
            return shown
        page.wait_for_timeout(100)
    raise AssertionError("it was never seen")


def magenta(shown: Array) -> int:
    """Number of pixels with much more red and blue than green."""
    red, green, blue = np.moveaxis(shown, -1, 0)
    return int(((red > 1.5 * green + 20) & (blue > 1.5 * green + 20)).sum())


def wheels(shown: Array) -> Array:
    """Rows and columns (n, 2) of wheel-coloured pixels."""
    red, green, blue = np.moveaxis(shown, -1, 0)
    return np.argwhere((red > 150) & (red > 1.4 * green) & (green > 1.2 * blue))


def orange(shown: Array) -> int:
    return len(wheels(shown))


def test_preview_is_seen_by_one_client_in_place_of_the_live_gimbals(
    desk: Desk, page: Page, view: ClientView
) -> None:
    other_page, _ = desk.open()
    live = picture(page)
    assert magenta(live) == 0
    view.show_preview(desk.feed.id, desk.feed.kinematics.inverse(np.array([0.0, 0.0, 3.0])))
    tried = until(page, lambda shown: magenta(shown) > 100)
    assert orange(tried) < 0.1 * orange(live)  # The live wheels are not behind them.
    assert magenta(picture(other_page)) == 0
    other_page.close()
    view.show_preview(desk.feed.id, None)
    # The preview may disappear a frame before the live robot returns.
    again = until(page, lambda shown: magenta(shown) == 0 and orange(shown) > 0.5 * orange(live))
    assert orange(again) == pytest.approx(orange(live), rel=0.05)


def test_a_camera_that_nobody_touches_follows_the_robot(desk: Desk, page: Page) -> None:
    """A robot that has driven 1 km appears in the same place of the picture as at the origin."""
    first = wheels(picture(page)).mean(axis=0)
    for x in np.linspace(0.0, 1000.0, 20):
        desk.feed.say(pose=np.array([x, 0.0, 0.0]))
        desk.scene.draw()
    until(page, lambda shown: bool(np.allclose(wheels(shown).mean(axis=0), first, atol=2.0)))
