"""The Student tab in a browser, with no robot on the bus."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect

from tests.support.browser import PATIENCE_MS
from tests.support.programs import Program
from tsd_twin.bus import Bus, node_config
from tsd_twin.robots import SingularityDescription, load_robot

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

SIZES = [(1280, 720), (390, 844)]


@pytest.fixture
def address(start: Callable[..., Program]) -> Iterator[str]:
    """A dashboard on a bus without a robot."""
    with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
        flags = "--port", "0", "--connect", bus.endpoints()[0]
        yield re.findall(r"http://\S+", start("tsd_dashboard", *flags).ready())[0]


def top_speed(page: Page) -> Locator:
    """Return the top speed forward."""
    figures = page.locator("summary").filter(has_text="What the robot can do")
    expect(figures).to_be_visible(timeout=PATIENCE_MS)
    if page.locator(".results").is_hidden():
        figures.click()
    return page.locator(".results > div").filter(has_text="Top speed forward").locator("dd")


@pytest.mark.parametrize("size", SIZES, ids=["desk", "phone"])
def test_a_knob_a_number_the_link_and_the_file(
    browser: Browser,
    address: str,
    start: Callable[..., Program],
    tmp_path: Path,
    size: tuple[int, int],
) -> None:
    allowed = ["clipboard-read", "clipboard-write"]
    viewport: ViewportSize = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=viewport, permissions=allowed)
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    # The URL contains the setting, so its tab opens automatically, also in the phone sheet.
    page.goto(f"{address}?student=tsd&drive.wheel_radius_m=0.05")
    student = page.locator("#tab-body")
    number = student.get_by_role("spinbutton", name="Wheel radius, m")
    expect(number).to_have_value("0.05", timeout=PATIENCE_MS)
    top = top_speed(page)
    expect(top).to_have_text("6.54m/s", timeout=PATIENCE_MS)
    # One parameter by its number, one by a key.
    number.fill("0.06")
    expect(top).to_have_text("7.85m/s", timeout=PATIENCE_MS)
    slider = student.get_by_role("slider", name="Tilt limit")
    slider.focus()
    slider.press("ArrowLeft")
    expect(student.get_by_role("spinbutton", name="Tilt limit, °")).to_have_value("29")
    expect(top).to_have_text("7.62m/s", timeout=PATIENCE_MS)
    # An impossible setting shows an alert, which clears when the cause is fixed.
    speed = student.get_by_role("spinbutton", name="Drive speed, rpm")
    speed.fill("900")
    expect(student.get_by_role("alert")).to_contain_text("motor 1 turns from 2000 to 13603")
    speed.fill("2500")
    expect(student.get_by_role("alert")).to_be_hidden(timeout=PATIENCE_MS)
    student.get_by_role("button", name="Copy link").click()
    expect(student.get_by_text("The link is copied.")).to_be_visible(timeout=PATIENCE_MS)
    link = page.evaluate("navigator.clipboard.readText()")
    assert "drive.wheel_radius_m=0.06&drive.max_tilt_deg=29" in link
    with page.expect_download(timeout=PATIENCE_MS) as saving:
        student.get_by_role("button", name="Save as TOML").click()
    path = tmp_path / saving.value.suggested_filename
    saving.value.save_as(path)
    assert path.name == "my-tsd.toml"
    robot = load_robot(str(path))
    assert isinstance(robot, SingularityDescription)
    assert (robot.drive.wheel_radius_m, robot.drive.max_tilt_deg) == (0.06, 29.0)
    # Opening the link shows the same numbers.
    other = context.new_page()
    other.goto(link)
    expect(top_speed(other)).to_have_text("7.62m/s", timeout=PATIENCE_MS)
    context.close()
    assert errors == []
    # The configured robot runs.
    start("tsd_mock", "--robot", str(path), "--listen", "tcp/127.0.0.1:0").ready()


def test_every_kind_of_robot_has_its_knobs(browser: Browser, address: str) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.goto(f"{address}?student=omni4")
    student = page.locator("#tab-body")
    robots = student.get_by_role("combobox", name="Start from")
    expect(robots).to_have_value("omni4", timeout=PATIENCE_MS)
    for base, knob, row in (
        ("omni4", "Gear ratio", "Fastest direction"),
        ("atlas", "Sphere radius", "Top rate ωx"),
        ("tsd", "Azimuth 3, °", "Speed for one servo step"),
    ):
        robots.select_option(base)
        expect(robots).to_have_value(base, timeout=PATIENCE_MS)
        expect(student.locator("summary").first).to_be_visible(timeout=PATIENCE_MS)
        student.locator("details").evaluate_all("(all) => all.forEach((one) => (one.open = true))")
        expect(student.get_by_role("spinbutton", name=knob)).to_be_visible(timeout=PATIENCE_MS)
        expect(student.get_by_text(row)).to_be_visible(timeout=PATIENCE_MS)
    plots = student.get_by_role("img", name=re.compile("Reachable twists, "))
    expect(plots).not_to_have_count(0)
    for plot in plots.all():
        expect(plot).to_be_visible()
    expect(student.get_by_role("img", name="The robot from above, front up")).to_be_visible()
    # All controls have names and are large enough for fingers.
    for role in ("slider", "spinbutton", "button", "combobox", "textbox"):
        for control in student.get_by_role(role).all():
            box = control.bounding_box()
            assert box is not None
            assert min(box["width"], box["height"]) >= 24.0, control
    page.close()
