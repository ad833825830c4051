"""A newcomer drives the simulated robot from a real browser, through the real programs."""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect

from tests.app.conftest import Program
from tests.support.browser import (
    FEW_FRAMES,
    PATIENCE_MS,
    QUICK,
    WATCH_STALLS,
    centre,
    click_through,
    get_ready,
    give_back,
    mode,
    press,
    press_now,
    take_control_and_arm,
    trials,
)
from tests.support.stall_watch import StallWatch
from tsd_twin.bus import Bus, Config, client_config
from tsd_twin.dashboard.scene.client_camera import LABELS_ABOVE_M
from tsd_twin.dashboard.scene.framing import Stand, frame_robot
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.dashboard.scene.viser_compat import FIELD_OF_VIEW_RAD
from tsd_twin.lie import SE2, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_joints, decode_odometry, decode_twist
from tsd_twin.messages.commands import Sample
from tsd_twin.robots import load_robot

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

STOP_WITHIN_M = 0.35
UPRIGHT_RAD = 0.004
"""Two steps of a servo."""
STAYS_M = 0.01
"""While wheels run down, the robot trembles."""
MOVING_MPS = 0.15
"""A page without a GPU is a slow link, and on that less speed is granted than is asked for."""
ANY_PORTS = ("--port", "0", "--bus-port", "0")
_PATIENCE_S = 60.0
_PRESSES, _PRESS_S = 10, 5.0


@dataclass
class Press:
    """A control that is held."""

    down: Callable[[], None]
    up: Callable[[], None]


def key(page: Page, name: str) -> Press:
    return Press(lambda: page.keyboard.down(name), lambda: page.keyboard.up(name))


def stick_forward(page: Page) -> Press:
    x, y, reach = centre(page, "region", "Drive stick")

    def down() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - reach)

    return Press(down, page.mouse.up)


