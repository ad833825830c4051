"""Planned paths over real sockets, a real bus and a real node, driven as by a page."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.dashboard.recorders import CommandRecorder, settle
from tests.support.page_client import Page, Site, site
from tests.support.scene_doubles import EmptyScene, RobotFeed
from tests.support.withheld import WithheldTime
from tsd_twin import robots
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene.picking import MAX_DISTANCE_M, floor_points
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.sessions.navigation import NavigationSession
from tsd_twin.dashboard.wire.from_page import MAX_POINTS, PlanRequest
from tsd_twin.dashboard.wire.to_page import ActionReply, RouteState
from tsd_twin.errors import PathError
from tsd_twin.lie import SO3
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.status import Refusals, RobotStatus, WheelSpeedStatus
from tsd_twin.motion.obstacles import Disc
from tsd_twin.motion.tracking import ExecutionPhase, ExecutionStep

THERE_M = 0.05
ROLLS_M = 0.2


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


def plan(page: Page, *points: tuple[float, float], kind: str = "to", **more: Any) -> dict[str, Any]:
    """Plan a path from the robot's pose, and wait until it can be driven."""
    x, y, _ = page.state["pose"]
    ahead = [[x + px, y + py] for px, py in points]
    assert page.answer("plan", t="plan", kind=kind, points=ahead, on="floor", **more)["ok"]
    return page.until(lambda: planned(page))


def planned(page: Page) -> dict[str, Any] | None:
    route = page.state["route"]
    return route if route is not None and route["phase"] == "planned" else None


def hold(page: Page, route: dict[str, Any]) -> None:
    page.holds = {"t": "follow_plan", "route": route["number"]}


def let_go(page: Page) -> None:
    page.holds = None
    page.send(t="release")


def go(page: Page, until: Callable[[], bool]) -> dict[str, Any]:
    """Hold the button until a condition holds, and return the path."""
    route = page.until(lambda: planned(page))
    before = len(page.all("released"))
    assert route is not None
    hold(page, route)
    page.until(lambda: until() or len(page.all("released")) > before)
    assert until(), page.last("released")
    return route


def midway(page: Page) -> Callable[[], bool]:
    return lambda: page.mode == "driving" and page.state["route"]["done_m"] > 0.1


def arrived(page: Page) -> Callable[[], bool]:
    return lambda: page.state["route"]["phase"] == "arrived"


def apart_m(page: Page, goal: tuple[float, float]) -> float:
    return math.dist(page.state["pose"][:2], goal)


def goal_of(page: Page, ahead: tuple[float, float]) -> tuple[float, float]:
    return page.state["pose"][0] + ahead[0], page.state["pose"][1] + ahead[1]


