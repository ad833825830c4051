"""Preview of joints for a twist, and the factors that limit a moving robot."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.support.link_sockets import eventually
from tests.support.page_client import Site, site
from tests.support.scene_doubles import EmptyScene, RobotFeed
from tsd_twin.dashboard.sessions.previews import preview_of
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.dashboard.wire.from_page import decode_page_message
from tsd_twin.dashboard.wire.to_page import JointPreview, RobotState
from tsd_twin.lie import Array
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.status import LimitStatus, RobotStatus, WheelSpeedStatus
from tsd_twin.robots import load_robot, robot_names

RPM = math.pi / 30.0
AZIMUTHS_RAD = np.radians([90.0, 210.0, 330.0])
PIVOTS_M = 0.15 * np.stack([np.cos(AZIMUTHS_RAD), np.sin(AZIMUTHS_RAD)], axis=-1)
FAST: dict[str, float] = {"speed_mps": 1000.0, "turn_rate_rad_per_s": 1e4}


def feed_of(robot_id: str, rpm: float | None = None, **limits: float) -> Any:
    """A robot with a status and modified limits."""
    robot = load_robot(robot_id)
    limited = msgspec.structs.replace(robot.limits, **limits)
    feed = RobotFeed(robot_id, msgspec.structs.replace(robot, limits=limited))
    speed = None if rpm is None else WheelSpeedStatus(rpm, rpm)
    feed.say(status=RobotStatus("disarmed", wheel_speed=speed))
    return feed


def preview(feed: Any, *twist: float) -> JointPreview:
    return preview_of(feed, np.array(twist))[0]


@pytest.mark.parametrize("rpm", [2500.0, 6000.0])
def test_a_preview_leans_each_axle_as_its_pivot_needs_at_the_current_wheel_speed(
    rpm: float,
) -> None:
    """By rolling, a wheel leaning to the left of its push moves it at r omega sin(tilt)."""
    vx, vy, omega = 0.4, -0.2, 0.8
    found = preview(feed_of("tsd", rpm), vx, vy, omega)
    assert found.twist == (vx, vy, omega)
    assert found.limit is None
    tilts: list[float] = []
    for module, (x, y) in zip(found.modules, PIVOTS_M, strict=True):
        push = np.array([vx - omega * y, vy + omega * x])
        assert module.push == pytest.approx(push, abs=1e-3)
        tilt = math.asin(math.hypot(*push) / (0.04 * rpm * RPM))
        assert module.tilt == pytest.approx(math.degrees(tilt), abs=0.01)
        left = math.degrees(math.atan2(push[0], -push[1]))
        assert module.direction == pytest.approx(left, abs=0.1)
        cosines = [math.cos(math.radians(angle)) for angle in (module.alpha, module.beta)]
        assert math.prod(cosines) == pytest.approx(math.cos(tilt), abs=1e-5)
        assert module.rpm == rpm
        tilts.append(tilt)
    assert found.utilization == pytest.approx(math.sin(max(tilts)) / 0.5, abs=1e-3)


def test_upright_axles_have_no_direction() -> None:
    found = preview(feed_of("tsd", 2500.0), 0.0, 0.0, 0.0)
    assert [module.direction for module in found.modules] == [None] * 3
    assert found.utilization == 0.0


@pytest.mark.parametrize(
    ("robot_id", "limits", "twist", "limit"),
    [
        ("tsd", {}, (3.0, 4.0, 0.0), "speed"),
        ("tsd", {}, (0.1, 0.0, 40.0), "turn_rate"),
        ("tsd", FAST, (30.0, 0.0, 0.0), "tilt"),
        ("omni4", FAST, (30.0, 40.0, 0.0), "wheel_speed"),
        ("atlas", FAST, (0.0, 400.0, 0.0), "wheel_speed"),
    ],
)
def test_a_twist_beyond_a_limit_is_scaled_and_the_limit_named(
    robot_id: str, limits: dict[str, float], twist: tuple[float, ...], limit: str
) -> None:
    found = preview(feed_of(robot_id, **limits), *twist)
    assert found.limit == limit
    scale = np.array(found.twist) @ twist / (np.array(twist) @ twist)
    assert 0.0 < scale < 1.0
    assert found.twist == pytest.approx(scale * np.array(twist), abs=1e-4)
    if limit == "tilt":
        assert [module.tilt for module in found.modules] == [30.0] * 3
        assert found.utilization == pytest.approx(1.0 / scale, rel=1e-3)
    if limit == "speed":
        assert math.hypot(*found.twist[:2]) == pytest.approx(load_robot("tsd").limits.speed_mps)


def test_a_slower_lease_lowers_the_speed_limit() -> None:
    feed = feed_of("tsd")
    slow = LimitStatus(speed_mps=0.2, turn_rate_rad_per_s=0.6)
    feed.say(status=RobotStatus("disarmed", limits=slow))
    found = preview(feed, 0.5, 0.0, 0.0)
    assert found.limit == "speed"
    assert found.twist == pytest.approx((0.2, 0.0, 0.0))


@pytest.mark.parametrize("robot_id", robot_names())
def test_wheels_without_gimbals_push_along_their_direction(robot_id: str) -> None:
    found = preview(feed_of(robot_id), 0.2, 0.1, 0.3)
    assert bool(found.modules) is (robot_id == "tsd") is not bool(found.wheels)
    if robot_id in ("kiwi", "omni4", "mecanum"):
        drive: Any = load_robot(robot_id).drive  # pyright: ignore[reportAttributeAccessIssue]
        for wheel, place in zip(found.wheels, drive.wheels, strict=True):
            direction = math.radians(place.direction_deg)
            rim_mps = drive.wheel_radius_m * wheel.rpm * RPM
            push = (rim_mps * math.cos(direction), rim_mps * math.sin(direction))
            assert wheel.push == pytest.approx(push, abs=1e-3)


def driving(applied: float, twist: tuple[float, ...]) -> RobotState:
    """State of a robot that drives at `twist`, which is `applied` times the request."""
    feed: Any = feed_of("tsd", 2500.0)
    joints: Array = feed.kinematics.inverse(np.array(twist))
    feed.say(joints=joints, setpoint=joints)
    state = feed.snapshot.joints
    state.velocity_rad_per_s[:] = state.position_rad[:] = joints
    status = RobotStatus("driving", limits=LimitStatus(1.0, 3.0, applied=applied))
    feed.say(status=status)
    telemetry = RobotTelemetry(feed)
    feed.snapshot.setpoint.velocity_rad_per_s[:] = joints
    feed.snapshot.setpoint.position_rad[:] = joints
    return telemetry.state(feed.snapshot, feed.now_s)


@pytest.mark.parametrize(
    ("applied", "twist", "limit"),
    [
        (1.0, (1.0, 0.0, 0.0), None),
        (0.5, (0.3, 0.0, 0.1), "speed"),
        (0.5, (0.1, 0.0, 2.9), "turn_rate"),
        (0.5, (0.0, 0.0, 0.0), None),
    ],
)
def test_a_robot_that_is_held_back_names_the_limit(
    applied: float, twist: tuple[float, ...], limit: str | None
) -> None:
    state = driving(applied, twist)
    assert state.limit == limit
    worst = max(math.hypot(twist[0] - twist[2] * y, twist[1] + twist[2] * x) for x, y in PIVOTS_M)
    assert state.utilization == pytest.approx(worst / (0.04 * 2500.0 * RPM * 0.5), abs=1e-3)
    for module, (x, y) in zip(state.modules, PIVOTS_M, strict=True):
        push = (twist[0] - twist[2] * y, twist[1] + twist[2] * x)
        assert module.push == pytest.approx(push, abs=1e-3)
        assert module.setpoint.push == pytest.approx(push, abs=1e-3)
        assert module.setpoint.rpm == 2500


class WatchedScene(EmptyScene):
    """A scene that records the previews of pages."""

    def __init__(self) -> None:
        super().__init__()
        self.previews: list[tuple[str, str, Array | None]] = []

    def draw(self, page: str, kind: str, act: Callable[[Any], None]) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        if kind == "preview":
            act(SimpleNamespace(show_preview=lambda *shown: self.previews.append((page, *shown))))


@pytest.fixture
def place() -> Any:
    scene: Any = WatchedScene()
    with site(page_scene=scene) as made:
        yield SimpleNamespace(site=made, scene=scene)


def test_a_page_that_only_looks_is_answered_and_moves_its_picture(place: Any) -> None:
    served: Site = place.site
    with served.page() as page, served.page("fedcba9876543210") as other:
        page.until(lambda: page.state)
        other.until(lambda: other.state)
        page.send(t="preview", twist=[0.5, 0.0, 0.0])
        found = page.until(lambda: page.last("preview"))
        assert found["robot"] == "tsd"
        assert found["twist"] == [0.5, 0.0, 0.0]
        assert [round(module["push"][0], 2) for module in found["modules"]] == [0.5] * 3
        page.send(t="preview", twist=None)
        page.until(lambda: place.scene.previews[-1][2] is None)
        assert {name for name, _, _ in place.scene.previews} == {page.name}
        joints = next(joints for _, _, joints in place.scene.previews)
        np.testing.assert_allclose(
            joints, load_robot("tsd").kinematics().inverse(np.array([0.5, 0.0, 0.0]))
        )
        page.send(t="preview", twist=[0.1, 0.0, 0.0])
        page.until(lambda: page.last("preview")["twist"][0] == 0.1)
        assert page.mode == "disarmed"
        assert not other.all("preview")
    eventually(lambda: place.scene.previews[-1][2] is None)  # The page has left.


def test_a_preview_is_sent_again_when_the_wheel_speed_changes(place: Any) -> None:
    with place.site.page() as page:
        page.make_ready()
        page.send(t="preview", twist=[0.5, 0.0, 0.0])
        before = page.until(lambda: page.last("preview"))
        assert page.answer("wheel_speed", t="wheel_speed", cruise_speed_rpm=5000)["ok"]
        page.until(lambda: page.last("preview")["modules"][0]["rpm"] == 5000)
        after = page.last("preview")
        assert after["modules"][0]["tilt"] < 0.6 * before["modules"][0]["tilt"]


@pytest.mark.parametrize("twist", [[1e7, 0.0, 0.0], [0.0, 0.0], "fast", [1e400, 0.0, 0.0]])
def test_a_preview_has_three_bounded_numbers(twist: Any) -> None:
    text = json.dumps({"t": "preview", "twist": twist}).replace("Infinity", "1e400")
    with pytest.raises(MessageError):
        decode_page_message(text)