class Watcher:
    """What crosses the bus, seen by somebody who is neither page nor robot."""

    def __init__(self, bus: Bus, page: Page) -> None:
        self._page = page
        self._news = threading.Condition()
        self.truth: Array = np.zeros(3)
        self.twist: Array = np.zeros(3)
        self.tilt_rad = 0.0
        self.set_tilt_rad = 0.0
        self.way: list[Array] = []
        self.commands: list[Array] = []
        self._estimate: Odometry | None = None
        bus.subscribe(topics.TRUTH.key("tsd"), self._on_truth)
        bus.subscribe(topics.ODOM.key("tsd"), self._on_estimate)
        bus.subscribe(topics.JOINTS.key("tsd"), self._on_joints)
        bus.subscribe(topics.SETPOINT.key("tsd"), self._on_setpoint)
        bus.subscribe(topics.TWIST.key("tsd"), self._on_command)

    def _on_truth(self, sample: Sample) -> None:
        odometry = decode_odometry(sample.payload)
        with self._news:
            self.truth, self.twist = odometry.xy_heading, odometry.twist
            self.way.append(self.truth[:2])
            self._news.notify_all()

    def _on_estimate(self, sample: Sample) -> None:
        self._estimate = decode_odometry(sample.payload)

    @property
    def estimate(self) -> Odometry:
        """The estimated pose and its covariance."""
        assert self._estimate is not None
        return self._estimate

    def _on_joints(self, sample: Sample) -> None:
        self.tilt_rad = float(np.nanmax(np.abs(decode_joints(sample.payload).position_rad)))

    def _on_setpoint(self, sample: Sample) -> None:
        self.set_tilt_rad = float(np.nanmax(np.abs(decode_joints(sample.payload).position_rad)))

    def _on_command(self, sample: Sample) -> None:
        self.commands.append(decode_twist(sample.payload).twist)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until the truth is as expected."""
        with self._news:
            assert self._news.wait_for(condition, _PATIENCE_S), f"never: {what}, at {self.truth}"

    def holding(self, press: Press, condition: Callable[[], bool], what: str) -> None:
        """Hold a control until the truth is as expected.

        A page that is drawn without a GPU stalls at times. Then the robot stops, as it must, and
        obeys only a control that has been let go: so let go and press again, as a person would,
        who also takes control again when the page has lost it.
        """
        for _ in range(_PRESSES):
            press.down()
            with self._news:
                if self._news.wait_for(condition, _PRESS_S):
                    return
            press.up()
            self.until(lambda: self.at_rest, "standstill")
            get_ready(self._page)
        raise AssertionError(f"never: {what}, at {self.truth}")

    @property
    def at_rest(self) -> bool:
        return bool(np.abs(self.twist).max() < 1e-3)


def observer(endpoint: str) -> Config:
    """Return a session that also hears what other sessions tell the robot: peers would not."""
    config = client_config([endpoint])
    return Config(config.json5.replace('"mode": "peer"', '"mode": "client"'), endpoint)


@dataclass
class Demo:
    """The demo with its page open, and somebody who watches the bus."""

    page: Page
    watcher: Watcher
    console: list[ConsoleMessage]
    failures: list[str]


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Program], browser: Browser) -> Iterator[Demo]:
    """One demo and one page for all tests: starting them takes most of the time."""
    flags = ("--no-record", "--no-browser", "--until-eof", *ANY_PORTS)
    line = start_shared("tsd_demo", *flags).ready()
    url, endpoint = re.findall(r"http://\S+|tcp/[\d.:]+", line)
    context = browser.new_context(viewport={"width": 960, "height": 600})
    context.add_init_script(FEW_FRAMES)
    context.add_init_script(WATCH_STALLS)
    page = context.new_page()
    console: list[ConsoleMessage] = []
    failures: list[str] = []
    page.on("console", lambda message: console.append(message))
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.on("requestfailed", lambda request: failures.append(request.url))
    with Bus(observer(endpoint)) as bus:
        watcher = Watcher(bus, page)
        page.goto(url + QUICK)
        skip = page.get_by_role("button", name="Skip")
        expect(skip).to_be_visible(timeout=PATIENCE_MS)
        press(page, "Skip")
        yield Demo(page, watcher, console, failures)
    context.close()


@pytest.fixture
def demo(shared: Demo) -> Iterator[Demo]:
    """The demo with its robot disarmed, under no operator's control, and at rest."""
    yield shared
    give_back(shared.page)
    shared.watcher.until(lambda: shared.watcher.at_rest, "standstill")


_ORDER = """() => new Promise((done) => {
  const ran = [];
  requestAnimationFrame(() => (ran.push("first"), cancelAnimationFrame(second)));
  const second = requestAnimationFrame(() => ran.push("second"));
  requestAnimationFrame(() => (ran.push("third"), requestAnimationFrame(() => done(ran))));
})"""
_HELD = """() => new Promise((done) => {
  const proto = WebGL2RenderingContext.prototype;
  const isDrawn = proto.getSyncParameter;
  let looks = 0;
  proto.getSyncParameter = function () {
    // From the second look on the frame that is being drawn is a slow one, whatever it is.
    const end = performance.now() + 60;
    while (performance.now() < end);
    if (++looks === 2) requestAnimationFrame(() => done(looks > 2));
    if (looks === 3) proto.getSyncParameter = isDrawn;
    return this.UNSIGNALED;
  };
})"""
"""Whether what wants to draw waits while the last frame is said not to be drawn yet."""


def test_the_scene_is_drawn_no_faster_than_it_can_be(demo: Demo) -> None:
    mode(demo.page, "disarmed")
    assert demo.page.evaluate(_ORDER) == ["first", "third"]
    assert demo.page.evaluate(_HELD)
    assert "websocket" not in demo.page.url


