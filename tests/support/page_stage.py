"""Dashboard page in a browser, with the test as its server and without a scene.

Files come from the source tree, and a script in the page replaces the socket. The page shows robot
states and other messages of a test at once.
"""

from __future__ import annotations

import copy
import re
import tempfile
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page

from tsd_twin.dashboard.gateway.pages import BUNDLE, FILES

OPERATOR = "web-01234567"
_VIEWPORT = """<!doctype html><script>
const origin = new URL(location.href).searchParams.get("parent");
const post = (t) => parent.postMessage({tsd: 1, t}, origin);
post("loaded");
setInterval(post, 50, "drawn");
</script>"""
_SOCKET = """
window.sent = [];
window.now = null;
window.WebSocket = class {
  static OPEN = 1;
  readyState = 1;
  bufferedAmount = 0;
  constructor(address) {
    if (String(address).includes("/lane?")) {
      this.readyState = 0;
      return;
    }
    window.socket = this;
    setTimeout(() => {
      this.onopen();
      for (const message of window.greeting ?? []) say(message);
    });
  }
  send(text) {
    const message = JSON.parse(text);
    if (message.t === "heartbeat") say({t: "heartbeat", sent_ms: message.sent_ms});
    else window.sent.push(message);
  }
  close() {}
};
window.say = (message) => window.socket.onmessage({data: JSON.stringify(message)});
let seen = 0;
window.show = (state) => {
  window.now = state;
  if (state !== null) say({...state, status_seq: (seen += 1)});
};
setInterval(() => window.now !== null && window.show(window.now), 50);
"""
"""Repeats the last state at 20 Hz, like a robot."""

_LIMITS = {
    "speed_mps": 1.0,
    "turn_rate_rad_per_s": 3.0,
    "max_command_age_s": 0.25,
    "stop_allowance_m": 0.3,
    "applied": 1.0,
    "reason": "",
    "why": [],
}
_STATUS: dict[str, Any] = {
    "mode": "disarmed",
    "stop_reason": "",
    "stop": None,
    "stops": 0,
    "arming": None,
    "lease": {
        "holder": None,
        "remaining_s": 0.0,
        "requested_by": None,
        "request_expires_in_s": 0.0,
        "reserved_for": None,
        "reservation_expires_in_s": 0.0,
    },
    "refusals": None,
    "command": {"seq": 0, "age_s": None, "echo_s": None, "accepted": 0, "dropped": {}},
    "limits": _LIMITS,
    "consistency": {"residual_mps": 0.0, "level": 0.0, "suspect": None, "contributions": {}},
    "wheel_speed": {"requested_rpm": 2500.0, "spin_rpm": 2500.0},
    "pose_sensor": None,
    "loop": {"hz": 100.0, "overruns": 0, "jitter_p99_ms": 0.1},
    "hardware": {"battery_v": 12.0},
}
_POSE = {
    **dict.fromkeys(("alpha", "beta", "tilt", "rpm"), 0.0),
    "direction": None,
    "axle": [0, 0],
    "push": [0, 0],
}
_MODULE = {
    **_POSE,
    "radius_mm": 0.0,
    "spinning": False,
    "setpoint": _POSE,
}
_LAID_OUT_MS = 100
COLOURS = ("#1f9ce6", "#ed0965", "#058467")


def robot(robot_id: str) -> dict[str, Any]:
    """Return the server's description message of a robot."""
    return {
        "t": "robot",
        "id": robot_id,
        "title": robot_id.title(),
        "max_speed_mps": 1.0,
        "space": "floor",
        "twist_axes": [{"name": n, "symbol": n, "unit": "m/s"} for n in ("vx", "vy", "omega")],
        "twist_scale_m": 1.0,
        "sideways": True,
        "panel": "gimbals",
        "max_tilt_deg": 30.0,
        "modules": ["module1", "module2", "module3"],
        "wheel_speed_limits": {
            "least_rpm": 500.0,
            "most_rpm": 3000.0,
            "default_rpm": 2500.0,
            "wheel_radius_m": 0.05,
            "servo_step_deg": 0.1,
        },
        "wheels": [],
        "joints": [],
        "alternative_estimate": None,
        "plot_fields": [],
        "not_promised": [],
    }


def state(mode: str = "disarmed", *, you: bool = False, **changed: Any) -> dict[str, Any]:
    """Return the state of a robot at rest with changed `lease`, `status` and other fields."""
    status = copy.deepcopy(_STATUS) | {"mode": mode} | changed.pop("status", {})
    status["lease"] |= {"holder": OPERATOR if you else None} | changed.pop("lease", {})
    return {
        "t": "state",
        "robot_s": 12.0,
        "age_ms": 0.0,
        "status": status,
        "mode_age_s": 12.0,
        "has_control": you,
        "rtt_ms": 5.0,
        "rtt_jitter_ms": 1.0,
        "pose": [-12.34, -10.31, -2.36],
        "twist": [0.5, 0.0, 0.1],
        "commanded": [0.5, 0.0, 0.1],
        "truth": None,
        "modules": [_MODULE] * 3,
        "wheels": [],
        "utilization": 0.0,
        "limit": None,
        "sphere": None,
        "estimate_difference": None,
        "route": None,
        "plot": {},
        "camera": {"off_screen_rad": None},
        "map": None,
        "past": None,
        "shadow": None,
    } | changed


