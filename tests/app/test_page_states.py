"""What the page shows is true: notices, hints, names and figures, in every state of the robot."""

from __future__ import annotations

import re
from collections.abc import Generator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, expect

from tests.support.browser import FLAGS_WITHOUT_SCENE, centre
from tests.support.page_stage import (
    COLOURS,
    LATCHED,
    OPERATOR,
    PageStage,
    page_stage,
    robot,
    route,
    state,
    welcome,
)

pytestmark = [
    pytest.mark.system,
    pytest.mark.busy,
    pytest.mark.timeout(120),
    pytest.mark.parametrize("browser", [FLAGS_WITHOUT_SCENE], indirect=True, scope="module"),
]

BOB = {"holder": "bob"}
ASKED = {"holder": "bob", "requested_by": OPERATOR, "request_expires_in_s": 9.0}
COVERED = """() => {
  const steps = overlay().querySelector(".steps");
  const buttons = [...overlay().querySelectorAll("button, .pad, .track")];
  return buttons.filter((button) => {
    const {left, top, width, height} = button.getBoundingClientRect();
    const there = overlay().elementFromPoint(left + width / 2, top + height / 2);
    return width > 0 && !steps.contains(button) && steps.contains(there);
  }).map((button) => button.textContent || button.className);
}"""
"""Controls that the first steps cover."""
IS_WHOLE = """(steps) => {
  const [own, pose] = [steps, overlay().querySelector(".pose")].map((node) =>
    node.getBoundingClientRect());
  const apart = own.right <= pose.left || own.left >= pose.right ||
    own.bottom <= pose.top || own.top >= pose.bottom;
  const fits = own.left >= 0 && own.right <= innerWidth;
  return apart && fits && steps.scrollWidth <= steps.clientWidth;
}"""


@pytest.fixture
def stage(browser: Browser) -> Generator[PageStage]:
    with page_stage(browser) as opened:
        yield opened


def button(stage: PageStage, name: str) -> Locator:
    return stage.page.get_by_role("button", name=name, exact=True)


def test_of_several_robots_the_one_that_the_controls_act_on_is_named(stage: PageStage) -> None:
    expect(button(stage, "Arm")).to_have_text("Arm")
    for robot_id, other, colour in (("atlas", "tsd", COLOURS[0]), ("tsd", "atlas", COLOURS[0])):
        stage.choose(robot_id, other)
        stage.show(state(you=True))
        expect(button(stage, f"Arm {robot_id}")).to_have_text(f"Arm {robot_id}")
        expect(stage.page.get_by_role("combobox", name="Robot")).to_have_value(robot_id)
        stage.show(state("ready", you=True))
        expect(button(stage, f"Disarm {robot_id}")).to_have_text(f"Disarm {robot_id}")
        rgb = tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))
        for selector in (".bar", ".pad"):
            shadow = re.compile(re.escape(f"rgb{rgb}"))
            expect(stage.page.locator(selector)).to_have_css("box-shadow", shadow)
    stage.choose("tsd")
    stage.show(state(you=True))
    expect(button(stage, "Arm")).to_have_text("Arm")


def test_the_colour_follows_the_robot_that_is_chosen(stage: PageStage) -> None:
    names = [
        {"id": each, "title": each, "colour": colour}
        for each, colour in zip(("tsd", "atlas"), COLOURS, strict=False)
    ]
    stage.say(welcome(names))
    for name, colour in zip(("tsd", "atlas", "tsd"), (*COLOURS[:2], COLOURS[0]), strict=True):
        stage.say(robot(name))
        frame = stage.page.locator(".frame")
        expect(frame).to_have_attribute("style", re.compile(f"--robot: {colour}"))


def test_the_stick_shows_where_x_of_the_world_is(stage: PageStage) -> None:
    mark = stage.page.locator(".world-x")
    stage.show(state("ready", you=True, pose=[0.0, 0.0, 1.5]))
    # Turned left by 1.5 rad, the robot has x of the world on its right.
    expect(mark).to_have_css("rotate", re.compile(r"^85\.9\d*deg$"))
    button(stage, "robot axes").click()
    expect(mark).to_have_css("rotate", "0deg")
    stage.show(None)
    expect(mark).to_be_hidden()


