"""Operator of the real page: one browser, one page, one robot, pointers on the controls."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.support.withheld import budget
from tests.system.chromium import Chromium, RefusedError
from tests.system.fault_stage import MOVED_M, FaultStage, Observer, Run
from tests.system.real_page import RealPage

WATCHED_S = 0.6
"""For how long nothing may move after the last thing that happened."""
_PRESSES = 10
_PRESS_S = 5.0


@dataclass(frozen=True, slots=True)
class Pointer:
    """Pointer that pushes a control forward and releases it."""

    down: Callable[[RealPage], None]
    up: Callable[[RealPage], None]


def _finger_down(page: RealPage) -> None:
    page.tab.touch("touchStart", (*page.place(".stick"), 1))
    page.tab.touch("touchMove", (*page.place(".stick", 1.0), 1))


def _finger_up(page: RealPage) -> None:
    with contextlib.suppress(RefusedError):  # The browser has taken it away.
        page.tab.touch("touchEnd")


KEY = Pointer(lambda page: page.tab.key("w", down=True), lambda page: page.tab.key("w", down=False))
FINGER = Pointer(_finger_down, _finger_up)


class PageOperator:
    """Operator with browser and page, which are restarted when they have ended."""

    def __init__(self, scene: FaultStage, folder: Callable[[], Path]) -> None:
        self.scene = scene
        self._folder = folder
        self._browser: Chromium | None = None
        self._page: RealPage | None = None

    @property
    def observer(self) -> Observer:
        """Observer of the robot."""
        return self.scene.observer

    @property
    def browser(self) -> Chromium:
        """Running browser."""
        if self._browser is None or not self._browser.lives():
            self.close()
            self._browser = Chromium(self._folder())
        return self._browser

    @property
    def page(self) -> RealPage:
        """The page that has been open since, or a new one."""
        browser = self.browser
        if self._page is None:
            self._page = RealPage(browser, self.scene.url)
        return self._page

    def page_is_gone(self) -> None:
        """Discard the page."""
        self._page = None

    def tidy_up(self) -> None:
        """End the browser when a test has left it driving, and wait until nothing moves."""
        if not self.observer.at_rest:
            self.close()
        self.observer.until_rest()

    def close(self) -> None:
        """Leave nothing behind."""
        self._page = None
        if self._browser is not None:
            self._browser.close()
            self._browser = None

    def drive(self, hand: Pointer, page: RealPage | None = None) -> RealPage:
        """Get a page ready, hold a control until the robot is fast, and return the page.

        On a busy machine a page stalls at times. Then it releases the stick, and a person would
        push again.
        """
        page = page or self.page
        for _ in budget.tries("push", _PRESSES):
            page.get_ready(self.observer)
            hand.down(page)
            if self.observer.gets_fast(_PRESS_S):
                page.tab.forget()
                return page
            hand.up(page)
            self.observer.until_rest()
        raise AssertionError(f"never fast: {self.observer.status}")

    def watch(self, fault_s: float, over_s: float | None = None) -> Run:
        """Observe until some time after the fault is over; return the motion since the fault."""
        self.observer.until_rest()
        self.observer.until_time((over_s or fault_s) + WATCHED_S)
        return self.observer.run_since(fault_s)

    def stays_still(self) -> None:
        """Check that the robot stays at rest for a while."""
        since_s = time.monotonic()
        self.observer.until_time(since_s + WATCHED_S)
        assert self.observer.way_since(since_s) <= MOVED_M

    def drives_anew(self, hand: Pointer, page: RealPage | None = None) -> None:
        """Check that releasing and pushing again moves the robot, so the page was responsive
        before.
        """
        hand.up(page or self.page)
        hand.up(self.drive(hand, page))
        self.observer.until_rest()