def route(phase: str, number: int = 1, **changed: Any) -> dict[str, Any]:
    """Return a path state."""
    path = {"number": number, "phase": phase, "length_m": 1.5, "time_s": 4.2}
    return path | {"done_m": 0.4, "off_mm": 3.0, "why": None} | changed


class PageStage:
    """Page and its server."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def say(self, message: Mapping[str, Any]) -> None:
        """Send a message to the page."""
        self.page.evaluate("say", message)

    def show(self, shown: Mapping[str, Any] | None) -> None:
        """Send a state at 20 Hz, or none if None."""
        self.page.evaluate("show", shown)

    def sent(self, *types: str) -> list[dict[str, Any]]:
        """Return messages of these types from the page and discard all others."""
        return [m for m in self.page.evaluate("sent.splice(0)") if m["t"] in types]

    def resize(self, width: int, height: int) -> None:
        """Resize the page and wait for the result."""
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.wait_for_function(f"innerWidth === {width} && innerHeight === {height}")
        self.page.wait_for_timeout(_LAID_OUT_MS)

    def choose(self, robot_id: str, *robot_ids: str) -> None:
        """List robots and show the first one."""
        names = [
            {"id": each, "title": each.title(), "colour": colour}
            for each, colour in zip((robot_id, *robot_ids), COLOURS, strict=False)
        ]
        greeting = [welcome(names), robot(robot_id)]
        self.page.evaluate("(greeting) => (window.greeting = greeting).forEach(say)", greeting)


def welcome(names: list[dict[str, str]]) -> dict[str, Any]:
    """Return the server's first message."""
    return {
        "t": "welcome",
        "operator": OPERATOR,
        "role": "operator",
        "user": None,
        "may_stop": True,
        "robots": names,
        "robot": names[0]["id"],
    }


class _Handler(SimpleHTTPRequestHandler):
    """Request handler with browser caching and without a log."""

    def end_headers(self) -> None:
        """Let the browser cache scripts and styles, which take longest to load."""
        kept = self.path.startswith(("/page.", "/inter."))
        self.send_header("Cache-Control", "max-age=3600" if kept else "no-store")
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Log nothing."""


class _Server:
    """Server of the page and its source files, for all stages of a browser."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        html = (BUNDLE / "index.html").read_text("utf-8").replace("{{viewport}}", "")
        (folder / "index.html").write_text(html, "utf-8")
        (folder / "blank.html").write_text("", "utf-8")
        (folder / "viewport").mkdir()
        (folder / "viewport/index.html").write_text(_VIEWPORT, "utf-8")
        for name in FILES:
            (folder / name).symlink_to(BUNDLE / name)
        self._recordings = folder / "recordings"
        handler = partial(_Handler, directory=self._folder.name)
        self._files = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.address = f"http://127.0.0.1:{self._files.server_port}/"
        self._thread = threading.Thread(target=self._files.serve_forever, args=(0.1,))
        self._thread.start()

    def have_recordings(self, *, wanted: bool) -> None:
        """Serve a list of recordings, or an empty one."""
        self._recordings.unlink(missing_ok=True)
        if wanted:
            self._recordings.write_text("[]", "utf-8")

    def close(self) -> None:
        """Stop the server and remove its files."""
        self._files.shutdown()
        self._thread.join()
        self._files.server_close()
        self._folder.cleanup()


_servers: dict[Browser, _Server] = {}


def _server_of(browser: Browser) -> _Server:
    """Return the server of a browser; it ends with the browser."""
    if browser not in _servers:
        _servers[browser] = _Server()
        browser.once("disconnected", lambda _: _servers.pop(browser).close())
    return _servers[browser]


_pages: dict[tuple[Browser, bool], Page] = {}


def _page_of(browser: Browser, *, touch: bool) -> Page:
    """Return the page that all stages of a browser share, because new pages are slower."""
    key = (browser, touch)
    if key not in _pages:

        def forget(_: Browser) -> None:
            del _pages[key]

        _pages[key] = browser.new_context(has_touch=touch, is_mobile=touch).new_page()
        _pages[key].add_init_script(_SOCKET)
        browser.once("disconnected", forget)
    return _pages[key]


@contextmanager
def page_stage(
    browser: Browser,
    *,
    recordings: bool = False,
    touch: bool = False,
    size: tuple[int, int] = (1280, 720),
) -> Generator[PageStage]:
    """Open the page with the robot `tsd`, and with recordings if requested.

    With `touch` the pointer is a finger. No state of the last stage remains.
    """
    page, server = _page_of(browser, touch=touch), _server_of(browser)
    failures: list[str] = []

    def failed(error: object) -> None:
        failures.append(str(error))

    server.have_recordings(wanted=recordings)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.on("pageerror", failed)
    page.goto(server.address)
    page.wait_for_function("Boolean(window.socket?.onmessage)")
    page.get_by_role("button", name=re.compile("STOP")).first.wait_for()
    stage = PageStage(page)
    stage.choose("tsd")
    stage.show(state())
    try:
        yield stage
    finally:
        page.goto(f"{server.address}blank.html")
        page.evaluate("localStorage.clear(), sessionStorage.clear()")
        page.remove_listener("pageerror", failed)
    assert failures == []
