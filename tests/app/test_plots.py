"""The Plots tab in a real browser: fields, zoom, pan, cursor, and export of the plotted data."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.support.browser import PATIENCE_MS, mode
from tests.support.programs import Program, drive
from tests.support.robot_node import patient_robot
from tsd_twin.bus import Bus, client_config
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_joints
from tsd_twin.messages.status import decode_stamp, decode_status
from tsd_twin.messages.topics import Sample

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

ALPHA = "joints.module1_alpha.position_rad"
RESIDUAL = "status.consistency.residual_mps"
JOINT_DELAY_S = 0.5
"""Maximum age of the dashboard's latest joints relative to the status."""


class Subscriber:
    """Records the robot's messages by robot time."""

    def __init__(self, bus: Bus) -> None:
        self.residual_mps: dict[float, float] = {}
        self._numbers: dict[float, int] = {}
        self.angles: list[tuple[float, float]] = []
        bus.subscribe(topics.STATUS.key("tsd"), self._on_status)
        bus.subscribe(topics.JOINTS.key("tsd"), self._on_joints)

    def _on_status(self, sample: Sample) -> None:
        number, robot_ns = decode_stamp(sample.attachment)
        at_s = round(1e-9 * robot_ns, 6)
        self._numbers[at_s] = number
        self.residual_mps[at_s] = decode_status(sample.payload).consistency.residual_mps

    def _on_joints(self, sample: Sample) -> None:
        joints = decode_joints(sample.payload)
        angle = float(joints.position_rad[list(joints.names).index("module1_alpha")])
        self.angles.append((1e-9 * decode_stamp(sample.attachment)[1], angle))

    def missed(self, at_s: float) -> bool:
        """Return whether numbers of statuses are missing around a time, as on a busy machine."""
        before_s = max(each for each in self._numbers if each < at_s)
        after_s = min(each for each in self._numbers if each > at_s)
        return self._numbers[after_s] - self._numbers[before_s] > 1

    def had(self, angle: float, before_s: float) -> bool:
        """Return whether the robot sent this angle at a time or shortly before."""
        return any(
            angle == sent and -JOINT_DELAY_S < at_s - before_s < JOINT_DELAY_S
            for at_s, sent in self.angles
        )


@dataclass
class Stage:
    """Simulated robot, page with the Plots tab open, and a separate subscriber."""

    endpoint: str
    page: Page
    subscriber: Subscriber

    @property
    def area(self) -> Locator:
        return self.page.get_by_role("group", name="Plots", exact=True)

    @property
    def window(self) -> Locator:
        return self.page.get_by_role("combobox", name="Time window")

    def button(self, name: str) -> Locator:
        return self.page.get_by_role("button", name=name, exact=True)

    def open_tab(self) -> None:
        mode(self.page, "disarmed")
        self.page.get_by_role("tab", name="Plots").click(timeout=PATIENCE_MS)
        expect(self.area.locator(".u-over").first).to_be_visible(timeout=PATIENCE_MS)

    def reset(self) -> None:
        """Restore the defaults: usual fields, last 20 s, running."""
        self.button("Fields").click()
        self.button("Usual fields").click()
        self.button("Fields").click()
        self.window.select_option("20")
        if self.button("Go on").is_visible():
            self.button("Go on").click()
        expect(self.button("Pause")).to_be_visible()

    def choose(self, name: str) -> None:
        """Select with Enter, because the space bar is STOP."""
        self.button("Fields").click()
        self.page.get_by_role("searchbox", name="Find a field").fill(name)
        item = self.page.get_by_role("checkbox", name=name)
        item.focus()
        item.press("Enter")
        expect(item).to_have_attribute("aria-checked", "true")
        self.button("Fields").click()

    def download(self, name: str, folder: Path) -> Path:
        with self.page.expect_download(timeout=PATIENCE_MS) as download:
            self.button(name).click()
        path = folder / download.value.suggested_filename
        download.value.save_as(path)
        return path

    def csv(self, folder: Path) -> tuple[list[str], Array]:
        path = self.download("Save as CSV", folder)
        header = path.read_text("utf-8").splitlines()[0].split(",")
        return header, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)

    def record(self, seconds: float, folder: Path) -> None:
        """Wait until `seconds` of data are plotted."""
        span_s = 0.0
        while span_s < seconds:
            self.page.wait_for_timeout(200)
            lines = self.download("Save as CSV", folder).read_text("utf-8").splitlines()[1:]
            times_s = [float(line.partition(",")[0]) for line in lines]
            span_s = max(times_s, default=0.0) - min(times_s, default=0.0)


@pytest.fixture(scope="module")
def shared(browser: Browser, start_shared: Callable[..., Program]) -> Iterator[Stage]:
    """One robot and one page for all tests: starting them takes most of the time."""
    mock = start_shared("tsd_mock", "--listen", "tcp/127.0.0.1:0", *patient_robot())
    endpoint = mock.ready().split()[-1]
    dashboard = start_shared("tsd_dashboard", "--port", "0", "--connect", endpoint)
    url = re.findall(r"http://\S+", dashboard.ready())[0]
    page = browser.new_page(viewport={"width": 900, "height": 700})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    with Bus(client_config([endpoint])) as bus:
        made = Stage(endpoint, page, Subscriber(bus))
        page.goto(url)
        made.open_tab()
        yield made
    page.close()
    assert errors == []


@pytest.fixture
def stage(shared: Stage) -> Iterator[Stage]:
    yield shared
    shared.reset()