def test_held_the_robot_arrives_stops_and_does_nothing_more(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        goal = goal_of(page, (0.4, -0.2))
        route = plan(page, (0.4, -0.2), heading=0.4)
        assert route["length_m"] == pytest.approx(math.hypot(0.4, 0.2), abs=0.01)
        commands = CommandRecorder(served, page)
        go(page, arrived(page))
        page.until(lambda: page.mode == "ready")
        assert apart_m(page, goal) < THERE_M
        assert page.state["pose"][2] == pytest.approx(0.4, abs=0.1)
        assert page.state["route"]["off_mm"] < 1000.0 * THERE_M
        sent = commands.take()
        seen = {state["status_seq"] for state in page.all("state")}
        assert {command.status_seq for command in sent if command.twist.any()} <= seen
        assert commands.is_put_to_rest(sent)
        settle(page)  # The button is still held.
        assert commands.take() == []
        let_go(page)


def test_a_line_that_is_drawn_is_driven_to_its_end(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        line = [(0.02 * i, 0.1 * math.sin(0.3 * i)) for i in range(1, 20)]
        goal = goal_of(page, line[-1])
        plan(page, *line, kind="draw")
        go(page, arrived(page))
        assert apart_m(page, goal) < THERE_M
        let_go(page)


def test_let_go_on_the_way_it_stands_and_goes_on_only_when_held_anew(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        goal = goal_of(page, (-0.9, 0.0))
        plan(page, (-0.9, 0.0))
        commands = CommandRecorder(served, page)
        route = go(page, midway(page))
        with WithheldTime() as withheld:
            at = page.state["pose"]
            let_go(page)
            page.until(lambda: page.mode == "ready")
        assert commands.is_put_to_rest()
        rolls_m = ROLLS_M + page.state["status"]["limits"]["speed_mps"] * withheld.total_s
        assert math.dist(at[:2], page.state["pose"][:2]) < rolls_m
        left = page.until(lambda: planned(page))
        assert left["number"] > route["number"]
        assert left["length_m"] == pytest.approx(apart_m(page, goal), abs=0.02)
        hold(page, route)  # The earlier path.
        page.until(lambda: page.last("released")["why"]["code"] == Code.PATH_NO_LONGER_PLANNED)
        settle(page)
        assert not any(command.twist.any() for command in commands.take())
        let_go(page)
        go(page, arrived(page))
        assert apart_m(page, goal) < THERE_M
        let_go(page)


def test_a_new_path_ends_the_motion_along_the_old_one(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        plan(page, (-0.9, 0.0))
        route = go(page, midway(page))
        commands = CommandRecorder(served, page)
        assert plan(page, (0.5, 0.5))["number"] > route["number"]  # The button is still held.
        assert page.last("released")["why"]["code"] == Code.PATH_REPLANNED
        page.until(lambda: page.mode == "ready")
        assert commands.is_put_to_rest()
        settle(page)
        assert commands.take() == []
        let_go(page)


def lose_focus(page: Page) -> None:
    page.focus = False


def fall_silent(page: Page) -> None:
    page.holds = None


def stop(page: Page) -> None:
    page.send(t="stop")


def give_control_back(page: Page) -> None:
    page.send(t="lease", op="release")


def give_up(page: Page) -> None:
    page.send(t="clear_plan")


@pytest.mark.parametrize("end", [lose_focus, fall_silent, stop, give_control_back, give_up])
def test_whatever_ends_a_drive_ends_the_way(served: Site, end: Any) -> None:
    with served.page() as page:
        page.make_ready()
        plan(page, (0.9, 0.0))
        commands = CommandRecorder(served, page)
        go(page, midway(page))
        before = len(page.all("released"))
        end(page)
        page.until(lambda: len(page.all("released")) > before or page.mode != "driving")
        page.until(lambda: page.mode in ("ready", "stopped", "disarmed"))
        page.until(lambda: abs(page.state["twist"][0]) < 0.01)
        sent = commands.take()
        assert commands.is_put_to_rest(sent)
        settle(page)  # A hold message from a page no longer has an effect.
        assert commands.take() == []
        page.focus = True
        let_go(page)


def test_hands_on_the_stick_end_the_way_and_drive(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        plan(page, (0.9, 0.0))
        go(page, midway(page))
        page.drive(0.0, -0.2, 0.0)
        page.until(lambda: page.state["route"] is None)
        page.until(lambda: np.allclose(page.state["commanded"], [0.0, -0.2, 0.0], atol=0.02))
        let_go(page)


def test_without_control_nothing_is_planned_and_with_it_lost_it_is_forgotten(served: Site) -> None:
    with served.page() as page, served.page("fedcba9876543210") as other:
        page.make_ready()
        plan(page, (0.5, 0.0))
        wish = {"t": "plan", "kind": "to", "points": [[1.0, 0.0]], "on": "floor"}
        assert other.answer("plan", **wish)["why"]["code"] == "take_control_first"
        assert other.state["route"] is None
        assert other.take(take_over=True)["ok"]
        page.until(lambda: page.state["route"] is None)


def test_a_stop_on_another_page_ends_the_way(served: Site) -> None:
    with served.page() as page, served.page("fedcba9876543210") as other:
        page.make_ready()
        plan(page, (0.9, 0.0))
        route = go(page, midway(page))
        assert other.answer("stop", t="stop")["ok"]
        page.until(lambda: page.mode == "stopped" and page.state["route"] is None)
        let_go(page)
        page.make_ready()
        commands = CommandRecorder(served, page)
        hold(page, route)
        page.until(lambda: page.last("released")["why"]["code"] == Code.PATH_NO_LONGER_PLANNED)
        settle(page)
        assert not any(command.twist.any() for command in commands.take())
        let_go(page)


def test_a_level_that_is_changed_times_the_way_anew(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        fast = plan(page, (0.9, 0.0), level=100)
        page.send(t="speed_level", level=20)
        slow = page.until(lambda: (r := planned(page)) and r["number"] > fast["number"] and r)
        assert slow["length_m"] == fast["length_m"]
        assert slow["time_s"] > 2.0 * fast["time_s"]


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"points": [[0.0, 9000.0]]}, Code.PATH_TOO_LONG),
        ({"on": "picture"}, Code.PATH_NOT_ON_FLOOR),
    ],
)
def test_what_cannot_be_planned_is_refused_with_a_reason(
    served: Site, changed: dict[str, Any], code: Code
) -> None:
    with served.page() as page:
        page.make_ready()
        wish = {"t": "plan", "kind": "to", "points": [[0.5, 0.5]], "on": "floor"} | changed
        page.send(**wish)
        page.until(lambda: any(code_of(r) == code for r in page.all("reply")))
        page.until(lambda: page.state["route"] is None)


@pytest.mark.parametrize(
    "garbage",
    [
        {"points": []},
        {"points": [[0.0, 0.0]] * (MAX_POINTS + 1)},
        {"points": [[0.0]]},
        {"points": [[0.0, 1e5]]},
        {"points": [[0.0, "1"]]},
        {"heading": 1e9},
        {"level": 0},
        {"level": 101},
        {"kind": "fly"},
        {"on": "moon"},
    ],
)
def test_wishes_that_are_none_are_counted(served: Site, garbage: dict[str, Any]) -> None:
    wish = {"t": "plan", "kind": "to", "points": [[0.5, 0.5]], "on": "floor"} | garbage
    raw = [
        json.dumps(wish),
        json.dumps(wish).replace("1e5", "NaN"),
        '{"t": "follow_plan", "route": 1}',
    ]
    with served.page() as page:
        page.until(lambda: page.state)
        before = served.sessions.rejected
        for text in raw:
            page.send_raw(text)
        page.until(lambda: served.sessions.rejected == before + len(raw))


# Without a bus: tests control content and timing of the robot's messages.


class Desk:
    """Navigation session with a robot whose messages the test controls."""

    def __init__(self) -> None:
        self.feed = RobotFeed(robot=robots.load_robot("tsd"))
        self.answers: list[ActionReply] = []
        scene = EmptyScene()
        self.discs: list[Disc] = []
        self.going = NavigationSession(
            "page",
            RpcExecutor(),
            scene.pick_floor,
            scene.show_route,
            self.answers.append,
            lambda _link: self.discs,
        )
        self.say(0.0, 100.0)

    def step(self, number: int, now_s: float, feed: RobotFeed | None = None) -> ExecutionStep:
        """Hold the button for the controlled robot."""
        return self.going.step(cast(RobotMonitor, feed or self.feed), number, 0.25, now_s)

    def say(
        self,
        x: float,
        odom_s: float,
        mode: str = "ready",
        rpm: float = 2500.0,
        refusals: Refusals | None = None,
    ) -> None:
        status = RobotStatus(mode, refusals=refusals, wheel_speed=WheelSpeedStatus(rpm, rpm))
        self.feed.say(pose=np.array([x, 0.0, 0.0]), status=status)
        self.feed.snapshot = replace(self.feed.snapshot, odom_received_s=odom_s)

    def request_plan(self, heading: float | None = None) -> None:
        wish = PlanRequest(kind="to", points=[(2.0, 0.0)], on="floor", heading=heading)
        self.going.request_plan(cast(RobotMonitor, self.feed), wish)

    async def plan(self) -> int:
        self.request_plan()
        return (await self.planned()).number

    async def planned(self) -> RouteState:
        """Wait for a plan."""
        while (shown := self.going.route_state) is None or shown.phase != "planned":
            self.going.update()
            await asyncio.sleep(0.01)
        return shown


def test_a_pose_that_is_older_than_a_command_may_be_ends_it_also_while_other_news_comes() -> None:
    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        assert desk.step(number, 100.1).twist is not None
        desk.say(0.0, 100.0, "driving")
        with pytest.raises(PathError, match="not sent its pose"):
            desk.step(number, 100.26)

    asyncio.run(run())


@pytest.mark.parametrize(
    ("x", "mode", "rpm", "word"),
    [
        (0.1, "ready", 2500.0, "new path"),
        (0.0, "ready", 1500.0, "new path"),
        (0.0, "driving", 2500.0, "not at rest"),
    ],
)
def test_it_begins_only_where_it_was_planned_to_in_the_same_gear_and_from_rest(
    x: float, mode: str, rpm: float, word: str
) -> None:
    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        desk.say(x, 100.0, mode, rpm)
        with pytest.raises(PathError, match=word):
            desk.step(number, 100.1)

    asyncio.run(run())


def test_a_way_that_was_planned_for_one_robot_moves_no_other() -> None:
    """Nor a robot of the same name, because a robot that reconnects has a new link."""

    async def run() -> None:
        desk, other = Desk(), Desk()
        number = await desk.plan()
        with pytest.raises(PathError, match="no longer"):
            desk.step(number, 100.1, other.feed)
        assert not desk.going.is_following
        assert desk.step(number, 100.1).phase is ExecutionPhase.GOING
        with pytest.raises(PathError, match="no longer"):
            desk.step(number, 100.12, other.feed)

    asyncio.run(run())


@pytest.mark.parametrize("mode", ["stopped", "fault"])
@pytest.mark.parametrize("holds", [False, True])
def test_a_stop_by_anybody_ends_the_way_and_until_the_reset_there_is_no_other(
    mode: str, holds: bool
) -> None:
    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        if holds:
            desk.step(number, 100.1)
        desk.say(0.0, 100.2, mode)
        desk.going.pause()
        desk.going.update()
        assert desk.going.route_state is None
        desk.say(0.0, 100.3, "ready")
        desk.going.update()
        with pytest.raises(PathError, match="no longer"):
            desk.step(number, 100.4)
        desk.say(0.0, 100.5, mode)
        desk.request_plan()
        assert desk.answers[-1] == refused(because(Code.MODE_ONLY, mode=mode))
        desk.say(0.0, 100.6, mode, refusals=Refusals.of({"drive": LOOSE}))
        desk.request_plan()
        assert desk.answers[-1] == refused(LOOSE)
        assert desk.going.route_state is None

    asyncio.run(run())


def test_let_go_of_a_moment_before_the_end_the_robot_has_arrived() -> None:
    """The remaining path is too short to plan, which is not an error."""

    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        desk.step(number, 100.1)
        desk.say(1.998, 100.2, "driving")
        desk.going.pause()
        desk.going.update()
        shown = desk.going.route_state
        assert shown is not None
        assert shown.phase == "planning"
        desk.say(1.998, 100.3)
        desk.going.update()
        shown = desk.going.route_state
        assert shown is not None
        assert (shown.number, shown.phase, shown.off_mm) == (number, "arrived", 2.0)
        assert all(answer.ok for answer in desk.answers)

    asyncio.run(run())


def test_a_heading_that_is_no_number_is_refused_in_words() -> None:
    async def run() -> None:
        desk = Desk()
        desk.feed.say(pose=np.array([0.0, 0.0, math.nan]))
        desk.request_plan(heading=1.0)
        while not desk.answers or desk.answers[-1].ok:
            desk.going.update()
            await asyncio.sleep(0.01)
        assert desk.answers[-1].why == because(Code.PATH_NOT_FINITE)

    asyncio.run(run())


# The scene.

turns = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(
    place=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    eye=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.3, 3.0)),
    off=turns,
    view_rad=st.floats(0.3, 1.5),
    aspect=st.floats(0.4, 2.5),
)
def test_the_place_that_is_seen_somewhere_is_found_there(
    place: tuple[float, float],
    eye: tuple[float, float, float],
    off: tuple[float, float, float],
    view_rad: float,
    aspect: float,
) -> None:
    """Project by a textbook pinhole camera and back."""
    target, position = np.array([*place, 0.0]), np.array(eye)
    # A camera that looks almost at the point: z ahead, y down.
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0.1, 0.2, 1.0])
    right /= np.linalg.norm(right)
    frame = (
        np.stack([right, np.cross(ahead, right), ahead], axis=1)
        @ SO3.exp(0.1 * np.array(off)).as_matrix()
    )
    x, y, z = frame.T @ (target - position)
    height = 2.0 * math.tan(0.5 * view_rad)
    share = np.array([[0.5 + x / z / (height * aspect), 0.5 + y / z / height]])
    met = floor_points(position, quaternion(frame), view_rad, aspect, share)
    np.testing.assert_allclose(met, [place], atol=1e-6)


