"""STOP keeps its place and lies on top: at every size of the page, in every state."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest
from playwright.sync_api import Browser

from tests.support.browser import FLAGS_WITHOUT_SCENE
from tests.support.page_stage import (
    LATCHED,
    OPERATOR,
    PREVIEW,
    PageStage,
    page_stage,
    route,
    state,
)

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

SIZES = (
    (1280, 720),
    (1440, 900),
    (1024, 600),
    (956, 720),  # The first one beside the panel.
    (1116, 900),  # And the second one.
    (853, 480),  # And at a zoom of 150 %,
    (593, 480),  # beside the panel, too.
    (700, 600),  # The third one beside the panel.
    (844, 390),
    (520, 390),
    (768, 1024),
    (640, 360),
    (568, 320),
    (390, 844),
    (320, 568),
)
LONG_TEXT = "the wheel of module 2 does not follow its set-point by more than 1 degree " * 3
STOPPED_BY = {"code": "stop_requested", "params": {"by": "web-01234567"}}
LONG = {"code": "hardware", "params": {"text": LONG_TEXT}}
REFUSED = {"t": "reply", "to": "arm", "ok": False}
SUSPECT = {"residual_mps": 0.1, "level": 3.0, "suspect": "module2", "contributions": {}}
MINE: dict[str, Any] = {"has_control": True}
ASKED = {"lease": {"holder": "bob", "requested_by": OPERATOR, "request_expires_in_s": 9.0}}
STATES: dict[str, dict[str, Any]] = {
    "disarmed": state(),
    "another drives": state("driving", lease={"holder": "bob-with-a-rather-long-name"}),
    "asked": state("driving", **ASKED),
    "is asked": state(
        "driving", lease={"requested_by": "bob", "request_expires_in_s": 9.0}, **MINE
    ),
    "mine, disarmed": state(**MINE),
    "arming": state("arming", status={"arming": {"phase": "hold", "progress": 0.4}}, **MINE),
    "ready": state("ready", **MINE),
    "a path": state("ready", route=route("planned"), **MINE),
    "going": state("driving", route=route("going"), **MINE),
    "arrived": state("ready", route=route("arrived"), **MINE),
    "ended": state("ready", route=route("ended", why=LONG), **MINE),
    "driving": state("driving", **MINE),
    "suspect": state("driving", status={"consistency": SUSPECT}, **MINE),
    "stopping": state("stopping", **MINE),
    "stopped": state("stopped", status={"stop": {"code": "stop_requested"}}, **MINE),
    "stopped, not mine": state("stopped", status={"stop": LONG}),
    "fault": state("fault", status={"stop": LONG, "consistency": SUSPECT}, **MINE),
    "silent": state("driving", age_ms=5000.0, **MINE),
}
GO_TO = "overlay().querySelector('.route .choices button').click()"
ON_TOP = """() => overlay().append(Object.assign(document.createElement("style"),
  {textContent: ".frame * { pointer-events: auto !important }"}))"""
"""What is drawn on top of STOP is found, also if it lets clicks through."""
BOXES = """() => {
  const boxOf = (node) => {
    const {left, top, right, bottom, width} = node.getBoundingClientRect();
    return {left, top, right, bottom, shown: width > 0};
  };
  const find = (selector) => overlay().querySelector(selector);
  const stop = find(".stop");
  const {left, top, right, bottom} = boxOf(stop);
  const covers = [];
  for (const x of [left + 17, (left + right) / 2, right - 17])
    for (const y of [top + 3, (top + bottom) / 2, bottom - 3]) {
      const there = overlay().elementFromPoint(x, y);
      if (!stop.contains(there)) covers.push(there?.className ?? "nothing");
    }
  const names = {stop: ".stop", pad: ".pad", track: ".track", control: ".driver .button",
    card: ".card", message: ".messages", map: ".map", pose: ".pose"};
  const boxes = Object.fromEntries(
    Object.entries(names).map(([name, selector]) => [name, boxOf(find(selector))]));
  const who = find(".who");
  const cut = who.scrollWidth > who.clientWidth + 1 || who.scrollHeight > who.clientHeight + 1;
  return {...boxes, covers, cut};
}"""


RESET = """() => {
  const box = overlay().querySelector(".card .button").getBoundingClientRect();
  const at = (y) => overlay().elementFromPoint((box.left + box.right) / 2, y)?.closest(".card");
  return {top: box.top, bottom: box.bottom, whole: Boolean(at(box.top + 2) && at(box.bottom - 2))};
}"""
"""Place of the reset in the card, and whether all of it is to be seen."""


@pytest.fixture(scope="module")
def stage(browser: Browser) -> Generator[PageStage]:
    with page_stage(browser, recordings=True) as opened:
        opened.page.evaluate(ON_TOP)
        yield opened


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_stop_never_moves_and_is_never_covered(stage: PageStage, size: tuple[int, int]) -> None:
    width, height = size
    stage.resize(width, height)
    seen: dict[str, dict[str, Any]] = {}

    def look(name: str) -> None:
        seen[name] = stage.page.evaluate(BOXES)

    for name, shown in STATES.items():
        stage.show(shown)
        look(name)
        if name in ("ready", "driving"):
            stage.page.evaluate(GO_TO)
            look(f"{name}, Go to")
            stage.page.evaluate(GO_TO)
    stage.show(state("driving", **ASKED))
    stage.page.get_by_role("button", name="Take over…").evaluate("(button) => button.click()")
    look("takes over")
    stage.show(state("stopped", status={"stop": LONG}, **MINE))
    for i in range(3):
        why = {"code": "hardware", "params": {"text": f"{i} {LONG_TEXT}"}}
        stage.say(REFUSED | {"why": why})
    look("notices")
    stage.choose("tsd", "atlas", "omni4")
    look("several robots")
    stage.show(state("ready", **MINE))
    for sliders in (LATCHED, PREVIEW):
        stage.move_slider(sliders)
        look(f"sliders {sliders['mode']}")
    stage.say(PREVIEW | {"vx": 0})
    stage.show(state("ready", route=route("planned"), **MINE))
    stage.page.keyboard.press("m")
    look("map")
    assert seen["map"]["map"]["shown"]
    stage.show(state("stopped", status={"stop": LONG}, **MINE))
    look("map, stopped")
    stage.page.keyboard.press("m")
    stage.show(state("ready", **MINE))
    fold = stage.page.locator("#tsd-overlay .group.last .button").last
    fold.evaluate("(button) => button.click()")
    look("folded")
    fold.evaluate("(button) => button.click()")
    stage.choose("tsd")

    stop = seen["disarmed"]["stop"]
    assert {name: boxes["stop"] for name, boxes in seen.items() if boxes["stop"] != stop} == {}
    assert {name: boxes["covers"] for name, boxes in seen.items() if boxes["covers"]} == {}
    assert [name for name, boxes in seen.items() if boxes["cut"]] == []
    for name, boxes in seen.items():
        for control in ("stop", "pad", "track", "control"):
            box = boxes[control]
            assert box["shown"], (name, control)
            assert min(box["left"], box["top"]) >= 0, (name, control, box)
            assert box["right"] <= width, (name, control, box)
            assert box["bottom"] <= height, (name, control, box)


ROW = """() => ["driver .button", "facts", "last"].map((name) => {
  const {left, right} = overlay().querySelector(`.group.${name}`).getBoundingClientRect();
  return {left, right};
})"""
"""Places of the button of control, of the link and of the last group, in the bar."""


@pytest.mark.parametrize("width", [956, 1000, 1061, 1116, 1229, 1231, 1280])
def test_controls_of_several_robots_do_not_touch_in_the_bar(stage: PageStage, width: int) -> None:
    stage.resize(width, 720)
    for names in (["mecanum", "tsd"], ["robot-with-a-name-of-31-letters", "tsd"]):
        stage.choose(*names)
        for shown in (state("driving", **MINE), state(lease={"holder": "bob-with-a-long-name"})):
            stage.show(shown)
            control, facts, last = stage.page.evaluate(ROW)
            assert facts["left"] - control["right"] >= 4, (names, control, facts)
            assert last["left"] >= facts["right"], (names, facts, last)
    stage.choose("tsd")


@pytest.mark.parametrize(
    "names", [["tsd", "omni4"], ["mecanum", "tsd"]], ids=lambda names: names[0]
)
def test_the_bar_of_a_phone_has_two_rows_with_several_robots(
    stage: PageStage, names: list[str]
) -> None:
    stage.resize(390, 844)
    stage.choose(*names)
    for mode in ("stopped", "driving", "arming"):
        stage.show(state(mode, **MINE))
        control, facts = stage.page.evaluate("""() => [".driver .button", ".facts"].map((name) => {
          const {top, bottom} = overlay().querySelector(name).getBoundingClientRect();
          return (top + bottom) / 2;
        })""")
        assert abs(control - facts) < 8, mode
    stage.choose("tsd")


ANSWERS = """() => ["Keep control", "Hand over"].filter((name) => {
  const button = [...overlay().querySelectorAll(".handover .button")].find(
    (each) => each.textContent === name);
  const {left, right, top, bottom} = button.getBoundingClientRect();
  const [x, y] = [(left + right) / 2, (top + bottom) / 2];
  return [[left + 3, y], [right - 3, y], [x, top + 3], [x, bottom - 3]].some(
    (at) => !button.contains(overlay().elementFromPoint(...at)));
})"""
"""Answers to a request for control of which a part is not to be seen."""


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_both_answers_to_a_request_for_control_can_be_pressed(
    stage: PageStage, size: tuple[int, int]
) -> None:
    stage.resize(*size)
    stage.show(STATES["is asked"])
    assert stage.page.evaluate(ANSWERS) == []


@pytest.mark.parametrize("size", SIZES[:9] + SIZES[13:14], ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("mode", ["stopped", "fault", "arming"])
def test_cards_do_not_lie_on_the_robot(stage: PageStage, size: tuple[int, int], mode: str) -> None:
    """A robot that is followed is in the middle, about a third of the picture high."""
    width, height = size
    stage.resize(width, height)
    stage.show(state(mode, status={"stop": STOPPED_BY}, **MINE))
    card = stage.page.evaluate(BOXES)["card"]
    assert card["shown"]
    if mode != "arming":  # The reset can be used without scrolling, above the stick.
        reset = stage.page.evaluate(RESET)
        assert reset["whole"], reset
    reach = 0.14 * height
    left, right = width / 2 - reach, width / 2 + reach
    beside = card["right"] <= left or card["left"] >= right
    assert beside or card["bottom"] <= height / 2 - reach, card


@pytest.mark.parametrize("size", SIZES[:5], ids=lambda size: f"{size[0]}x{size[1]}")
def test_the_pose_does_not_lie_on_the_robot(stage: PageStage, size: tuple[int, int]) -> None:
    """Above the timeline it is beside a robot in the middle, or below its wheels."""
    width, height = size
    stage.resize(width, height)
    stage.show(STATES["mine, disarmed"])
    pose = stage.page.evaluate(BOXES)["pose"]
    assert pose["shown"]
    beside = pose["right"] <= width / 2 - 0.14 * height
    assert beside or pose["top"] >= height / 2 + 0.17 * height, pose