def test_a_file_of_the_plots_holds_what_another_subscriber_saw(
    stage: Stage, tmp_path: Path
) -> None:
    page, subscriber = stage.page, stage.subscriber
    stage.choose(ALPHA)
    expect(stage.area.get_by_text("module1_alpha")).to_be_visible(timeout=PATIENCE_MS)
    header, rows, angles = list[str](), np.zeros((0, 0)), np.zeros(0)
    drive(stage.endpoint, vx_mps=0.4, vy_mps=0.3, duration_s=1.0)
    stage.button("Pause").click()
    expect(stage.button("Go on")).to_be_visible()
    header, rows = stage.csv(tmp_path)
    assert rows[:, header.index(f"{RESIDUAL} [m/s]")].max() > 0.0
    angles = rows[:, header.index(f"{ALPHA} [rad]")]
    assert np.ptp(angles[np.isfinite(angles)]) > 0.01, "it has driven"
    columns = dict(zip(header, rows.T, strict=True))
    assert next(iter(columns)) == "robot_time [s]"
    times_s = columns["robot_time [s]"]
    assert np.all(np.diff(times_s) > 0.0)
    assert len(times_s) > 20
    residual = columns[f"{RESIDUAL} [m/s]"]
    for at_s, value in zip(times_s, residual, strict=True):
        if at_s in subscriber.residual_mps:
            assert subscriber.residual_mps[at_s] == value
        else:
            assert subscriber.missed(at_s)
    for at_s, angle in zip(times_s, angles, strict=True):
        assert np.isnan(angle) or subscriber.had(angle, at_s)
    # While paused, the export does not change.
    page.wait_for_timeout(300)
    again = stage.csv(tmp_path)
    assert again[0] == header
    np.testing.assert_array_equal(again[1], rows)
    # The cursor is near the right edge, so every plot shows one of the latest rows.
    box = stage.area.locator(".u-over").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] - 4, box["y"] + 10)
    titles = [stage.area.get_by_title(name, exact=True) for name in (RESIDUAL, ALPHA)]
    shown = [number(each.locator(".value").inner_text()) for each in titles]
    is_row = np.isclose(residual, shown[0], rtol=0.0, atol=5.01e-4)
    is_row &= np.isclose(angles, shown[1], rtol=0.0, atol=5.01e-4, equal_nan=True)
    assert is_row.any()


def number(text: str) -> float:
    return np.nan if text == "–" else float(text.replace("−", "-"))


def test_wheel_zooms_drag_pans_and_all_is_kept_over_a_reload(stage: Stage, tmp_path: Path) -> None:
    page, area = stage.page, stage.area
    expect(stage.window).to_have_value("20")
    stage.record(5.0, tmp_path)
    box = area.locator(".u-over").first.bounding_box()
    assert box is not None
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.wheel(0, 100)
    expect(stage.window).to_have_value("")
    page.mouse.wheel(0, -100)
    expect(stage.window).to_have_value("20")
    expect(stage.button("Pause")).to_be_visible()
    page.mouse.down()
    page.mouse.move(middle[0] + 20, middle[1], steps=4)
    page.mouse.up()
    expect(stage.button("Go on")).to_be_visible()
    end_s = stage.csv(tmp_path)[1][:, 0].max()
    area.focus()
    area.press("PageUp")
    earlier_s = stage.csv(tmp_path)[1][:, 0].max()
    assert earlier_s < end_s
    area.press("End")
    expect(stage.button("Pause")).to_be_visible()
    # Plot shortcuts move neither the robot nor the camera, and do not stop the robot.
    mode(page, "disarmed")
    stage.window.select_option("10 min")
    stage.choose(ALPHA)
    page.reload()
    stage.open_tab()
    expect(stage.window).to_have_value("600")
    expect(area.get_by_text("module1_alpha")).to_be_visible(timeout=PATIENCE_MS)
    stage.button("Fields").click()
    stage.button("Usual fields").click()
    expect(area.get_by_text("module1_alpha")).to_have_count(0)
    stage.button("Fields").click()


def test_fingers_pan_and_pinch(stage: Stage) -> None:
    """With synthetic pointer events for two fingers."""
    stage.window.select_option("1 min")
    stage.area.locator(".u-over").first.evaluate(_PINCH)
    expect(stage.button("Pause")).to_be_visible()
    kept = stage.page.evaluate("JSON.parse(localStorage.getItem('tsd-plots')).tsd")
    assert float(kept.partition(":")[0]) == pytest.approx(20.0)
    stage.area.locator(".u-over").first.evaluate(_SWIPE)
    expect(stage.button("Go on")).to_be_visible()


_FINGER = """
  const { left, width, top } = over.getBoundingClientRect();
  over.closest(".charts").setPointerCapture = () => {};  // These pointers are not real ones.
  const say = (type, pointerId, share) =>
    over.dispatchEvent(new PointerEvent(type, {
      pointerId, clientX: left + share * width, clientY: top + 5, button: 0,
      pointerType: "touch", bubbles: true, composed: true }));
"""
_PINCH = f"""(over) => {{{_FINGER}
  say("pointerdown", 11, 0.4);
  say("pointerdown", 12, 0.6);
  say("pointermove", 11, 0.2);
  say("pointermove", 12, 0.8);
  say("pointerup", 11, 0.2);
  say("pointerup", 12, 0.8);
}}"""
"""The fingers move three times as far apart."""
_SWIPE = f"""(over) => {{{_FINGER}
  say("pointerdown", 13, 0.4);
  say("pointermove", 13, 0.7);
  say("pointerup", 13, 0.7);
}}"""