def test_the_page_loads_without_an_error(demo: Demo) -> None:
    mode(demo.page, "disarmed")
    expect(demo.page.get_by_role("slider", name="Turn", exact=True)).to_be_visible()
    for name in ("Forward (m/s)", "Left (m/s)", "Turn left (rad/s)"):
        expect(demo.page.get_by_role("slider", name=name)).to_be_visible(timeout=PATIENCE_MS)
    for name in ("Mode", "Link", "Pose", "Speed"):
        expect(demo.page.get_by_role("status", name=name, exact=True)).to_be_visible()
    assert [message.text for message in demo.console if message.type == "error"] == []
    assert demo.failures == []


def test_the_stick_drives_forward_and_let_go_the_robot_stands_still(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    start = watcher.truth.copy()
    take_control_and_arm(page)
    stick = stick_forward(page)
    driven_s, since_s = 0.0, math.nan

    def two_seconds_at_speed() -> bool:
        # In all: a busy machine stops the robot in between, and the stick is pushed again.
        nonlocal driven_s, since_s
        if watcher.twist[0] < MOVING_MPS:
            since_s = math.nan
            return False
        now_s = time.monotonic()
        driven_s += 0.0 if math.isnan(since_s) else now_s - since_s
        since_s = now_s
        return driven_s > 2.0

    with StallWatch() as machine:
        watcher.holding(stick, two_seconds_at_speed, "two seconds of driving forward")
        at_release = watcher.truth.copy()
        stick.up()
        watcher.until(lambda: watcher.at_rest, "standstill")
    rolled_m = math.dist(at_release[:2], watcher.truth[:2])
    assert rolled_m <= STOP_WITHIN_M
    ahead_m, aside_m = SE2(start).inverse().transform(watcher.truth[:2])
    assert ahead_m > 2.0 * MOVING_MPS
    # A servo step is 16 mm/s at a wheel, so an open loop wanders a little.
    assert abs(aside_m) < 0.1 * ahead_m
    assert not watcher.commands[-1].any(), "one zero, then silence"

    def shown_m() -> float:
        text = page.get_by_role("status", name="Pose").inner_text()
        return float(re.findall(r"[−-]?\d+\.\d+", text)[0].replace("−", "-"))

    for _ in range(_PRESSES):  # A page that stalls shows the end of the drive later.
        if abs(shown_m() - watcher.estimate.xy_heading[0]) < 0.01:
            break
        page.wait_for_timeout(500)
    estimate = watcher.estimate
    assert shown_m() == pytest.approx(estimate.xy_heading[0], abs=0.01)
    # Joints that a stall of the machine left unmeasured make it less exact, and less sure.
    sigma_m = float(np.sqrt(estimate.pose_covariance[0, 0]))
    allowed_m = max(0.03, 3.0 * sigma_m) if machine.stalled else 0.03
    assert shown_m() == pytest.approx(watcher.truth[0], abs=allowed_m)
    mode(page, "ready")


def test_keys_drive_as_the_stick_does(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    take_control_and_arm(page)
    for name, axis, sign in (("w", 0, 1), ("a", 1, 1), ("s", 0, -1), ("d", 1, -1), ("q", 2, 1)):
        for trial in trials(page):
            with trial:
                get_ready(page)
                held = key(page, name)
                watcher.holding(
                    held, lambda a=axis, s=sign: s * watcher.twist[a] > MOVING_MPS, f"{name} moves"
                )
                at_release = watcher.truth.copy()
                held.up()
                watcher.until(lambda: watcher.at_rest, f"standstill after {name}")
                assert math.dist(at_release[:2], watcher.truth[:2]) <= STOP_WITHIN_M
                mode(page, "ready")


def test_stop_latches_and_only_reset_arm_and_a_new_command_move_again(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    take_control_and_arm(page)
    forward, back = key(page, "w"), key(page, "s")
    watcher.holding(forward, lambda: watcher.twist[0] > MOVING_MPS, "driving")
    at_stop = watcher.truth.copy()
    page.keyboard.press(" ")
    watcher.until(lambda: watcher.at_rest, "standstill")
    assert math.dist(at_stop[:2], watcher.truth[:2]) <= STOP_WITHIN_M
    mode(page, "stopped")
    forward.up()
    reset(page)
    assert watcher.at_rest
    get_ready(page)
    assert watcher.at_rest
    watcher.holding(back, lambda: watcher.twist[0] < -MOVING_MPS, "driving again, backwards")
    back.up()
    watcher.until(lambda: watcher.at_rest, "standstill")


def reset(page: Page) -> None:
    """Hold Reset stop with the mouse; first take control when the page has stalled and lost it."""
    said = page.get_by_role("status", name="Mode")
    for _ in range(_PRESSES):
        press_now(page, "Take control")
        x, y, _ = centre(page, "button", "Reset stop")
        page.mouse.move(x, y)
        page.mouse.down()
        with contextlib.suppress(AssertionError):
            expect(said).to_contain_text("disarmed", ignore_case=True, timeout=1000 * _PRESS_S)
            break
        page.mouse.up()
    mode(page, "disarmed")
    page.mouse.up()


def go(page: Page, press: Press) -> Press:
    """Hold the button of a path, once there is one that can be driven."""

    def down() -> None:
        path = page.get_by_role("status", name="Path")
        expect(path).to_contain_text(re.compile(r"\d m, |Arrived"), timeout=3000 * _PRESS_S)
        press.down()

    return Press(down, press.up)


def go_to_the_end(demo: Demo) -> None:
    """Hold the button with the mouse until the page says that the robot is there.

    Let go of a moment before by a page that stalls, it has to be held again for the rest.
    """
    held, path = go_button(demo.page), demo.page.get_by_role("status", name="Path")
    for _ in range(_PRESSES):
        held.down()
        try:
            expect(path).to_contain_text("Arrived", timeout=1000 * _PRESS_S)
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


def pixel_of(page: Page, place: tuple[float, float]) -> tuple[float, float]:
    """Return where a place on the floor is seen, metres from the robot: a camera of a textbook.

    The camera was placed when the robot was first seen, at its heading of zero.
    """
    box = page.locator("#tsd-overlay").bounding_box()
    assert box is not None
    shape, up = robot_shape(load_robot("tsd")), np.array([0.0, 0.0, 1.0])
    stand = Stand((0.0, 0.0), shape.reach_m, shape.height_m + LABELS_ABOVE_M)
    eye, look_at = frame_robot(stand, 0.0, box["width"] / box["height"], FIELD_OF_VIEW_RAD)
    ahead = look_at - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    seen = np.array([*place, 0.0]) - eye
    scale = box["height"] / (2.0 * math.tan(0.5 * FIELD_OF_VIEW_RAD) * (seen @ ahead))
    x, y = scale * (seen @ right), scale * (seen @ np.cross(right, ahead))
    return box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 - y


def test_a_path_is_driven_while_it_is_held_and_let_go_the_robot_stands(demo: Demo) -> None:
    """In numbers, held by a key; by a click on the floor, held with the mouse; and drawn."""
    for drive in (drive_by_numbers, drive_to_a_click, drive_what_is_drawn):
        for trial in trials(demo.page):
            with trial:
                demo.watcher.until(lambda: demo.watcher.at_rest, "standstill")
                get_ready(demo.page)
                drive(demo)


def drive_by_numbers(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    start, before = watcher.truth.copy(), len(watcher.commands)
    form = page.get_by_role("form", name="Go to")
    form.get_by_label("x (m)").fill(f"{start[0] + 1.5:.3f}", timeout=PATIENCE_MS)
    form.get_by_label("heading").fill("30")
    form.get_by_label("heading").press("Enter")
    page.get_by_role("region", name="Drive stick").focus()  # Letters are no keys in a field.
    assert len(watcher.commands) == before, "planned is not driven"
    held = go(page, key(page, "g"))
    watcher.holding(held, lambda: watcher.truth[0] > start[0] + 0.05, "on its way")
    at_release = watcher.truth.copy()
    held.up()
    watcher.until(lambda: watcher.at_rest, "standstill")
    assert math.dist(at_release[:2], watcher.truth[:2]) <= STOP_WITHIN_M
    assert not watcher.commands[-1].any(), "one zero, then silence"
    path = page.get_by_role("status", name="Path")
    expect(path).to_contain_text(re.compile(r"\d m, "), timeout=PATIENCE_MS)
    assert watcher.at_rest


def choose(page: Page, name: str) -> None:
    """Choose how to say where to go, which a trial that failed may have left chosen."""
    button = page.get_by_role("button", name=name, exact=True)
    if button.get_attribute("aria-pressed") == "true":
        click_through(page, "Delete the path")
    press(page, name)


def drive_to_a_click(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    path = page.get_by_role("status", name="Path")
    choose(page, "Go to")
    place = (0.4, -0.2)
    goal = watcher.truth[:2] + place
    for _ in range(_PRESSES):
        page.mouse.click(*pixel_of(page, goal - watcher.truth[:2]))
        try:
            expect(path).not_to_contain_text("Click on the floor", timeout=1000 * _PRESS_S)
            break
        except AssertionError:
            continue  # A click on a page that was busy may be lost.
    go_to_the_end(demo)
    assert math.dist(goal, watcher.truth[:2]) < 0.1


def drive_what_is_drawn(demo: Demo) -> None:
    """Ahead and then to the left: the robot passes the corner, far from the straight way."""
    page, watcher = demo.page, demo.watcher
    corner, end = (0.3, 0.0), (0.3, 0.3)
    line = [(0.05 * i, 0.0) for i in range(7)] + [(0.3, 0.05 * i) for i in range(1, 7)]
    start, before, seen = watcher.truth[:2].copy(), len(watcher.commands), len(watcher.way)
    choose(page, "Draw")
    path = page.get_by_role("status", name="Path")
    for _ in range(_PRESSES):
        for i, place in enumerate(line):
            page.mouse.move(*pixel_of(page, place))
            if i == 0:
                page.mouse.down()
        page.mouse.up()
        try:
            expect(path).to_contain_text(re.compile(r"0\.5\d m, "), timeout=2000 * _PRESS_S)
            break
        except AssertionError:
            continue  # A stroke on a page that was busy may be lost: draw it again.
    mode(page, "ready")
    assert len(watcher.commands) == before, "drawn is not driven"
    go_to_the_end(demo)
    assert math.dist(start + end, watcher.truth[:2]) < 0.1
    assert min(math.dist(start + corner, place) for place in watcher.way[seen:]) < 0.1


def test_a_preview_moves_gimbals_in_the_picture_and_nothing_else(demo: Demo) -> None:
    page, watcher = demo.page, demo.watcher
    mode(page, "disarmed")
    commands, truth = len(watcher.commands), watcher.truth.copy()
    scene = page.locator("canvas[data-engine]")
    still = scene.screenshot()
    slider = page.get_by_role("slider", name="Forward (m/s)")
    expect(slider).to_be_visible(timeout=PATIENCE_MS)
    tried = page.get_by_text("the sliders move your picture only")
    for _ in range(_PRESSES):
        box = slider.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y, steps=4)
        page.mouse.up()
        try:
            expect(tried).to_be_visible(timeout=1000 * _PRESS_S)
            break
        except AssertionError:
            continue  # The panel's own socket was away for a moment.
    expect(tried).to_be_visible()
    assert scene.screenshot() != still
    assert len(watcher.commands) == commands
    assert watcher.tilt_rad < UPRIGHT_RAD
    assert watcher.set_tilt_rad < UPRIGHT_RAD
    assert np.abs(watcher.truth - truth).max() < STAYS_M
