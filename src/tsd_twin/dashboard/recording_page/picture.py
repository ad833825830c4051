"""Moving picture of a part of a recording: its page, photographed time by time in Chromium.

A processor without a graphics card draws a few frames a second. The page is set to each time and
waited for, so that the picture moves evenly all the same.
"""

from __future__ import annotations

import importlib
import io
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from tsd_twin.dashboard.recording_page.build import build
from tsd_twin.errors import MissingExtraError, TwinError
from tsd_twin.recording.export import Part

FRAMES_PER_S = 10
LONGEST_S = 30.0
SIZE_PX = (800, 500)
MOST_BYTES = 3_000_000
_QUALITIES = (80, 65, 50, 35, 20)
"""Of WebP, tried in this order until the picture is small enough."""
_FORMATS = {".webp": "WEBP", ".gif": "GIF"}
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless=new",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-dev-shm-usage",
)
_PATIENCE_MS = 60_000
_NO_WARNING = "[class*='Notifications-root'] { display: none }"
"""The warning of viser that there is no graphics card."""


def to_picture(part: Part, out: Path) -> str:
    """Write a part as a moving picture; return what was written.

    Raises:
        TwinError: the part is too long, a program is missing, or the file cannot be written.
    """
    if (kind := _FORMATS.get(out.suffix)) is None:
        raise TwinError(f"{out} is no moving picture: its name ends with .webp or .gif")
    if out.exists():
        raise TwinError(f"{out} is there already: choose another file")
    duration_s = part.opened().duration_s
    shown_s = min(part.end_s or duration_s, duration_s) - part.start_s
    if shown_s > LONGEST_S:
        raise TwinError(f"a picture has at most {LONGEST_S:g} s: choose them with --from and --to")
    browser = _browser()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(build(part), encoding="utf-8")
        frames = [
            Image.open(io.BytesIO(data)).convert("RGB")
            for data in _photographs(browser, page, shown_s)
        ]
    try:
        _write(frames, out, kind)
    except OSError as error:
        raise TwinError(f"{out} cannot be written: {error.strerror or error}") from error
    return f"wrote {out}: {len(frames)} frames, {out.stat().st_size / 1e6:.1f} MB"


def _write(frames: list[Image.Image], out: Path, kind: str) -> None:
    for quality in _QUALITIES:
        frames[0].save(
            out,
            kind,
            save_all=True,
            append_images=frames[1:],
            duration=round(1000 / FRAMES_PER_S),
            loop=0,
            quality=quality,
            method=4,
        )
        if kind == "GIF" or out.stat().st_size <= MOST_BYTES:
            return


def _browser() -> str:
    for name in _BROWSERS:
        if found := shutil.which(name):
            return found
    raise TwinError("a picture needs Chromium, which is not installed: write --html instead")


def _load_playwright() -> Any:
    try:
        return importlib.import_module("playwright.sync_api")
    except ImportError as error:
        raise MissingExtraError("A moving picture", "picture") from error


def _photographs(browser: str, page: Path, shown_s: float) -> Iterator[bytes]:
    width, height = SIZE_PX
    # Chromium has no sandbox for root; the page is our own.
    flags = [*_FLAGS, "--no-sandbox"] if os.geteuid() == 0 else [*_FLAGS]
    with _load_playwright().sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=flags)
        tab = chromium.new_page(viewport={"width": width, "height": height})
        tab.goto(f"{page.as_uri()}?fixedDpr=1")
        tab.add_style_tag(content=_NO_WARNING)
        tab.wait_for_function("window.tsdShow !== undefined", timeout=_PATIENCE_MS)
        for i in range(max(1, round(shown_s * FRAMES_PER_S))):
            # Some frames: the scene hears of it in the first, and is drawn after that.
            tab.evaluate(
                "async (t) => { tsdShow(t); for (let i = 0; i < 3; i++)"
                " await new Promise(requestAnimationFrame); }",
                i / FRAMES_PER_S,
            )
            yield tab.screenshot(type="jpeg", quality=92)
        chromium.close()
