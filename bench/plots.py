"""Benchmark of the Plots tab: ten minutes of eight fields, compared with another tab."""

from __future__ import annotations

import json
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager

import psutil
from playwright.sync_api import Page, sync_playwright

from bench.bus import program
from bench.page import HIDE, wait_for_scene
from bench.table import Row
from tests.support.browser import FLAGS, PATIENCE_MS, executable

FIELDS = (
    "commanded.vx",
    "twist.vx",
    "modules.module1.tilt",
    "status.consistency.residual_mps",
    "link.round_trip_ms",
    "requested.vx_mps",
    "joints.module1_alpha.position_rad",
    "odom.sigma.x_m",
)
_SAMPLES, _SECONDS = 12_000, 15.0
_SMALLEST = 100, 0.5
_SETTLED_MS = 3000.0
_HISTORY = """
const Plain = WebSocket;
let filled = false;
window.WebSocket = class extends Plain {
  constructor(...words) {
    super(...words);
    if (!String(words[0]).includes("teleop")) return;
    this.addEventListener("message", ({ data }) => {
      const state = JSON.parse(data);
      if (filled || state.t !== "state") return;
      filled = true;
      for (let i = SAMPLES; i > 0; i -= 1) {
        const twist = [Math.sin(i / 50), Math.random(), Math.cos(i / 70)];
        const past = { ...state, twist, robot_s: state.robot_s - i / 20 };
        this.onmessage({ data: JSON.stringify(past) });
      }
    });
  }
};
"""
"""Inserts a history before the robot's first state, instead of waiting for ten minutes."""


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure browser and dashboard with the View tab, then with the Plots tab."""
    samples, seconds = _SMALLEST if smallest else (_SAMPLES, _SECONDS)
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    dashboard = [sys.executable, "-m", "tsd_dashboard", "--port", "0", "--until-eof"]
    with program(mock) as endpoint:
        served = program([*dashboard, "--connect", endpoint])
        with served as url, opened(url, samples) as page:
            pid = served.process.pid
            bare = loads(page, "View", pid, seconds)
            plots = loads(page, "Plots", pid, seconds)
    for what, i, more in (("browser", 0, 45.0), ("dashboard", 1, 3.0)):
        yield Row(
            f"{what}, plots of 8 fields over 10 minutes, of one core",
            plots[i],
            bare[i] + more,
            "%",
            f"without plots {bare[i]:.1f} %",
        )


@contextmanager
def opened(url: str, samples: int) -> Generator[Page]:
    """Open the page of a robot with a history, without its scene."""
    layouts = json.dumps({"tsd": "600:" + ";".join(FIELDS)})
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.add_init_script(f"localStorage.setItem('tsd-plots', {json.dumps(layouts)})")
        page.add_init_script(_HISTORY.replace("SAMPLES", str(samples)))
        page.goto(url)
        wait_for_scene(page)
        page.evaluate(HIDE)
        yield page
        browser.close()


def loads(page: Page, tab: str, dashboard: int, seconds: float) -> tuple[float, float]:
    """Return the CPU load of browser and dashboard in percent of a core, with a tab open."""
    page.get_by_role("tab", name=tab, exact=True).click(timeout=PATIENCE_MS)
    page.wait_for_timeout(_SETTLED_MS)
    browser = [one for one in psutil.Process().children(recursive=True) if "chrom" in one.name()]
    before = times_s(browser), times_s([psutil.Process(dashboard)])
    page.wait_for_timeout(1000.0 * seconds)
    after = times_s(browser), times_s([psutil.Process(dashboard)])
    shares = [100.0 * (end - start) / seconds for start, end in zip(before, after, strict=True)]
    return shares[0], shares[1]


def times_s(processes: list[psutil.Process]) -> float:
    """Return the CPU time of the running processes."""
    total_s = 0.0
    for process in processes:
        if process.is_running():
            times = process.cpu_times()
            total_s += times.user + times.system
    return total_s
