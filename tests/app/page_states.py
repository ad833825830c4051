"""States of robot and page that every size of the page has to show."""

from __future__ import annotations

from typing import Any

from tests.support.page_stage import OPERATOR, PageStage, route, state

MOUSE_SIZES = ((1440, 900), (1280, 720), (1024, 600), (768, 1024), (700, 600))
FINGER_SIZES = ((1024, 768), (768, 1024), (844, 390), (568, 320), (390, 844), (320, 568))
WINDOWS = [
    *(((width, height), False) for width, height in MOUSE_SIZES),
    *(((width, height), True) for width, height in FINGER_SIZES),
]
"""Sizes of windows, and whether fingers point."""

LONG_TEXT = "the wheel of module 2 does not follow its set-point by more than 1 degree " * 3
LONG = {"code": "hardware", "params": {"text": LONG_TEXT}}
STOPPED_BY_YOU = {"code": "stop_requested", "params": {"by": OPERATOR}}
REFUSED = {"t": "reply", "to": "plan", "ok": False, "why": LONG}
SUSPECT: dict[str, Any] = {
    "residual_mps": 0.1,
    "level": 3.0,
    "suspect": "module2",
    "contributions": {},
}
ASKED = {"holder": "bob", "requested_by": OPERATOR, "request_expires_in_s": 9.0}
IS_ASKED = {"requested_by": "bob-with-a-rather-long-name", "request_expires_in_s": 9.0}
STATES: dict[str, dict[str, Any]] = {
    "disarmed": state(),
    "another drives": state("driving", lease={"holder": "bob-with-a-rather-long-name"}),
    "you ask": state("driving", lease=ASKED),
    "you are asked": state("driving", you=True, lease=IS_ASKED),
    "you have control": state(you=True),
    "arming": state("arming", you=True, status={"arming": {"phase": "hold", "progress": 0.4}}),
    "ready": state("ready", you=True),
    "a path": state("ready", you=True, route=route("planned")),
    "arrived": state("ready", you=True, route=route("arrived")),
    "ended": state("ready", you=True, route=route("ended", why=LONG)),
    "driving": state("driving", you=True),
    "suspect": state("driving", you=True, status={"consistency": SUSPECT}),
    "stopping": state("stopping", you=True),
    "stopped": state("stopped", you=True, status={"stop": STOPPED_BY_YOU}),
    "stopped, not yours": state("stopped", status={"stop": LONG}),
    "fault": state("fault", you=True, status={"stop": LONG, "consistency": SUSPECT}),
    "a replay": state("driving", source="recording"),
    "silent": state("driving", you=True, age_ms=5000.0),
}
FLEET: dict[str, Any] = {
    "t": "fleet",
    "whole": True,
    "robots": [
        {
            "id": name,
            "title": name,
            "colour": "#1d96fe",
            "panel": "gimbals",
            "wheel_count": 3,
            "space": "floor",
            "source": "robot",
            "silent": name == "silent",
            "age_s": 0.1,
            "mode": "fault",
            "latched": True,
            "why": LONG,
            "driver": "bob-with-a-rather-long-name",
            "requested_by": None,
            "operators": {},
            "battery": {"volts": 11.1, "low": True},
            "event": {"why": LONG, "age_s": 3.0},
        }
        for name in ("tsd", "robot-with-a-name-of-31-letters", "silent")
    ],
    "poses": {"tsd": [0.0, 0.0, 0.0], "robot-with-a-name-of-31-letters": [2.0, 1.0, 1.0]},
}
"""Robots of the page of all robots, with long texts."""
TABS = ("Drive", "Modules", "Plots", "Health", "View", "Student")


def open_tab(stage: PageStage, name: str) -> bool:
    """Open a tab of the panel; return whether the tab exists in this window."""
    return stage.page.evaluate(
        """(name) => {
          const shown = (node) => node.checkVisibility();
          document.querySelectorAll(".unfold .btn").forEach((node) => shown(node) && node.click());
          return new Promise((done) => setTimeout(() => {
            const choices = "[role=tab], .phone-tabs button:not(.on)";
            const tab = [...document.querySelectorAll(choices)].find((node) =>
              shown(node) && node.textContent.trim() === name);
            tab?.click();
            done(tab !== undefined);
          }, 50));
        }""",
        name,
    )


def fold_panel(stage: PageStage) -> None:
    """Close the panel, wherever it is."""
    if stage.page.locator("aside.panel").is_visible():
        stage.page.evaluate("document.activeElement?.blur()")
        stage.page.keyboard.press("p")
