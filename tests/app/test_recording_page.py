"""Export part of a recording as a page and as an animated picture, and open them."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image, ImageChops
from playwright.sync_api import Browser, FloatRect, Page, expect

from tests.support.browser import PATIENCE_MS
from tests.support.programs import Program
from tests.support.recorded_drives import START_NS, recorded_circle
from tsd_twin.recording.events import Annotation, add_mark

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(240)]

Start = Callable[..., Program]
SECONDS = 8
STABLE = 4
"""Number of equal screenshots in a row that count as fully drawn."""
NOTE = "here it slipped </script><b>"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = recorded_circle(tmp_path_factory.mktemp("drives") / "drive.mcap", SECONDS)
    add_mark(path, Annotation(START_NS + 7_000_000_000, NOTE, "alice"))
    return path


def time_of(page: Page) -> float:
    """Return the time that the playback bar shows, in seconds."""
    value = page.locator("[role=slider][aria-valuemax]").get_attribute("aria-valuenow")
    return float(value or 0.0)


def show(page: Page, t_s: float) -> Image.Image:
    """Set a time and return a screenshot of the scene."""
    page.evaluate("(t) => tsdShow(t)", t_s)
    expect(page.locator("[role=slider][aria-valuemax]")).to_have_attribute(
        "aria-valuenow", f"{t_s:g}", timeout=PATIENCE_MS
    )
    clip: FloatRect = {"x": 100.0, "y": 60.0, "width": 400.0, "height": 200.0}
    shots = [b""]
    while (
        len(shots) < STABLE or len(set(shots[-STABLE:])) > 1
    ):  # A canvas does not report when it is drawn.
        page.wait_for_timeout(1000)
        shots.append(page.screenshot(clip=clip, timeout=PATIENCE_MS))
    return Image.open(io.BytesIO(shots[-1])).convert("L")


def difference(one: Image.Image, other: Image.Image) -> float:
    """Return the fraction of pixels that differ visibly."""
    seen = ImageChops.difference(one, other).point(lambda value: 255 if value > 12 else 0)
    return seen.histogram()[255] / (one.width * one.height)


def test_a_page_plays_from_disk_in_a_browser_without_a_network(
    recording: Path, browser: Browser, start: Start, tmp_path: Path
) -> None:
    file = tmp_path / "drive.html"
    export = start("tsd_record", "export", str(recording), "--html", str(file), "--from", "2")
    assert export.wait() == 0, export.sentence
    assert file.stat().st_size < 5_000_000
    asked: list[str] = []
    errors: list[str] = []
    context = browser.new_context(offline=True, viewport={"width": 640, "height": 480})
    page = context.new_page()
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(f"{file.as_uri()}?fixedDpr=0.5")  # Otherwise viser may change it.
    label = page.locator(".tsd-label")
    expect(label).to_contain_text("RECORDING", timeout=PATIENCE_MS)
    expect(label).to_contain_text("tsd DRIVING", timeout=PATIENCE_MS)
    page.wait_for_function(
        "document.querySelector('[role=slider][aria-valuemax]').ariaValueNow > 1",
        timeout=PATIENCE_MS,
    )
    start_, later = show(page, 0.5), show(page, 6)
    assert difference(start_, later) > 0.003
    assert difference(start_, show(page, 0.5)) < 0.003
    # Playback is paused, and the next event is the mark.
    page.get_by_role("button", name="event ▶").click()
    expect(page.locator(".tsd-note")).to_contain_text(NOTE, timeout=PATIENCE_MS)
    assert time_of(page) == pytest.approx(5.0, abs=0.02)
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert errors == []
    context.close()


def test_a_picture_moves_as_the_robot_did(recording: Path, start: Start, tmp_path: Path) -> None:
    file = tmp_path / "drive.webp"
    flags = ("--from", "4", "--to", "4.6")
    export = start("tsd_record", "export", str(recording), "--picture", str(file), *flags)
    assert export.wait() == 0, export.sentence
    with Image.open(file) as picture:
        assert picture.n_frames == 6
        assert picture.info["loop"] == 0
        frames = []
        for number in range(picture.n_frames):
            picture.seek(number)
            frames.append(picture.convert("L"))
    changes = [difference(a, b) for a, b in itertools.pairwise(frames)]
    assert min(changes) > 0.0005, changes