def quaternion(frame: Any) -> Any:
    """Convert a rotation matrix to a quaternion by its eigenvector."""
    values, vectors = np.linalg.eig(frame)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1.0))])
    cosine = 0.5 * (np.trace(frame) - 1.0)
    skew = np.array(
        [frame[2, 1] - frame[1, 2], frame[0, 2] - frame[2, 0], frame[1, 0] - frame[0, 1]]
    )
    angle = math.atan2(0.5 * float(axis @ skew), cosine)
    return np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis)])


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_line_that_leaves_the_floor_ends_there_and_what_is_no_camera_shows_none(
    broken: float,
) -> None:
    down = np.array([0.0, 1.0, 0.0, 0.0])  # Half a turn about x: straight down.
    level = np.array([math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0])
    shares = np.array([[0.5, 0.9], [0.5, 0.6], [0.5, 0.4], [0.5, 0.9]])
    above = np.array([0.0, 0.0, 1.0])
    assert len(floor_points(above, down, 0.8, 1.5, shares)) == 4
    met = floor_points(above, level, 0.8, 1.5, shares)
    assert len(met) == 2
    assert (np.hypot(*met.T) < MAX_DISTANCE_M).all()
    for eye in (
        (np.array([0.0, broken, 1.0]), down, 0.8, 1.5),
        (above, np.full(4, broken), 0.8, 1.5),
        (above, down, broken, 1.5),
        (above, down, 0.8, broken),
    ):
        assert len(floor_points(*eye, shares)) == 0


