"""Drive the simulated robot from a real browser, through the real programs."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, ConsoleMessage, FloatRect, Page, expect

from tests.app.page_watcher import (
    PRESS_S,
    PRESSES,
    Press,
    Watcher,
    key,
    observer,
    stick_forward,
)
from tests.support.browser import (
    FEW_FRAMES,
    PATIENCE_MS,
    centre,
    click_through,
    get_ready,
    give_back,
    mode,
    take_control_and_arm,
    until_linked,
)
from tests.support.programs import Program
from tests.support.withheld import WithheldTime, budget
from tsd_twin.bus import Bus
from tsd_twin.dashboard.scene.framing import LABELS_ABOVE_M, Rectangle, Stand, frame_robot
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.dashboard.scene.viser_compat import FIELD_OF_VIEW_RAD
from tsd_twin.lie import SE2
from tsd_twin.robots import load_robot

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

STOP_WITHIN_M = 0.35
UPRIGHT_RAD = 0.004
"""Two servo steps."""
STAYS_M = 0.01
"""Wheels that coast to rest shake the robot."""
MOVING_MPS = 0.15
"""A page without a GPU counts as a slow link, so its speed limit is lower than requested."""
ANY_PORTS = ("--port", "0", "--bus-port", "0")
_ROBOT_PX = 80


@dataclass
class Demo:
    """The demo with an open page and a bus subscriber."""

    page: Page
    watcher: Watcher
    program: Program
    console: list[ConsoleMessage] = field(default_factory=list[ConsoleMessage])
    failures: list[str] = field(default_factory=list[str])
    free: Rectangle = field(default_factory=Rectangle)
    """Part of the view in which the page frames the robot."""
    seen_rad: float = 0.0
    """Heading of the robot when the camera was last placed behind it."""

    def listen(self) -> None:
        """Record console messages, errors and failed requests of the page."""
        self.page.on("console", lambda message: self.console.append(message))
        self.page.on("pageerror", lambda error: self.failures.append(str(error)))
        self.page.on("requestfailed", lambda request: self.failures.append(request.url))
        self.page.on("websocket", lambda socket: socket.on("framesent", self._on_sent))

    def _on_sent(self, sent: str | bytes) -> None:
        message: dict[str, Any] = json.loads(sent) if isinstance(sent, str) else {}
        if message.get("t") == "frame":
            self.free = Rectangle(*(message[side] for side in Rectangle._fields))

    def look(self) -> None:
        """Place the camera behind the robot."""
        self.seen_rad = float(self.watcher.truth[2])
        self.page.get_by_role("button", name="Bring the robot into view").click()
        self.page.wait_for_timeout(2000)  # Until the view is drawn and the camera sent.

    def pixel_of(self, place: tuple[float, float]) -> tuple[float, float]:
        """Project a floor point, in metres from the robot, to pixels (pinhole camera model)."""
        box = self.page.locator("iframe").bounding_box()
        assert box is not None
        shape, up = robot_shape(load_robot("tsd")), np.array([0.0, 0.0, 1.0])
        stand = Stand((0.0, 0.0), shape.reach_m, shape.height_m + LABELS_ABOVE_M)
        aspect = box["width"] / box["height"]
        eye, at = frame_robot(stand, self.seen_rad, aspect, FIELD_OF_VIEW_RAD, self.free)
        ahead = (at - eye) / np.linalg.norm(at - eye)
        right = np.cross(ahead, up)
        right /= np.linalg.norm(right)
        seen = np.array([*place, 0.0]) - eye
        scale = box["height"] / (2.0 * math.tan(0.5 * FIELD_OF_VIEW_RAD) * (seen @ ahead))
        x, y = float(scale * (seen @ right)), float(scale * (seen @ np.cross(right, ahead)))
        return box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 - y


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Program], browser: Browser) -> Iterator[Demo]:
    """One demo and one page for all tests: starting them takes most of the time."""
    flags = ("--no-record", "--no-browser", "--until-eof", *ANY_PORTS)
    program = start_shared("tsd_demo", *flags)
    url, endpoint = re.findall(r"http://\S+|tcp/[\d.:]+", program.ready())
    context = browser.new_context(viewport={"width": 1280, "height": 640})
    context.add_init_script(FEW_FRAMES)
    page = context.new_page()
    with Bus(observer(endpoint)) as bus:
        demo = Demo(page, Watcher(bus, page), program)
        demo.listen()
        page.goto(url)
        expect(page.get_by_role("group", name="Start")).to_be_hidden(timeout=PATIENCE_MS)
        yield demo
    context.close()


@pytest.fixture
def demo(shared: Demo) -> Iterator[Demo]:
    """The demo with its robot disarmed, free and at rest."""
    yield shared
    give_back(shared.page)
    shared.watcher.until(lambda: shared.watcher.at_rest, "standstill")


def test_the_page_loads_without_an_error(demo: Demo) -> None:
    page = demo.page
    mode(page, "disarmed")
    deck = page.get_by_role("region", name="Controls")
    for name in ("Forward", "Left", "Turn"):
        expect(deck.get_by_role("slider", name=name, exact=True)).to_be_visible(timeout=PATIENCE_MS)
    panel = page.get_by_role("tabpanel", name="Drive")
    for name in ("Forward", "Left", "Turn left"):
        expect(panel.get_by_role("slider", name=name, exact=True)).to_be_visible(
            timeout=PATIENCE_MS
        )
    expect(page.get_by_role("button", name=re.compile("^Link: "))).to_be_visible()
    assert [message.text for message in demo.console if message.type == "error"] == []
    assert demo.failures == []


def test_the_stick_drives_forward_and_let_go_the_robot_stands_still(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    start = watcher.truth.copy()
    take_control_and_arm(page)
    stick = stick_forward(page)
    driven_s, since_s = 0.0, math.nan

    def two_seconds_at_speed() -> bool:
        # Distances add up over pushes, because a busy machine stops the robot in between.
        nonlocal driven_s, since_s
        if watcher.twist[0] < MOVING_MPS:
            since_s = math.nan
            return False
        now_s = time.monotonic()
        driven_s += 0.0 if math.isnan(since_s) else now_s - since_s
        since_s = now_s
        return driven_s > 2.0

    with WithheldTime(demo.program.process.pid) as withheld:
        watcher.holding(stick, two_seconds_at_speed, "two seconds of driving forward")
        with stopping(watcher):
            stick.up()
    ahead_m, aside_m = SE2(start).inverse().transform(watcher.truth[:2])
    assert ahead_m > 2.0 * MOVING_MPS
    # One servo step changes the wheel velocity by 16 mm/s, so open-loop motion drifts.
    assert abs(aside_m) < 0.1 * ahead_m
    assert not watcher.commands[-1].any(), "one zero, then silence"

    def shown_m() -> float:
        figures = page.get_by_role("region", name="Controls").get_by_role("definition")
        text = figures.nth(1).inner_text()  # Heading, x and y.
        return float(re.findall(r"[−-]?\d+\.\d+", text)[0].replace("−", "-"))

    for _ in range(PRESSES):  # A page that stalls shows the end of the drive later.
        if abs(shown_m() - watcher.estimate.xy_heading[0]) < 0.01:
            break
        page.wait_for_timeout(500)
    estimate = watcher.estimate
    assert shown_m() == pytest.approx(estimate.xy_heading[0], abs=0.01)
    # Joints move unmeasured while the machine withholds the processor from the loop.
    allowed_m = 0.03 + 0.3 * withheld.total_s
    assert shown_m() == pytest.approx(watcher.truth[0], abs=allowed_m)
    mode(page, "ready")


def test_keys_drive_as_the_stick_does(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    take_control_and_arm(page)
    for name, axis, sign in (("w", 0, 1), ("a", 1, 1), ("s", 0, -1), ("d", 1, -1), ("q", 2, 1)):
        get_ready(page)
        held = key(page, name)
        watcher.holding(
            held, lambda a=axis, s=sign: s * watcher.twist[a] > MOVING_MPS, f"{name} moves"
        )
        with stopping(watcher):
            held.up()
        mode(page, "ready")


def test_stop_latches_and_only_reset_arm_and_a_new_command_move_again(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    take_control_and_arm(page)
    forward, back = key(page, "w"), key(page, "s")
    watcher.holding(forward, lambda: watcher.twist[0] > MOVING_MPS, "driving")
    with stopping(watcher):
        page.keyboard.press(" ")
    mode(page, "stopped")
    forward.up()
    reset(page)
    assert watcher.at_rest
    get_ready(page)
    assert watcher.at_rest
    watcher.holding(back, lambda: watcher.twist[0] < -MOVING_MPS, "driving again, backwards")
    back.up()
    watcher.until(lambda: watcher.at_rest, "standstill")


@contextlib.contextmanager
def stopping(watcher: Watcher) -> Iterator[None]:
    """Check that the robot stops within the promised distance of an input.

    Page, dashboard and robot may all be late by the withheld time.
    """
    with WithheldTime(os.getpid()) as withheld:
        at = watcher.truth[:2].copy()
        yield
        watcher.until(lambda: watcher.at_rest, "standstill")
    late_m = load_robot("tsd").limits.speed_mps * withheld.total_s
    assert math.dist(at, watcher.truth[:2]) <= STOP_WITHIN_M + late_m


def reset(page: Page) -> None:
    """Hold the reset button with the mouse, once the robot would be reset."""
    until_linked(page)
    button = page.get_by_role("button", name="Hold to reset")
    expect(button).not_to_have_attribute("aria-disabled", "true", timeout=PATIENCE_MS)
    x, y, _ = centre(page, "button", "Hold to reset")
    page.mouse.move(x, y)
    page.mouse.down()
    mode(page, "disarmed")
    page.mouse.up()


def go(page: Page, press: Press) -> Press:
    """Hold the button of a path once a drivable path exists."""

    def down() -> None:
        path = page.get_by_role("status", name="Path")
        expect(path).to_contain_text(re.compile(r"\d m, |Arrived"), timeout=3000 * PRESS_S)
        press.down()

    return Press(down, press.up)


def go_to_the_end(demo: Demo) -> None:
    """Hold the button with the mouse until the page reports arrival.

    If a stalled page releases it early, hold it again.
    """
    held, path = go_button(demo.page), demo.page.get_by_role("status", name="Path")
    for _ in budget.tries("hold the button of a path", PRESSES):
        held.down()
        try:
            expect(path).to_contain_text("Arrived", timeout=1000 * PRESS_S)
        except AssertionError:
            held.up()
            demo.watcher.until(lambda: demo.watcher.at_rest, "standstill")
            get_ready(demo.page)
        else:
            break
    expect(path).to_contain_text("Arrived")
    held.up()
    mode(demo.page, "ready")


def go_button(page: Page) -> Press:
    def down() -> None:
        x, y, _ = centre(page, "button", "Hold to go")
        page.mouse.move(x, y)
        page.mouse.down()

    return go(page, Press(down, page.mouse.up))


def test_a_path_is_driven_while_it_is_held_and_let_go_the_robot_stands(demo: Demo) -> None:
    """Enter the goal as numbers and hold by key; click on the floor; draw a path."""
    for drive in (drive_by_numbers, drive_to_a_click, drive_what_is_drawn):
        demo.watcher.until(lambda: demo.watcher.at_rest, "standstill")
        get_ready(demo.page)
        drive(demo)


def drive_by_numbers(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    start, before = watcher.truth.copy(), len(watcher.commands)
    form = page.get_by_role("form", name="Go to a point")
    if not form.is_visible():
        page.get_by_text("Go to a point", exact=True).click()
    form.get_by_label("x in m").fill(f"{start[0] + 1.5:.3f}", timeout=PATIENCE_MS)
    form.get_by_label("heading").fill("30")
    form.get_by_label("heading").press("Enter")
    page.get_by_role("application", name="Stick").focus()  # Letter keys are text in a field.
    assert len(watcher.commands) == before, "planned is not driven"
    held = go(page, key(page, "g"))
    watcher.holding(held, lambda: watcher.truth[0] > start[0] + 0.05, "on its way")
    with stopping(watcher):
        held.up()
    assert not watcher.commands[-1].any(), "one zero, then silence"
    path = page.get_by_role("status", name="Path")
    expect(path).to_contain_text(re.compile(r"\d m, "), timeout=PATIENCE_MS)
    assert watcher.at_rest


def choose(demo: Demo, name: str) -> None:
    """Choose how to enter a goal; a failed attempt may have left a path."""
    click_through(demo.page, "Delete the path")
    demo.look()
    demo.page.get_by_role("radio", name=name).click(timeout=PATIENCE_MS)


def drive_to_a_click(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    path = page.get_by_role("status", name="Path")
    choose(demo, "Go to")
    place = (0.4, -0.2)
    goal = watcher.truth[:2] + place
    until_linked(page)
    expect(path).to_contain_text("Click on the floor", timeout=PATIENCE_MS)
    page.mouse.click(*demo.pixel_of(place))
    expect(path).not_to_contain_text("Click on the floor", timeout=PATIENCE_MS)
    with WithheldTime(demo.program.process.pid) as withheld:
        go_to_the_end(demo)
    # Joints move unmeasured while the machine withholds the processor from the loop.
    assert math.dist(goal, watcher.truth[:2]) < 0.1 + 0.3 * withheld.total_s


def drive_what_is_drawn(demo: Demo) -> None:
    """Draw a path ahead, then left; the robot passes the corner instead of cutting it."""
    page, watcher = demo.page, demo.watcher
    corner, end = (0.3, 0.0), (0.3, 0.3)
    line = [(0.05 * i, 0.0) for i in range(7)] + [(0.3, 0.05 * i) for i in range(1, 7)]
    start, before, seen = watcher.truth[:2].copy(), len(watcher.commands), len(watcher.way)
    choose(demo, "Draw")
    path = page.get_by_role("status", name="Path")
    for _ in budget.tries("draw", PRESSES):
        for i, place in enumerate(line):
            page.mouse.move(*demo.pixel_of(place))
            if i == 0:
                page.mouse.down()
        page.mouse.up()
        try:
            expect(path).to_contain_text(re.compile(r"0\.5\d m, "), timeout=2000 * PRESS_S)
            break
        except AssertionError:
            continue  # A busy page may lose a stroke; draw it again.
    mode(page, "ready")
    assert len(watcher.commands) == before, "drawn is not driven"
    with WithheldTime(demo.program.process.pid) as withheld:
        go_to_the_end(demo)
    near_m = 0.1 + 0.3 * withheld.total_s
    assert math.dist(start + end, watcher.truth[:2]) < near_m
    assert min(math.dist(start + corner, place) for place in watcher.way[seen:]) < near_m


def test_only_look_moves_gimbals_in_the_picture_and_nothing_else(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    mode(page, "disarmed")
    demo.look()
    commands, truth = len(watcher.commands), watcher.truth.copy()
    still = picture(demo)
    page.get_by_role("radio", name="Only look").click()
    slider = page.get_by_role("tabpanel", name="Drive").get_by_role("slider", name="Forward")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=4)
    expect(page.get_by_text("only looked at").first).to_be_visible(timeout=PATIENCE_MS)
    for _ in range(PRESSES):
        if picture(demo) != still:
            break
        page.wait_for_timeout(1000)  # The scene renders in software, without a GPU.
    else:
        pytest.fail("the picture is still")
    page.mouse.up()
    page.get_by_role("radio", name="Drive", exact=True).click()
    assert len(watcher.commands) == commands
    assert watcher.tilt_rad < UPRIGHT_RAD
    assert watcher.set_tilt_rad < UPRIGHT_RAD
    assert np.abs(watcher.truth - truth).max() < STAYS_M


def picture(demo: Demo) -> bytes:
    """Return a screenshot of the robot without the overlays in the corners."""
    x, y = demo.pixel_of((0.0, 0.0))
    side = 2.0 * _ROBOT_PX
    clip: FloatRect = {"x": x - _ROBOT_PX, "y": y - _ROBOT_PX, "width": side, "height": side}
    return demo.page.screenshot(clip=clip, timeout=PATIENCE_MS)
