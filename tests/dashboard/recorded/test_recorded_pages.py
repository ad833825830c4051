"""Pages that show a recording can seek and cannot drive; STOP acts on live robots."""

from __future__ import annotations

import http.client
import json
import shutil
import time
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode

from tests.support.page_client import Page, Site, site
from tests.support.recorded_drives import START_NS, recorded_circle
from tests.support.withheld import PATIENCE_S, Stopwatch
from tsd_twin.dashboard.gateway.socket_limits import GRACE, POLICY_VIOLATION, TELEOP
from tsd_twin.recording.events import read_marks
from tsd_twin.recording.player import Player

NAME = "drive.mcap"
TOO_MANY = round((1.0 + GRACE) * TELEOP.messages.burst) + 100
COMMANDS: list[dict[str, Any]] = [
    {"t": "drive", "vx": 0.2, "vy": 0.0, "omega": 0.0, "status_seq": 1},
    {"t": "lease", "op": "acquire", "take_over": True},
    {"t": "arm"},
    {"t": "reset"},
    {"t": "wheel_speed", "cruise_speed_rpm": 2000.0},
    {"t": "plan", "kind": "to", "points": [[1.0, 0.0]], "on": "floor"},
    {"t": "follow_plan", "route": 1, "status_seq": 1},
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("drives")
    recorded_circle(made / NAME, 6)
    shutil.copy(made / NAME, made.parent / "outside.mcap")
    (made / "notes.mcap").write_text("not a recording")
    return made


@pytest.fixture(scope="module")
def served(folder: Path) -> Generator[Site]:
    with site(recordings=folder) as made:
        yield made


@pytest.fixture
def page(served: Site) -> Generator[Page]:
    with served.page("00000000000000aa", recording=NAME) as opened:
        opened.until(lambda: opened.last("timeline"))
        yield opened


def seek(page: Page, t_s: float) -> dict[str, Any]:
    """Seek to a time and return the state shown there."""
    page.send(t="seek", t_s=t_s)
    page.until(lambda: abs(page.last("cursor")["t_s"] - t_s) < 1e-3)
    count = len(page.all("state"))
    page.until(lambda: len(page.all("state")) > count)
    return page.state


def test_the_page_gets_the_recording_in_place_of_a_robot(page: Page) -> None:
    welcome, timeline = page.last("welcome"), page.last("timeline")
    assert (welcome["role"], welcome["may_stop"]) == ("viewer", True)
    assert [robot["id"] for robot in welcome["robots"]] == ["tsd"]
    assert page.last("robot")["panel"] == "gimbals"
    assert timeline["name"] == NAME
    assert timeline["start_ms"] == START_NS // 1_000_000
    assert [event["kind"] for event in timeline["events"]] == ["hand-over"]


def test_a_seek_shows_the_recorded_state_of_that_time(page: Page, folder: Path) -> None:
    player = Player(folder / NAME)
    random = np.random.default_rng(4)
    for t_s in [*random.uniform(0.1, player.duration_s, size=12), player.duration_s]:
        state = seek(page, round(float(t_s), 3))
        player.seek(round(float(t_s), 3))
        snapshot = player.robots["tsd"].snapshot
        assert snapshot.odom is not None
        assert snapshot.status is not None
        assert state["pose"] == pytest.approx(snapshot.odom.xy_heading, abs=1e-4)
        assert state["status"]["mode"] == snapshot.status.mode
        assert state["robot_s"] == pytest.approx(snapshot.status_robot_s, abs=1e-5)
        assert state["age_ms"] < 60.0
        assert state["has_control"] is False
    player.close()


def test_it_plays_pauses_and_steps(page: Page) -> None:
    seek(page, 1.0)
    assert page.last("cursor")["playing"] is False
    page.send(t="play", speed=4.0)
    page.until(lambda: any(each["t_s"] > 2.0 and each["playing"] for each in page.all("cursor")))
    page.send(t="pause")
    page.until(lambda: not page.last("cursor")["playing"])
    before = seek(page, 3.0)["robot_s"]
    page.send(t="step", back=False)
    page.until(lambda: page.state["robot_s"] == pytest.approx(before + 0.05, abs=0.02))
    page.send(t="step", back=True)
    page.until(lambda: page.state["robot_s"] == pytest.approx(before, abs=0.001))
    page.send(t="seek", t_s=1e5)
    page.until(lambda: page.last("cursor")["t_s"] > 6.0)


def test_nothing_that_moves_a_robot_is_passed_on(page: Page, served: Site) -> None:
    for command in COMMANDS:
        reply = page.answer(command["t"], **command)
        assert reply["ok"] is False
        assert reply["why"]["code"] == "recording_shown"
    time.sleep(0.3)
    status = served.link.snapshot.status
    assert status is not None
    assert status.lease.holder is None
    assert status.command.accepted == 0
    assert sum(vars_of(status.command.dropped)) == 0
    assert status.mode == "disarmed"


def vars_of(struct: Any) -> list[int]:
    return [getattr(struct, name) for name in struct.__struct_fields__]


def test_a_page_with_a_recording_lists_the_live_robots_and_stops_one_of_them(
    page: Page, served: Site
) -> None:
    page.send(t="fleet", on=True)
    listed = page.until(lambda: page.last("fleet")["robots"])
    assert [(each["id"], each["source"]) for each in listed] == [("tsd", "robot")]
    page.send(t="stop", robot="tsd")
    page.until(lambda: page.last("stop_result")["outcome"] == "acknowledged")
    assert served.link.snapshot.status is not None
    assert served.link.snapshot.status.mode == "stopped"
    page.until(lambda: page.last("fleet")["robots"] and page.last("fleet")["robots"][0]["latched"])


def test_stop_acts_on_the_live_robots_while_a_recording_plays(page: Page, served: Site) -> None:
    with served.page("00000000000000bb") as live:
        live.make_ready()
        page.send(t="play", speed=1.0)
        live.drive(0.2)
        assert page.answer("stop", t="stop")["ok"]
        live.until(lambda: live.mode == "stopped")
        live.until(lambda: live.answer("reset", t="reset")["ok"])  # After 0.5 s.
        live.until(lambda: live.mode == "disarmed")
    page.send(t="pause")


def test_a_mark_is_kept_with_the_recording_and_shown(page: Page, folder: Path) -> None:
    page.send(t="pause")
    seek(page, 2.5)
    assert page.answer("mark", t="mark", note="it slipped <here>")["ok"]
    (mark,) = read_marks(folder / NAME)
    assert (mark.note, mark.log_ns) == ("it slipped <here>", START_NS + 2_500_000_000)
    shown = page.until(lambda: [e for e in page.last("timeline")["events"] if e["kind"] == "mark"])
    assert shown[0]["t_s"] == pytest.approx(2.5)
    page.send(t="mark", note=201 * "x")
    page.until(lambda: page.last("reply")["to"] == "message")


def test_five_pages_seek_at_once_and_each_has_its_state_soon(served: Site) -> None:
    """The sixth page exceeds the limit of five."""
    pages = [Page(served.port, f"{i:016x}", recording=NAME) for i in range(1, 6)]
    try:
        for page in pages:
            page.until(lambda p=page: p.last("timeline"))
        with pytest.raises(InvalidStatus) as refused:
            Page(served.port, "00000000000000ff", recording=NAME)
        assert refused.value.response.status_code == 503
        taken_s: list[float] = []
        for t_s in np.random.default_rng(1).uniform(0.1, 6.0, size=20).round(3).tolist():
            for page in pages:
                watch = Stopwatch()
                page.send(t="seek", t_s=t_s)
                page.until(lambda p=page, t=t_s: abs(p.last("cursor")["t_s"] - t) < 1e-3)
                taken_s.append(watch.took_s)
        assert float(np.median(taken_s)) < 0.5
    finally:
        for page in pages:
            page.close()


def test_the_map_follows_the_cursor(page: Page, folder: Path) -> None:
    page.send(t="map", on=True)
    for t_s in (2.0, 5.0):
        state = seek(page, t_s)
        (robot,) = state["map"]["robots"]
        np.testing.assert_allclose(robot["pose"], state["pose"], atol=1e-4)
        assert (robot["id"], robot["stale"]) == ("tsd", False)
        # The path before the new cursor, not before the old one.
        page.until(
            lambda here=robot["pose"][:2]: np.allclose(
                page.last("map_lines")["trails"]["tsd"][-1], here, atol=0.15
            )
        )
    player = Player(folder / NAME)
    (start,) = [player.robots["tsd"].snapshot.odom]
    assert start is not None
    np.testing.assert_allclose(
        page.last("map_lines")["trails"]["tsd"][0], start.xy_heading[:2], atol=0.1
    )
    player.close()
    page.send(t="map", on=False)
    page.until(lambda: page.state["map"] is None)


def test_its_health_tab_has_no_shadow_twin_and_is_not_refused(page: Page) -> None:
    before = len(page.all("reply"))
    page.send(t="shadow", on=True)
    assert seek(page, 3.0)["shadow"] is None
    assert len(page.all("reply")) == before


@pytest.mark.parametrize("kind", ["seek", "mark"])
def test_a_page_that_floods_is_cut_off_and_another_goes_on(
    page: Page, served: Site, folder: Path, kind: str
) -> None:
    marks = len(read_marks(folder / NAME))
    text = {"seek": '{"t":"seek","t_s":1.5}', "mark": '{"t":"mark","note":"again"}'}[kind]
    data = Frame(Opcode.TEXT, text.encode()).serialize(mask=True)
    with served.page(f"{len(kind) + ord(kind[0]):016x}", recording=NAME) as flooding:
        flooding.until(lambda: flooding.last("timeline"))
        flooding.send_together(data * TOO_MANY)
        assert flooding.until(lambda: flooding.closed) == POLICY_VIOLATION
    assert len(read_marks(folder / NAME)) - marks <= TELEOP.kinds["mark"].burst
    assert seek(page, 3.0)["pose"]


def test_a_page_that_scrubs_faster_than_it_may_is_not_cut_off(page: Page) -> None:
    data = Frame(Opcode.TEXT, b'{"t":"seek","t_s":1.5}').serialize(mask=True)
    page.send_together(data * 200)
    time.sleep(2.0)  # The quota has recovered.
    assert seek(page, 2.0)["pose"]
    assert page.closed is None


@pytest.mark.parametrize("name", ["missing.mcap", "notes.mcap", "..%2foutside.mcap", ".", "%00"])
def test_what_is_no_recording_of_the_folder_is_not_shown(served: Site, name: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        Page(served.port, "00000000000000cc", recording=name)
    assert refused.value.response.status_code == 404


def get(served: Site, path: str) -> tuple[int, Any]:
    with closing(http.client.HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE_S)) as one:
        one.request("GET", path)
        answer = one.getresponse()
        body = answer.read()
    whole = answer.headers["Content-Type"] == "application/json"
    return answer.status, json.loads(body) if whole else body


def test_the_list_has_what_can_be_shown(served: Site) -> None:
    status, (listed,) = get(served, "/recordings")
    assert status == 200
    assert (listed["name"], listed["robots"]) == (NAME, ["tsd"])
    assert listed["duration_s"] > 6.0


def test_the_picture_of_a_recording_is_the_way_that_the_robot_went(
    served: Site, folder: Path
) -> None:
    status, (path,) = get(served, f"/recordings/{NAME}/path")
    assert (status, path["robot"], len(path["points"])) == (200, "tsd", 65)
    player = Player(folder / NAME)
    for share in (0.0, 0.5, 1.0):
        player.seek(share * player.duration_s)
        odom = player.robots["tsd"].snapshot.odom
        assert odom is not None
        shown = path["points"][round(share * 64)]
        np.testing.assert_allclose(shown, odom.xy_heading[:2], atol=1e-3)
    player.close()
    for name in ("missing.mcap", "notes.mcap", "..%2foutside.mcap"):
        assert get(served, f"/recordings/{name}/path")[0] == 404


def test_the_last_half_minute_of_a_live_robot_is_shown_on_request(served: Site) -> None:
    with served.page("00000000000000dd") as live:
        live.make_ready()
        live.drive(0.2, omega=0.3)
        began = live.state["robot_s"]
        live.until(lambda: live.state["robot_s"] > began + 1.5)
        assert live.state["past"] is None
        live.send(t="look_back", history_offset_s=1.0)
        live.until(lambda: live.state["past"])
        now = next(state for state in live.all("state") if state["past"])
        past, states = now["past"], live.all("state")
        assert (past["history_offset_s"], past["mode"]) == (1.0, "driving")
        # Between two states, because a busy machine sends few.
        times_s = [state["robot_s"] for state in states]
        poses = np.transpose([state["pose"] for state in states])
        then = [np.interp(now["robot_s"] - 1.0, times_s, values) for values in poses]
        np.testing.assert_allclose(past["pose"], then, atol=0.06)
        assert np.hypot(*np.subtract(past["pose"], now["pose"])[:2]) > 0.1
        live.send(
            t="look_back", history_offset_s=29.0
        )  # The page or the site was closed at that time.
        live.send(t="look_back", history_offset_s=None)
        live.until(lambda: live.state["past"] is None)
        for wrong in (31.0, 0.0, -1.0, "x"):
            live.send(t="look_back", history_offset_s=wrong)
        live.until(lambda: live.last("reply")["to"] == "message")
        assert live.state["past"] is None