LOOSE = because(Code.HARDWARE, text="the wheels are loose")


def refused(why: Reason) -> ActionReply:
    return ActionReply(to="plan", ok=False, why=why)


def code_of(reply: dict[str, Any]) -> str:
    return reply["why"]["code"] if reply["why"] else ""


def test_a_robot_that_comes_onto_the_path_ends_the_motion_and_the_rest_leads_around_it() -> None:
    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        desk.discs = [Disc("kiwi", (1.5, 0.0), 0.3)]  # Beyond the distance in which it stops.
        assert desk.step(number, 100.1).phase is ExecutionPhase.GOING
        desk.discs = [Disc("kiwi", (0.5, 0.0), 0.3)]
        with pytest.raises(PathError) as refused:
            desk.step(number, 100.15)
        assert refused.value.why == because(Code.PATH_BLOCKED, robot="kiwi")
        desk.going.pause()  # As after every refusal.
        desk.say(0.0, 100.2)
        planned = await desk.planned()
        assert planned.number > number
        assert 2.02 < planned.length_m < 2.3

    asyncio.run(run())


def test_a_plan_that_another_robot_blocks_while_it_waits_is_replaced() -> None:
    async def run() -> None:
        desk = Desk()
        number = await desk.plan()
        desk.discs = [Disc("kiwi", (1.0, 0.1), 0.3)]
        desk.going.update()
        planned = await desk.planned()
        assert planned.number > number
        assert planned.length_m > 2.005
        desk.discs = [Disc("kiwi", (2.0, 0.1), 0.3)]
        while not desk.answers or desk.answers[-1].ok:
            desk.going.update()
            await asyncio.sleep(0.01)
        assert desk.answers[-1].why == because(Code.PATH_BLOCKED, robot="kiwi")

    asyncio.run(run())
