"""Page of a part of a recording: one HTML file that plays it offline, and a moving picture of that.

The scene is the one of the dashboard, serialized by viser with its own viewer; `page.js` adds what
happened: events, marks, mode and speed. For a picture the page is photographed in Chromium, set to
each time and waited for: a processor without a graphics card draws a few frames a second, and the
picture moves evenly all the same.
"""

from __future__ import annotations

import importlib
import io
import math
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace
from PIL import Image

from tsd_twin.dashboard.recorded.view import draw_recorded, timeline_events
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import RobotRoster, Theme
from tsd_twin.dashboard.scene.client_filter import shared_filter
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.stage import add_ground, add_lights
from tsd_twin.dashboard.wire.to_page import TimelineEvent
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.errors import MissingExtraError, TwinError
from tsd_twin.recording.export import RecordingSlice
from tsd_twin.recording.player import Player, RecordedRobot

FRAMES_PER_S = 30
TRACK_HZ = 10
"""Rate of mode and speed in the timeline."""
LONGEST_S = 600.0
"""Going back, viser plays from the start: a longer part would make a page wait."""
PICTURE_FRAMES_PER_S = 10
LONGEST_PICTURE_S = 30.0
PICTURE_SIZE_PX = (800, 500)
MOST_PICTURE_BYTES = 3_000_000
_QUALITIES = (80, 65, 50, 35, 20)
"""WebP qualities, tried in this order until the picture is small enough."""
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
_HERE = Path(__file__).parent


def to_html(part: RecordingSlice, out: Path) -> str:
    """Write a part as one HTML file; return a summary of the file.

    Raises:
        TwinError: If the part is empty or too long, or the file cannot be written or exists.
    """
    _check_new(out)
    html = build(part)
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(html)
    except OSError as error:
        raise TwinError(f"{out} cannot be written: {error.strerror}") from error
    return f"wrote {out}: {len(html.encode()) / 1e6:.1f} MB"


def _check_new(out: Path) -> None:
    if out.exists():
        raise TwinError(f"{out} is there already: choose another file")


def build(part: RecordingSlice) -> str:
    """Return a part as an HTML document.

    Raises:
        TwinError: If the part is empty or too long.
    """
    recording = part.opened()
    end_s = recording.duration_s if part.end_s is None else min(part.end_s, recording.duration_s)
    if end_s - part.start_s > LONGEST_S:
        raise TwinError(f"a page has at most {LONGEST_S:g} s: choose them with --from and --to")
    player = Player(part.path, part.robot)
    try:
        return _Builder(player, part.start_s, end_s).html()
    finally:
        player.close()


class _Builder:
    def __init__(self, player: Player, start_s: float, end_s: float) -> None:
        self._player = player
        self._start_s, self._end_s = start_s, end_s
        self._roster = RobotRoster()
        self._tracks: dict[str, _Track] = {each: _Track() for each in player.robots}

    def html(self) -> str:
        document = self._scene()
        data = msgspec.json.encode(self._about()).decode().replace("<", "\\u003c")
        parts = (
            f"<style>{(_HERE / 'page.css').read_text()}</style>",
            f'<script type="application/json" id="tsd-recording">{data}</script>',
            f'<script type="module">{(_HERE / "page.js").read_text()}</script>',
        )
        # The last one: scripts of viser have the word as a text.
        head_end = document.rindex("</head>")
        return document[:head_end] + "".join(parts) + document[head_end:]

    def _scene(self) -> str:
        server = viser_compat.start_server(self._player.path.name)
        try:
            scene = Scene(server, self._roster, TiltFactor.TRUE)
            add_lights(server.scene, Theme.DARK)
            add_ground(server.scene, Theme.DARK)
            self._player.seek(self._start_s)
            for robot in self._player.robots.values():
                scene.add(robot)
            scene.draw()
            serializer = viser_compat.scene_recorder(server, shared_filter(None, Theme.DARK))
            frames = max(1, math.ceil((self._end_s - self._start_s) * FRAMES_PER_S))
            for i in range(frames):
                self._draw(scene, i / FRAMES_PER_S)
                serializer.insert_sleep(1.0 / FRAMES_PER_S)
            return serializer.as_html(dark_mode=True)
        finally:
            server.stop()

    def _draw(self, scene: Scene, t_s: float) -> None:
        self._player.seek(self._start_s + t_s)
        for robot in self._player.robots.values():
            self._tracks[robot.id].add(t_s, robot)
        draw_recorded(scene, self._player)

    def _about(self) -> dict[str, Any]:
        start_ns = self._player.start_ns
        return {
            "name": self._player.path.name,
            "start_ms": round(1e-6 * start_ns + 1000.0 * self._start_s),
            "duration_s": self._end_s - self._start_s,
            "robots": [
                {
                    "id": robot.id,
                    "colour": "rgb({} {} {})".format(*self._roster.colour(robot.id)),
                    "unit": "m/s" if robot.kinematics.pose_type.__name__ == "SE2" else "rad/s",
                    "modes": self._tracks[robot.id].modes,
                    "speeds": self._tracks[robot.id].speeds,
                }
                for robot in self._player.robots.values()
            ],
            "hz": TRACK_HZ,
            "events": self._events(),
        }

    def _events(self) -> list[TimelineEvent]:
        shown = {"", *self._player.robots}  # Marks have no robot.
        return [
            replace(each, t_s=round(each.t_s - self._start_s, 3))
            for each in timeline_events(self._player)
            if each.robot in shown and self._start_s <= each.t_s <= self._end_s
        ]


