"""Chromium without a screen, and the actions of a person on the page."""

from __future__ import annotations

import contextlib
import re
import shutil

from playwright.sync_api import Locator, Page, expect

from tests.support.withheld import budget

_EITHER = (
    "--headless=new",
    "--no-sandbox",  # Tests run as root, where Chromium has no sandbox.
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
FLAGS = (
    *_EITHER,
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
"""Renders the scene on the processor."""
CHEAP_FLAGS = (*FLAGS, "--disable-gpu-compositing")
"""Renders the scene like this, but the page without an emulated GPU, the most expensive part."""
FLAGS_WITHOUT_SCENE = (*_EITHER, "--disable-gpu", "--disable-software-rasterizer")
"""Browser without WebGL: all controls, but no scene, which is the most expensive part."""
FEW_FRAMES = """{
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (callback) => setTimeout(() => next(callback), 200);
}
"""
"""Page script that limits rendering to 5 Hz, as on a slow computer.

Without a limit, rendering takes most of the processor.
"""
PATIENCE_MS = 60_000
expect.set_options(timeout=PATIENCE_MS)
_PRESSES = 20
_ARMING = re.compile("arming", re.IGNORECASE)
_NEAR = re.compile(r"(^|\D)\d{1,2} ms")
_CENTRE = """(found) => {
  const usable = found.find((each) => each.getAttribute("aria-disabled") !== "true");
  if (usable === undefined) return null;
  const { left, top, width, height } = usable.getBoundingClientRect();
  return [left + width / 2, top + height / 2];
}"""


def executable() -> str:
    """Return the path of the browser that `scripts/ensure_chromium` installs."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if found := shutil.which(name):
            return found
    raise AssertionError("there is no Chromium: run scripts/ensure_chromium")


def mode(page: Page, word: str) -> None:
    """Wait until the page shows this mode of the robot."""
    expect(page.get_by_role("status", name="Mode")).to_contain_text(
        word, ignore_case=True, timeout=PATIENCE_MS
    )


def press(page: Page, name: str, patience_ms: float = PATIENCE_MS) -> None:
    """Press a button, once it can be pressed."""
    button = page.get_by_role("button", name=name, exact=True)
    expect(button).to_be_visible(timeout=patience_ms)
    expect(button).not_to_have_attribute("aria-disabled", "true", timeout=patience_ms)
    # Click its centre, because waiting for a stable frame takes long without a GPU.
    before, box = None, button.bounding_box()
    while box is None or box != before:  # Its neighbours may still move or hide it.
        page.wait_for_timeout(100)
        expect(button).to_be_visible(timeout=patience_ms)
        before, box = box, button.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def until_linked(page: Page) -> None:
    """Wait until the page shows a round trip or a loss, which proves that it receives states."""
    link = page.get_by_role("button", name=re.compile("^Link"))
    expect(link).to_contain_text(re.compile(r"\d+\s*(ms|%)"), timeout=PATIENCE_MS)


def press_linked(page: Page, name: str, then: Locator) -> None:
    """Press a button of a linked page once, and wait for its effect."""
    until_linked(page)
    press(page, name)
    expect(then).to_be_visible(timeout=PATIENCE_MS)


def click_through(page: Page, *names: str) -> None:
    """Click each of these buttons that is enabled, as assistive technology does."""
    for name in names:
        # In one script without waits, because buttons can disappear between calls.
        page.get_by_role("button", name=name, exact=True).evaluate_all(
            "(found) => found.filter((each) => each.getAttribute('aria-disabled') !== 'true')"
            ".slice(0, 1).forEach((each) => each.click())"
        )
    page.wait_for_timeout(100)


def take_control_and_arm(page: Page) -> None:
    """Follow the steps of a new user."""
    mode(page, "disarmed")
    get_ready(page)


def get_ready(page: Page) -> None:
    """Take control and arm with the mouse; repeat until the robot is ready.

    A page without processor time sends nothing and loses control, and its robot may be in a
    fault. A page that is slow when it takes control gets a lower speed, as over a far link.
    """
    said = page.get_by_role("status", name="Mode")
    held = page.get_by_role("button", name="Release control")
    armed = page.get_by_role("button", name="Disarm", exact=True)
    for _ in budget.tries("take control and arm", _PRESSES, free=2):  # The second call checks.
        with contextlib.suppress(AssertionError):
            link = page.get_by_role("button", name=re.compile("^Link"))
            expect(link).to_contain_text(_NEAR, timeout=PATIENCE_MS / _PRESSES)
        if held.is_visible() and re.search("ready|driving", said.inner_text(), re.IGNORECASE):
            return
        click_through(page, "Hold to reset")  # A mouse would have to hold it.
        for name, then in (("Take control", held), ("Arm", armed)):
            if press_now(page, name):
                with contextlib.suppress(AssertionError):
                    expect(then).to_be_visible(timeout=PATIENCE_MS / _PRESSES)
        with contextlib.suppress(AssertionError):  # The wheels of some spin up for two seconds.
            expect(said).not_to_contain_text(_ARMING, timeout=PATIENCE_MS / _PRESSES)
    raise AssertionError(f"not in control and armed: {said.inner_text()}")


def press_now(page: Page, name: str) -> bool:
    """Press a button with the mouse, and return whether it can be used now."""
    button, before = page.get_by_role("button", name=name, exact=True), None
    while (place := button.evaluate_all(_CENTRE)) is not None:
        if place == before:  # Its position is now stable.
            page.mouse.click(*place)
            return True
        before = place
        page.wait_for_timeout(100)
    return False


def give_back(page: Page) -> None:
    """Release all controls, disarm, and release the robot, in any state of the page."""
    page.mouse.up()
    for key in "wasdqeg":
        page.keyboard.up(key)
    free = page.get_by_role("button", name="Take control", exact=True)
    said = page.get_by_role("status", name="Mode")
    for _ in range(PATIENCE_MS // 100):  # Each iteration waits 100 ms.
        if "disarmed" not in said.inner_text().lower():
            click_through(page, "Take control", "Hold to reset", "Disarm")
        elif not free.is_visible():
            click_through(page, "Release control")
        else:
            return
    raise AssertionError(f"neither disarmed nor free: {said.inner_text()}")


def centre(page: Page, role: str, name: str) -> tuple[float, float, float]:
    """Return the centre of an element, and half its height, in pixels."""
    box = page.get_by_role(role, name=name).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, box["height"] / 2
