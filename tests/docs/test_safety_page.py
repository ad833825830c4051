"""docs/safety.md matches the state machine, its times and the simulated stopping distances."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from tests.support.markdown_pages import page, quoted, section, tables
from tsd_twin.control import RobotController, monitors
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.topics import Sample, Service, twist_key
from tsd_twin.robots import load_robot
from tsd_twin.safety import TRANSITIONS, lease, loop_watch, supervisor
from tsd_twin.simulation import SimRobot

PAGE = page("safety.md")
ROBOT = load_robot("tsd")
PERIOD_S = 0.01
SHIPPED = ["tsd", "omni4", "kiwi", "mecanum", "atlas"]


def test_every_mode_is_explained() -> None:
    modes, _ = tables(section(PAGE, "## Modes"))
    assert [quoted(row[0])[0] for row in modes] == [mode.value for mode in Mode]
    assert {quoted(row[0])[0] for row in modes if "latched" in row[3]} == set(LATCHED)


def test_every_way_between_modes_is_in_the_table_and_no_other() -> None:
    _, ways = tables(section(PAGE, "## Modes"))
    shown = {(quoted(a)[0], quoted(b)[0]): by for a, b, by in ways}
    assert shown == {(a.value, b.value): by for (a, b), by in TRANSITIONS.items()}


def test_the_times_are_those_of_the_code_and_the_shipped_robot() -> None:
    (rows,) = tables(section(PAGE, "## Times"))
    places = {
        "limits": ROBOT.limits,
        "motor": ROBOT.motor,
        "lease": lease,
        "supervisor": supervisor,
        "monitors": monitors,
        "loop_watch": loop_watch,
    }
    for _, value, where in rows:
        place, name = quoted(where)[0].split(".")
        assert value == f"{getattr(places[place], name):g} s", where


@pytest.mark.parametrize(("column", "name"), list(enumerate(SHIPPED, start=1)))
@pytest.mark.parametrize(("row", "max_age_s"), list(enumerate([None, 0.25, 0.5, 1.0])))
def test_the_speed_limits_of_leases(
    row: int, max_age_s: float | None, column: int, name: str
) -> None:
    (rows,) = tables(section(PAGE, "## The lease"))
    robot = RobotController(load_robot(name), lambda: bytes(16))
    request = {"op": "acquire", "operator": "alice", "max_age_s": max_age_s}
    robot.serve(Service.LEASE, json.dumps(request).encode(), 0.0)
    granted = robot.supervisor.lease_in_force(0.0)
    assert granted is not None
    assert rows[row][column] == f"{granted.speed_cap_mps:.2f} m/s"
    assert rows[-1][column] == f"{load_robot(name).limits.stop_allowance_m:.2f} m"


class Drive:
    """The `tsd` robot, driven forward at 1 m/s in virtual time."""

    def __init__(self) -> None:
        self.controller = RobotController(ROBOT, lambda: bytes(16))
        self.robot = SimRobot(ROBOT)
        self.now_s, self.tick = 100.0, 0
        self.lease = bytes(16).hex()
        self.ask(Service.LEASE, op="acquire", operator="alice")
        self.ask(Service.ARM, lease=self.lease)
        while self.controller.supervisor.mode is not Mode.READY:
            self.ask(Service.LEASE, op="renew", operator="alice", lease=self.lease)
            self.step()
        for _ in range(200):
            self.step(1.0)

    def ask(self, service: Service, **request: str) -> None:
        self.controller.serve(service, json.dumps(request).encode(), self.now_s)

    def step(self, vx: float | None = None) -> None:
        """Run one period, with or without a command."""
        self.tick += 1
        self.now_s += PERIOD_S
        self.controller.record_status_sent(self.tick, self.now_s)
        samples: list[Sample] = []
        if vx is not None:
            twist = TwistStamped(BASE, np.array([vx, 0.0, 0.0, 0.0, 0.0, 0.0]))
            attachment = encode_attachment(self.tick, bytes(16), self.tick)
            samples = [Sample(twist_key("tsd", "alice"), encode_twist(twist), attachment)]
        measured = self.robot.read(self.now_s)
        self.robot.write(self.controller.step(self.now_s, measured, samples), self.now_s)

    def until_rest(self, vx: float | None) -> tuple[float, float]:
        """Return the distance, m, and time, s, from now until standstill."""
        start, begin_s, moving_s = self.robot.truth(self.now_s), self.now_s, self.now_s
        assert np.hypot(*start.twist[:2]) == pytest.approx(1.0, abs=0.01)
        for _ in range(200):
            self.step(vx)
            if np.hypot(*self.robot.truth(self.now_s).twist[:2]) > 0.005:
                moving_s = self.now_s
        end = self.robot.truth(self.now_s).pose.xy_heading - start.pose.xy_heading
        return float(np.hypot(*end[:2])), moving_s + PERIOD_S - begin_s


def cease(drive: Drive) -> tuple[float, float]:
    return drive.until_rest(None)


def zero(drive: Drive) -> tuple[float, float]:
    drive.step(0.0)
    return drive.until_rest(0.0)


def stop(drive: Drive) -> tuple[float, float]:
    drive.controller.stop(b"", drive.now_s)
    drive.step()
    return drive.until_rest(None)


@pytest.mark.parametrize(
    ("what", "end"),
    [("commands cease", cease), ("a command of zero", zero), ("software stop", stop)],
)
def test_how_far_it_goes(what: str, end: Callable[[Drive], tuple[float, float]]) -> None:
    (rows,) = tables(section(PAGE, "## How far it goes"))
    ((travel, rest),) = [row[1:] for row in rows if row[0] == what]
    travel_m, rest_s = end(Drive())
    assert travel == f"{travel_m:.2f} m"
    assert float(rest.removesuffix(" s")) == pytest.approx(rest_s, abs=0.015)
    assert travel_m <= 0.35