@pytest.mark.parametrize(
    "size", [(1280, 720), (700, 600), (844, 390), (520, 390), (390, 844), (568, 320)]
)
def test_the_first_steps_say_what_the_button_says_and_cover_no_control(
    browser: Browser, size: tuple[int, int]
) -> None:
    with page_stage(browser, hints=True) as stage:
        stage.resize(*size)
        steps = stage.page.get_by_role("region", name="First steps")
        expect(steps).to_contain_text("Take control")
        assert steps.evaluate(IS_WHOLE)
        stage.show(state("ready", lease=BOB))
        expect(steps).to_contain_text("Ask for control")
        for shown in (
            state(),
            state(lease=BOB),
            state(lease=ASKED),
            state(you=True),
            state(you=True, lease={"requested_by": "bob", "request_expires_in_s": 9.0}),
            state("ready", you=True),
            state("ready", you=True, lease={"requested_by": "bob", "request_expires_in_s": 9.0}),
        ):
            stage.show(shown)
            assert stage.page.evaluate(COVERED) == [], shown
        stage.show(state(lease=ASKED))
        button(stage, "Withdraw").click()
        assert stage.sent("lease")[-1]["op"] == "withdraw"


def test_a_robot_that_drives_without_a_hand_has_a_strip(stage: PageStage) -> None:
    strip = stage.page.get_by_text("KEEPS DRIVING")
    stage.show(state("ready", you=True))
    expect(strip).to_be_hidden()
    stage.move_slider(LATCHED)
    expect(strip).to_be_visible()
    assert stage.sent("drive")[-1]["vx"] == 0.2
    stage.say(LATCHED | {"vx": 0.0})
    expect(strip).to_be_hidden()


def test_the_question_of_a_take_over_goes_when_control_is_granted(stage: PageStage) -> None:
    question = stage.page.get_by_role("alertdialog", name="Take over")
    stage.show(state(lease=ASKED))
    button(stage, "Take over…").click()
    expect(question).to_be_visible()
    stage.show(state(you=True))
    expect(question).to_be_hidden()
    stage.show(state(lease=ASKED))
    button(stage, "Take over…").click()
    expect(question.get_by_role("textbox")).to_have_value("")
    button(stage, "Take over").click()
    asked = stage.sent("lease")[-1]
    assert (asked["op"], asked["take_over"], asked["reason"]) == (
        "acquire",
        True,
        "no reason given",
    )


def hold_the_stick(stage: PageStage) -> None:
    x, y, half = centre(stage.page, "region", "Drive stick")
    stage.page.mouse.move(x, y)
    stage.page.mouse.down()
    stage.page.mouse.move(x, y - 0.8 * half)


LOOSE = {"code": "hardware", "params": {"text": "the wheels are loose"}}


def lost_to(holder: str) -> dict[str, Any]:
    cause = {"code": "has_control_now", "params": {"holder": holder}}
    return {"code": "control_is_lost", "cause": cause}


def test_a_notice_goes_when_it_is_no_longer_true(stage: PageStage) -> None:
    messages = stage.page.get_by_role("log", name="Messages")
    stage.show(state("ready", you=True))
    hold_the_stick(stage)
    stage.show(None)
    expect(messages).to_contain_text("silent")
    stage.page.mouse.up()
    stage.show(state("ready", you=True))
    expect(messages).not_to_contain_text("silent", timeout=4000)
    # Of another robot nothing is true here.
    stage.say({"t": "reply", "to": "arm", "ok": False, "why": LOOSE})
    expect(messages).to_contain_text("loose")
    stage.choose("atlas", "tsd")
    expect(messages).to_be_empty()


def test_without_a_signal_nothing_looks_live(stage: PageStage) -> None:
    speed = stage.page.get_by_role("status", name="Speed", exact=True)
    plan, drive_speed = button(stage, "Plan"), stage.page.get_by_role("slider", name="Drive speed")
    cloud = stage.page.locator(".tabler-icon-cloud-check")
    stage.show(state("ready", you=True))
    expect(speed).to_contain_text("0.50")
    expect(plan).not_to_have_attribute("aria-disabled", "true")
    expect(drive_speed).to_be_enabled()
    expect(cloud).to_be_visible()
    stage.show(None)
    expect(speed).to_contain_text("–")
    expect(speed).not_to_contain_text("0.50")
    expect(plan).to_have_attribute("aria-disabled", "true")
    expect(drive_speed).to_be_disabled()
    expect(cloud).to_be_hidden()
    stage.show(state("ready", you=True))
    expect(speed).to_contain_text("0.50")
    expect(cloud).to_be_visible()


@pytest.mark.parametrize(
    "ended",
    [
        state("ready", you=True, route=route("arrived")),
        state("ready", you=True, route=route("ended", reason="it is lost")),
        state("stopped", you=True),
        state("fault", you=True),
    ],
    ids=["arrived", "ended", "stopped", "fault"],
)
def test_no_place_is_picked_after_the_end_of_a_path(
    stage: PageStage, ended: dict[str, object]
) -> None:
    go_to = button(stage, "Go to")
    for _ in range(2):  # The second time, too.
        stage.show(state("ready", you=True))
        go_to.click()
        expect(go_to).to_have_attribute("aria-pressed", "true")
        stage.show(state("ready", you=True, route=route("planned")))
        stage.show(state("driving", you=True, route=route("going")))
        expect(go_to).to_have_attribute("aria-pressed", "true")
        stage.show(ended)
        expect(go_to).to_have_attribute("aria-pressed", "false")


