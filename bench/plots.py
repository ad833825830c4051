"""Benchmark of the Plots tab: ten minutes of eight fields, compared with another tab."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack

import psutil
from playwright.sync_api import Page

from bench.machine import cpu_s
from bench.page import HIDE, opened, wait_for_scene
from bench.programs import Load, dashboard, mock
from bench.table import Row, Run
from tests.support.browser import PATIENCE_MS

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
_SETTLED_MS = 1500.0
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


def rows(run: Run) -> Iterator[Row]:
    """Measure browser and dashboard in turn with the Plots tab and with the View tab."""
    samples, seconds = int(run.pick(12_000, 100)), run.pick(3.0, 0.5)
    with ExitStack() as stack:
        served = dashboard(stack.enter_context(mock()))
        page = _opened(stack, stack.enter_context(served), samples)
        browser = [
            one for one in psutil.Process().children(recursive=True) if "chrom" in one.name()
        ]

        def measure(tab: str) -> tuple[float, float]:
            page.get_by_role("tab", name=tab).click(timeout=PATIENCE_MS)
            page.wait_for_timeout(_SETTLED_MS)
            start_s = cpu_s(*(one.pid for one in browser))
            with Load(served) as load:
                page.wait_for_timeout(1000.0 * seconds)
            used_s = cpu_s(*(one.pid for one in browser)) - start_s
            return 1000.0 * used_s / seconds, load.ms_per_s

        yield from run.alternate(
            ["plots.browser", "plots.dashboard"],
            lambda: measure("Plots"),
            lambda: measure("View"),
            rounds=3,
        )


def _opened(stack: ExitStack, url: str, samples: int) -> Page:
    """Open the page of a robot with a history, without its scene."""
    layouts = json.dumps({"tsd": "600:" + ";".join(FIELDS)})
    page = opened(stack)
    page.add_init_script(f"localStorage.setItem('tsd-plots', {json.dumps(layouts)})")
    page.add_init_script(_HISTORY.replace("SAMPLES", str(samples)))
    page.goto(url)
    wait_for_scene(page)
    page.evaluate(HIDE)
    return page
