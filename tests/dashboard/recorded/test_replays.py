"""Replays on the bus are not robots: STOP ignores them, and a shared id is refused."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.page_client import Page, Site, robot_on_a_bus
from tests.support.recorded_drives import replaying, stopped_drive
from tests.support.robot_node import ANY_PORT
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.messages import topics
from tsd_twin.messages.events import duplicate_id_text
from tsd_twin.messages.status import RobotStatus, decode_status

SHARED = duplicate_id_text("tsd")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stopped_drive(tmp_path_factory.mktemp("drives") / "drive.mcap")


@dataclass
class TwoBuses:
    """A live robot `tsd` on one bus, another bus, and a dashboard that joins both."""

    served: Site
    live: Bus
    other: Bus
    heard: list[RobotStatus]
    """Statuses on the bus of the live robot."""

    @property
    def mode(self) -> str:
        return self.heard[-1].mode


@contextmanager
def two_buses() -> Generator[TwoBuses]:
    with robot_on_a_bus() as endpoint, Bus(node_config([ANY_PORT])) as other:
        joined = [endpoint, *other.endpoints()]
        with Bus(client_config([endpoint])) as live, Bus(client_config(joined)) as bus:
            heard: list[RobotStatus] = []
            live.subscribe(topics.STATUS.key("tsd"), lambda s: heard.append(_status(s.payload)))
            served = Site(bus, 1, None)
            try:
                yield TwoBuses(served, live, other, heard)
            finally:
                served.close()


def _status(payload: bytes) -> RobotStatus:
    return decode_status(payload)


@pytest.fixture
def both() -> Generator[TwoBuses]:
    with two_buses() as made:
        yield made


def shows(page: Page, robot_id: str, source: str) -> bool:
    return page.last("robot")["id"] == robot_id and page.state["source"] == source


def test_stop_with_a_replay_in_view_stops_the_live_robot(both: TwoBuses, recorded: Path) -> None:
    with (
        replaying(both.other, recorded, "tsd-replay"),
        both.served.page("00000000000000aa") as driver,
        both.served.page("00000000000000bb") as viewer,
    ):
        driver.send(t="robot", id="tsd")
        driver.until(lambda: shows(driver, "tsd", "robot"))
        driver.make_ready()
        viewer.until(lambda: {r["id"] for r in viewer.last("welcome")["robots"]} >= {"tsd-replay"})
        viewer.send(t="robot", id="tsd-replay")
        viewer.until(lambda: shows(viewer, "tsd-replay", "recording"))
        assert viewer.answer("stop", t="stop") == {
            "t": "reply",
            "to": "stop",
            "ok": True,
            "why": None,
        }
        driver.until(lambda: driver.mode == "stopped")


def test_only_stop_reaches_a_robot_whose_id_a_replay_has(both: TwoBuses, recorded: Path) -> None:
    with both.served.page() as page:
        page.until(lambda: shows(page, "tsd", "robot"))
        assert page.take()["ok"]
        with replaying(both.other, recorded, "tsd"):
            page.until(lambda: page.state["source"] == "several")
            for request in ({"t": "arm"}, {"t": "reset"}, {"t": "lease", "op": "acquire"}):
                answer = page.answer(request["t"], **request)
                assert (answer["ok"], answer["why"]["code"]) == (False, "duplicate_id")
            assert {status.mode for status in both.heard} == {"disarmed"}
            assert page.answer("stop", t="stop")["ok"]
            page.until(lambda: both.mode == "stopped")
            assert page.state["source"] == "several"


def test_a_driving_robot_stops_once_a_replay_has_its_id(both: TwoBuses, recorded: Path) -> None:
    with both.served.page() as page:
        page.until(lambda: shows(page, "tsd", "robot"))
        page.make_ready()
        page.drive()
        with replaying(both.other, recorded, "tsd"):
            page.until(lambda: both.mode not in ("driving", "stopping"))


def test_every_robot_with_an_id_has_to_confirm_a_stop(both: TwoBuses) -> None:
    """A silent instance leaves the stop unconfirmed, even if another one replies."""
    with both.served.page() as page:
        page.until(lambda: shows(page, "tsd", "robot"))
        token = both.other.declare_token(topics.instance_key("tsd", "f" * 16))
        page.until(lambda: both.served.link.has_duplicate)
        answer = page.answer("stop", t="stop")
        assert (answer["ok"], answer["why"]["params"]["text"]) == (
            False,
            "tsd did not acknowledge the stop",
        )
        assert both.mode == "stopped"
        token.close()
        page.until(lambda: not both.served.link.has_duplicate)
        assert page.answer("stop", t="stop")["ok"]