def test_a_refused_plan_leaves_no_path_of_before(stage: PageStage) -> None:
    stage.show(state("ready", you=True, route=route("planned")))
    form = stage.page.locator("[data-tsd=route] form")
    expect(form).to_be_attached()
    refused = state("ready", you=True, route=route("planned"))
    refused["status"]["refusals"] = {"why": {"disarm": LOOSE}}
    stage.show(refused)
    stage.sent()
    form.evaluate("(form) => form.requestSubmit()")
    assert [message["t"] for message in stage.sent("plan", "clear_plan")] == ["clear_plan"]


def test_a_page_that_is_loaded_again_in_motion_says_why_the_robot_stopped(stage: PageStage) -> None:
    messages = stage.page.get_by_role("log", name="Messages")
    stage.show(state("driving", you=True))
    stage.page.reload()
    expect(messages).to_contain_text("so the robot stopped")
    stage.page.reload()
    stage.page.wait_for_function("Boolean(window.socket?.onmessage)")
    expect(messages).to_be_empty()


SLOW = {
    "t": "event",
    "kind": "mode",
    "text": "",
    "why": {
        "code": "mode_changed",
        "params": {"before": "driving", "after": "stopping"},
        "cause": {"code": "no_command", "params": {"ms": 210, "limit_ms": 200}},
    },
    "past": False,
    "robot_s": 1.0,
    "age_s": 0.0,
}
STALLED = {"t": "released", "why": {"code": "page_stalled", "params": {"s": 0.2}}}


@pytest.mark.parametrize(
    "told",
    [SLOW, STALLED],
    ids=["robot", "page"],
)
def test_what_to_do_after_a_stop_is_not_said_any_more_when_stop_was_pressed(
    stage: PageStage, told: dict[str, Any]
) -> None:
    notice = stage.page.get_by_text("Let go, then push again")
    stage.show(state("driving", you=True))
    if told["t"] == "released":
        stage.page.keyboard.down("w")  # A page that holds nothing has nothing to let go.
    stage.say(told)
    stage.page.keyboard.up("w")
    stage.show(state("ready", you=True))
    expect(notice).to_be_visible()
    stage.show(state("stopped", you=True))
    expect(notice).to_be_hidden(timeout=4000)  # It is read for two seconds; others stay for six.


@pytest.mark.parametrize("by", ["page", "robot"])
def test_why_the_robot_stopped_is_told_once_whichever_tells_first(
    stage: PageStage, by: str
) -> None:
    toasts = stage.page.locator(".toast")
    stage.show(state("driving", you=True))
    stage.page.keyboard.down("w")
    told = [SLOW, STALLED]
    for message in told if by == "robot" else reversed(told):
        stage.say(message)
    stage.page.keyboard.up("w")
    by_robot = "No command for 210 ms (limit 200 ms)"
    first = by_robot if by == "robot" else "Your page stalled for 0.2 s"
    expect(toasts).to_have_text([f"{first}, so the robot stopped. Let go, then push again."])


def test_a_take_over_is_told_once_with_its_reason(stage: PageStage) -> None:
    toasts = stage.page.locator(".toast")
    stage.show(state("ready", you=True))
    event = {"t": "event", "kind": "lease", "text": "", "past": False, "robot_s": 1.0, "age_s": 0.0}
    params = {"operator": "bob", "other": OPERATOR, "text": "it is my robot"}
    stage.say(event | {"why": {"code": "lease_taken_over", "params": params}})
    stage.say(event | {"why": lost_to("bob")})
    expect(toasts).to_have_text([f"bob took control over from {OPERATOR}: it is my robot."])
    stage.page.wait_for_timeout(1100)
    stage.say(event | {"why": lost_to("carl")})
    expect(toasts).to_have_count(2)


def test_events_have_the_time_of_the_page(stage: PageStage) -> None:
    said = {"t": "event", "kind": "mode", "text": "", "why": LOOSE, "past": True}
    stage.say(said | {"robot_s": 12.5, "age_s": 3600.0})
    times = stage.page.evaluate(
        """() => [-1, 0, 1].map((off) => new Date(Date.now() + 1000 * off - 3.6e6)
        .toLocaleTimeString([], {timeStyle: "medium", hour12: false}))"""
    )
    time = stage.page.locator("[data-tsd=health] .log li .time").first
    assert time.text_content() in times
    expect(time).to_have_attribute("title", "12.5 s on the clock of the robot")


def test_the_panel_about_the_connection_takes_no_room_beside_the_tabs(stage: PageStage) -> None:
    connection, tabs = stage.page.locator("#connection"), stage.page.locator("#tabs")
    expect(connection).to_be_hidden()
    tabs.evaluate("(tabs) => (tabs.style.gridTemplateRows = '0fr')")
    expect(connection).to_be_visible()