class _Track:
    """Mode and speed of a robot over time."""

    def __init__(self) -> None:
        self.modes: list[tuple[float, str]] = []
        """Times at which a mode began."""
        self.speeds: list[float | None] = []

    def add(self, t_s: float, robot: RecordedRobot) -> None:
        """Add a time, in rising order."""
        status, odom = robot.snapshot.status, robot.snapshot.odom
        mode = status.mode if status is not None and robot.alive else ""
        if not self.modes or self.modes[-1][1] != mode:
            self.modes.append((round(t_s, 3), mode))
        if t_s * TRACK_HZ >= len(self.speeds) - 1e-6:
            speed = None if odom is None else _speed(odom.twist, planar=odom.wxyz is None)
            self.speeds.append(speed)


def _speed(twist: Any, *, planar: bool) -> float:
    return round(float(np.linalg.norm(twist[:2] if planar else twist)), 3)


def to_picture(part: RecordingSlice, out: Path) -> str:
    """Write a part as an animation; return a summary of the file.

    Raises:
        TwinError: If the part is too long, a program is missing, or the file cannot be written.
    """
    if (kind := _FORMATS.get(out.suffix)) is None:
        raise TwinError(f"{out} is no moving picture: its name ends with .webp or .gif")
    _check_new(out)
    duration_s = part.opened().duration_s
    shown_s = min(part.end_s or duration_s, duration_s) - part.start_s
    if shown_s > LONGEST_PICTURE_S:
        raise TwinError(
            f"a picture has at most {LONGEST_PICTURE_S:g} s: choose them with --from and --to"
        )
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
            duration=round(1000 / PICTURE_FRAMES_PER_S),
            loop=0,
            quality=quality,
            method=4,
        )
        if kind == "GIF" or out.stat().st_size <= MOST_PICTURE_BYTES:
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
    width, height = PICTURE_SIZE_PX
    # Chromium has no sandbox for root; the page is our own.
    flags = [*_FLAGS, "--no-sandbox"] if os.geteuid() == 0 else [*_FLAGS]
    with _load_playwright().sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=flags)
        tab = chromium.new_page(viewport={"width": width, "height": height})
        tab.goto(f"{page.as_uri()}?fixedDpr=1")
        tab.add_style_tag(content=_NO_WARNING)
        tab.wait_for_function("window.tsdShow !== undefined", timeout=_PATIENCE_MS)
        for i in range(max(1, round(shown_s * PICTURE_FRAMES_PER_S))):
            # Some frames: the scene hears of it in the first, and is drawn after that.
            tab.evaluate(
                "async (t) => { tsdShow(t); for (let i = 0; i < 3; i++)"
                " await new Promise(requestAnimationFrame); }",
                i / PICTURE_FRAMES_PER_S,
            )
            yield tab.screenshot(type="jpeg", quality=92)
        chromium.close()
