"""The dashboard's page in a real browser, and its operator."""

from __future__ import annotations

import json
import time

from tests.support.withheld import PATIENCE_S
from tests.system.chromium import Chromium, Tab
from tests.system.fault_stage import SPEED_MPS, Observer

_MODES = ("Disarmed", "Arming", "Ready", "Driving", "Stopping", "Stopped", "Fault")
"""Mode texts of a connected robot; without a signal or a robot the page shows others."""
_PRESSED_S = 0.2
_CONFIRM = "[role=dialog] [type=submit]"
_SHOWN = "getClientRects().length > 0"
_EVENTS = ("blur", "visibilitychange", "pointercancel", "lostpointercapture", "pointerdown")
"""Events that the page reports, because polling for them is slow."""


class RealPage:
    """One tab with the dashboard in it."""

    def __init__(self, browser: Chromium, url: str, *, window: bool = False) -> None:
        self.tab: Tab = browser.open(url, window=window)
        self.until_loaded()

    def until_loaded(self) -> None:
        """Wait until the controls are there and the robot is known, and note what happens."""
        self.tab.until(f"{self.element('.stick')}?.{_SHOWN}")
        said = f"{self.element('[role=status][aria-label=Mode]')}.textContent"
        self.tab.until(f"{json.dumps(_MODES)}.includes({said})")
        self.tab.tell_of(_EVENTS)

    def element(self, selector: str) -> str:
        """Return an expression for an element."""
        return f"document.querySelector({json.dumps(selector)})"

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.tab.value(f"{self.element(selector)}.textContent"))

    def place(self, selector: str, up: float = 0.0) -> tuple[float, float]:
        """Return a place in an element: its centre, or a fraction of half its height above it."""
        x, y = self.tab.value(
            f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2 * (1 - {up})])"
            f"({self.element(selector)}.getBoundingClientRect())"
        )
        return x, y

    def until_mode(self, mode: str) -> None:
        """Wait until the page shows a mode of the robot."""
        said = self.element("[role=status][aria-label=Mode]")
        self.tab.until(f"{said}.textContent.toLowerCase().includes({json.dumps(mode)})")

    def button(self, name: str) -> str:
        """Return an expression for a button that can be used now, by its name."""
        return (
            f"[...document.querySelectorAll('button')].findLast((each) => "
            f"(each.getAttribute('aria-label') ?? each.textContent) === {json.dumps(name)} && "
            f"each.{_SHOWN} && !each.hasAttribute('aria-disabled'))"
        )

    def press(self, name: str) -> float:
        """Click on a button, once it can be used, and return when the page was clicked on."""
        return self._press(self.button(name))

    def take_over(self) -> float:
        """Take control from another operator, and return when that was confirmed."""
        self.press("Take over")
        return self._press(self.element(_CONFIRM))

    def _press(self, button: str) -> float:
        now_ms = "performance.timeOrigin + performance.now()"
        epoch_ms = self.tab.until(
            f"((found, at) => found && (found.click(), at))({button}, {now_ms})"
        )
        return float(epoch_ms) / 1000.0 - (time.time() - time.monotonic())

    def can_take_over(self) -> bool:
        """Request control until it can be taken; return false if it is free."""
        asks = f"{self.button('Ask for control')}?.click()"
        free = f"Boolean({self.button('Take control')})"
        asked = f"Boolean({self.button('Withdraw')})"
        self.tab.until(f"{asked} || {free} || ({asks}, false)")
        return not self.tab.value(free)

    def drives(self) -> bool:
        """Return whether this page has control."""
        return self.text(".driver").startswith("You drive")

    def get_ready(self, observer: Observer) -> None:
        """Take control and arm at the highest level; repeat until the robot is ready.

        A page that stalls, for example while loading, loses control. A page that is slow when it
        takes control requests a lease for far links, which has a lower speed.
        """
        end_s = time.monotonic() + PATIENCE_S
        said = f"{self.element('[role=status][aria-label=Mode]')}.textContent.toLowerCase()"
        end = "new KeyboardEvent('keydown', {code: 'End', key: 'End', bubbles: true})"
        level = self.element(".cap")  # It is gone when the page loses control.
        raised = f"({level}?.dispatchEvent({end}), {level} !== null)"
        while True:
            self.take_control()
            status = observer.status
            held = status.lease.holder is not None
            if held and status.limits.speed_mps != SPEED_MPS:
                self.click("Release control")
            elif held and self.tab.value(f"{said}.includes('ready') && {raised}"):
                break
            self.click("Hold to reset")  # As assistive technology does.
            self.click("Arm")
            assert time.monotonic() < end_s, f"never ready: {observer.status}"
            time.sleep(_PRESSED_S)

    def click(self, name: str) -> None:
        """Click on a button, if it can be used."""
        self.tab.value(f"{self.button(name)}?.click()")

    def take_control(self) -> None:
        """Take control, also from another operator."""
        steps = ("Take control", "Ask for control", "Take over")
        buttons = [*map(self.button, steps), self.element(_CONFIRM)]
        clicks = ", ".join(f"{button}?.click()" for button in buttons)
        mine = f"{self.element('.driver')}.textContent.startsWith('You drive')"
        self.tab.until(f"{mine} || ({clicks}, false)")