def test_what_was_the_drawer_of_a_phone_is_let_alone_when_it_is_one_no_more(
    stage: PageStage,
) -> None:
    """The page keeps the same element when a window grows, and may put the canvas into it."""
    stage.page.evaluate(
        """() => document.querySelector("canvas").parentElement.insertAdjacentHTML("beforebegin",
        '<div id="drawer" style="position: fixed; bottom: 0; height: 40px"></div>')"""
    )
    drawer, marked = stage.page.locator("#drawer"), stage.page.locator("[data-tsd-drawer]")
    overlay = stage.page.locator("#tsd-overlay[data-tsd-drawer]")
    stage.resize(844, 390)
    stage.resize(520, 390)
    expect(drawer).to_have_attribute("data-tsd-drawer", "")
    expect(overlay).to_have_count(0)  # Though it is fixed at the bottom, too.
    drawer.evaluate("(drawer) => drawer.append(document.querySelector('canvas').parentElement)")
    expect(drawer).not_to_have_attribute("data-tsd-drawer", "")
    stage.resize(1280, 720)
    expect(marked).to_have_count(0)


def test_what_the_robot_has_learned_is_shown_with_its_standard_deviation(stage: PageStage) -> None:
    stage.page.evaluate("document.querySelector('aside').style.width = '320px'")
    learned = {
        "module1_wheel_share": {"value": 0.012, "sigma": 0.0015},
        "creep_x_mps": {"value": 0.0005, "sigma": 0.00025},
        "gyro_bias_rad_per_s": {"value": 0.00035, "sigma": 0.00012},
    }
    table = stage.page.get_by_role("table", name="Learned while driving")
    expect(table).to_have_count(0)
    stage.show(state(status={"learned": learned}))
    for name, figures in (
        ("module1 wheel", "1.20 ± 0.15 %"),
        ("creep x", "0.50 ± 0.25 mm/s"),
        ("gyro bias", "0.020 ± 0.007 °/s"),
    ):
        expect(table.get_by_role("row").filter(has_text=name)).to_contain_text(figures)


@pytest.mark.parametrize(("contents", "clicks"), [("block", 1), ("none", 0)])
def test_an_open_drawer_is_folded_also_before_its_contents_are_there(
    stage: PageStage, contents: str, clicks: int
) -> None:
    stage.page.evaluate(
        """(display) => document.querySelector("canvas").parentElement.insertAdjacentHTML(
        "beforebegin", `<div id="drawer" style="position: fixed; bottom: 0">
        <div style="cursor: pointer; height: 40px" onclick="drawer.append('clicked')"></div>
        <div style="display: ${display}"></div></div>`)""",
        contents,
    )
    stage.resize(520, 390)
    drawer = stage.page.locator("#drawer")
    expect(drawer).to_have_attribute("data-tsd-drawer", "")
    expect(drawer).to_have_text("clicked" * clicks)


def test_health_asks_for_the_shadow_twin_while_it_is_shown_and_says_what_it_names(
    stage: PageStage,
) -> None:
    joints = [
        {"name": "module1_alpha", "unit": "°", "measured": 1.0, "simulated": 1.5, "band": 0.2}
        | {"inside": False},
        {"name": "module1_beta", "unit": "°", "measured": 2.0, "simulated": 1.95, "band": 0.2}
        | {"inside": True},
        {"name": "module1_wheel", "unit": "rpm", "measured": None, "simulated": 2500.0}
        | {"band": 90.0, "inside": True},
    ]
    pose = {"names": ["ahead", "left", "heading"], "units": ["mm", "mm", "°"], "inside": False}
    pose |= {"difference": [12.0, -3.0, 4.0], "band": [20.0, 20.0, 2.0]}
    drifts = [{"part": "module1_alpha", "text": "The servo of module 1 alpha follows 30 % slower."}]
    shadow = {"compared_s": 61.0, "joints": joints, "pose": pose, "drifts": drifts, "note": "N"}
    stage.show(state(shadow=shadow))
    table = stage.page.get_by_role("table", name="Measured minus simulated", include_hidden=True)
    for text in (
        "module1 alpha−0.50 of ±0.20 °, outside",
        "module1 beta0.05 of ±0.20 °",
        "module1 wheelnot measured",
        "motion ahead12 of ±20 mm",
        "motion heading4.00 of ±2.00 °, outside",
        "compared for61 s",
    ):
        expect(table).to_contain_text(text)
    expect(table.locator("tr[data-suspect]")).to_have_count(2)
    expect(stage.page.get_by_text("follows 30 % slower.")).to_have_count(1)
    assert {"t": "shadow", "on": True} in stage.sent("shadow")
    stage.show(state(shadow=None))
    expect(table).to_have_count(0)
