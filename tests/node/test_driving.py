"""Driving over a real bus: loss of the operator in every way, and every kind of stop."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import RunningNode
from tests.support.withheld import WithheldTime
from tsd_twin.messages import topics
from tsd_twin.messages.status import decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Service

SMOKE = b'{"operator": "eve", "reason": "smoke"}'


@pytest.fixture
def driving(pilot: BusOperator) -> Generator[BusOperator]:
    """An operator driving at 1 m/s."""
    pilot.get_ready()
    pilot.drive((1.0, 0.0, 0.0), until=lambda: pilot.truth.twist[0] > 0.98)
    yield pilot
    assert np.isfinite(pilot.truth.xy_heading).all()


def is_still(pilot: BusOperator) -> bool:
    return bool(np.abs(pilot.truth.twist).max() < 1e-3)


def travel_after_the_last_command(watcher: BusOperator) -> tuple[float, float]:
    """Speed at the last accepted command, m/s, and distance to standstill, m.

    By the robot's clock.
    """
    watcher.wait_until(lambda: is_still(watcher))
    newest = watcher.history["status"][-1]
    age_s = decode_status(newest.payload).command.age_s
    assert age_s is not None
    last_s = decode_stamp(newest.attachment)[1] * 1e-9 - age_s
    times_s, x, y, _ = watcher.track("truth").T
    (x_0, y_0), (x_1, y_1) = (
        (np.interp(last_s + after_s, times_s, x), np.interp(last_s + after_s, times_s, y))
        for after_s in (-0.02, 0.02)
    )
    speed_mps = np.hypot(x_1 - x_0, y_1 - y_0) / 0.04
    return float(speed_mps), float(np.hypot(x[-1] - 0.5 * (x_0 + x_1), y[-1] - 0.5 * (y_0 + y_1)))


@pytest.mark.parametrize("how", ["silence", "a closed session"])
def test_an_operator_who_is_gone_is_a_robot_that_stands_within_35_cm(
    quick_node: RunningNode, how: str
) -> None:
    with BusOperator(quick_node) as driving, BusOperator(quick_node, "watcher") as watcher:
        driving.get_ready()
        driving.drive((1.0, 0.0, 0.0), until=lambda: driving.truth.twist[0] > 0.95)
        with WithheldTime() as withheld:
            if how == "a closed session":
                driving.bus.close()
            watcher.wait_until(lambda: watcher.status.mode == "ready")
            speed_mps, travelled_m = travel_after_the_last_command(watcher)
        # Time that the machine withholds can slow the robot down before the last command.
        assert 0.2 * min(1.0, speed_mps) ** 2 < travelled_m <= 0.35 + 1.0 * withheld.total_s
        # The order depends on the age of the status echoed by the last command.
        reasons = (
            "no command for ",
            "the last command was based on a state ",
            "the robot's computer ",
        )
        assert watcher.status.stop_reason.startswith(reasons)


def test_letting_go_is_no_failure_of_the_link(driving: BusOperator) -> None:
    driving.drive((0.0, 0.0, 0.0), until=lambda: driving.status.mode == "ready")
    driving.wait_until(lambda: "From driving to ready." in driving.texts)
    driving.wait_until(lambda: is_still(driving))
    assert driving.status.stop_reason == ""


@pytest.mark.parametrize(
    ("way", "payload"),
    [("put", b""), ("put", SMOKE), ("query", b"\xff"), ("query", SMOKE)],
)
def test_anybody_stops_it_without_a_lease(
    node: RunningNode, driving: BusOperator, way: str, payload: bytes
) -> None:
    with BusOperator(node, "eve") as eve:
        if way == "query":
            assert eve.ask(Service.STOP, payload)["ok"] is True
        else:
            # Repeated like a dashboard does, because the first may arrive before the robot is
            # discovered.
            stop = eve.bus.publisher(topics.STOP.key("tsd"), QoS.REAL_TIME)
            while eve.status.mode != "stopped":
                stop.put(payload)
                eve.wait_for_news()
        driving.wait_for("stopped")
    reason = "smoke" if payload == SMOKE else "software stop by an unnamed client"
    assert driving.status.stop_reason == reason
    driving.drive((1.0, 0.0, 0.0), until=lambda: is_still(driving))
    np.testing.assert_array_equal(driving.setpoint.velocity_rad_per_s[2::3], 0.0)
    assert driving.ask(Service.ARM, lease=driving.lease)["ok"] is False


def test_after_a_stop_it_drives_again_only_by_reset_and_arm_and_a_command(
    driving: BusOperator,
) -> None:
    driving.ask(Service.STOP, operator="alice")
    driving.wait_for("stopped")
    driving.send((1.0, 0.0, 0.0))  # Held until just before the request.
    refused = driving.ask(Service.RESET, lease=driving.lease)
    assert (refused["ok"], refused["why"]) == (False, {"code": "release_first"})
    driving.drive((0.0, 0.0, 0.0), 0.6)
    assert driving.ask(Service.RESET, lease=driving.lease)["ok"]
    driving.wait_for("disarmed")
    assert is_still(driving)
    assert driving.ask(Service.ARM, lease=driving.lease)["ok"]
    driving.wait_for("ready")
    driving.drive((0.5, 0.0, 0.0), until=lambda: driving.truth.twist[0] > 0.45)
    rules = [event["rule"] for event in driving.events if event["kind"] == "mode"]
    assert rules[-4:] == ["reset", "arm", "wheels at speed", "counted non-zero command"]


def test_numbers_that_are_none_are_dropped_and_too_large_ones_are_clamped(
    driving: BusOperator,
) -> None:
    def counted() -> int:
        return driving.status.command.dropped.nonfinite

    for bad in (np.nan, np.inf, -np.inf):
        before = counted()
        driving.drive((bad, 0.0, 0.0), until=lambda before=before: counted() > before)
    driving.drive((0.0, 1e9, 0.0), until=lambda: driving.truth.twist[1] > 0.98)
    driving.drive((1e300, 0.0, 0.0), until=lambda: driving.truth.twist[0] > 0.98)
    assert counted() >= 3
    assert np.hypot(*driving.truth.twist[:2]) < 1.05
    assert driving.status.limits.applied == 0.0
    driving.wait_until(lambda: "clamp" in {event["kind"] for event in driving.events})
    clamp = next(event for event in driving.events if event["kind"] == "clamp")
    assert clamp["requested"] == [0.0, 1e9, 0.0]
    np.testing.assert_allclose(clamp["applied"], [0.0, 1.0, 0.0])
    driving.wait_until(lambda: "nonfinite" in {event["rule"] for event in driving.events})


def test_a_second_operator_drives_only_after_taking_over(
    node: RunningNode, driving: BusOperator
) -> None:
    with BusOperator(node, "bob") as bob:
        assert bob.acquire()["granted"] is False
        bob.lease = driving.lease  # As if Bob knew it.
        bob.send((-1.0, 0.0, 0.0))
        driving.drive((1.0, 0.0, 0.0), until=lambda: driving.status.command.dropped.lease > 0)
        driving.drive((1.0, 0.0, 0.0), until=lambda: driving.truth.twist[0] > 0.9)
        assert (np.diff(driving.track("truth")[:, 1]) >= 0.0).all()  # Never backwards.
        assert bob.acquire(take_over=True)["holder"] == "bob"
        driving.wait_until(lambda: "bob took control over from alice." in driving.texts)
        # An earlier status does not count the last commands of Alice yet.
        bob.wait_until(lambda: bob.status.lease.holder == "bob")
        accepted = bob.status.command.accepted
        driving.drive((1.0, 0.0, 0.0), until=lambda: driving.status.mode == "ready")
        assert bob.status.command.accepted <= accepted + 1
        bob.drive((-0.5, 0.0, 0.0), until=lambda: bob.truth.twist[0] < -0.45)
        assert driving.status.lease.holder == "bob"


def test_a_command_in_the_worlds_axes_is_turned_by_the_heading(pilot: BusOperator) -> None:
    pilot.get_ready()
    turned = {"x_m": 0.0, "y_m": 0.0, "heading_rad": np.pi / 2}
    assert pilot.ask(Service.SET_POSE, lease=pilot.lease, **turned)["ok"]
    pilot.drive((0.5, 0.0, 0.0), until=lambda: pilot.odom.xy_heading[0] > 0.1, frame="odom")
    np.testing.assert_allclose(pilot.odom.twist, [0.0, -0.5, 0.0], atol=0.06)
    assert pilot.truth.twist[1] < -0.4


def test_mode_changes_are_told_at_once(pilot: BusOperator) -> None:
    """Without waiting for the next status at 20 Hz."""
    pilot.acquire()
    pilot.ask(Service.ARM, lease=pilot.lease)
    pilot.wait_for("ready")
    modes = [decode_status(sample.payload).mode for sample in pilot.history["status"]]
    at = modes.index("arming")
    numbers = [decode_stamp(sample.attachment) for sample in pilot.history["status"]]
    event = next(event for event in pilot.events if event["rule"] == "arm")
    assert numbers[at][1] * 1e-9 == pytest.approx(event["robot_s"], abs=1e-6)


def test_the_echoed_status_must_be_a_recent_one(quick_node: RunningNode) -> None:
    with BusOperator(quick_node) as pilot:
        pilot.get_ready()
        old = pilot.seen
        pilot.wait_until(lambda: pilot.seen > old + 10)
        before = pilot.status.command.dropped.stale  # A busy machine may be late with a zero.
        pilot.send((1.0, 0.0, 0.0), seen=old)
        pilot.wait_until(lambda: pilot.status.command.dropped.stale == before + 1)
        pilot.wait_until(lambda: any("0.21 s are allowed" in text for text in pilot.texts))
        pilot.send((1.0, 0.0, 0.0), seen=pilot.seen + 1000)
        pilot.wait_until(lambda: pilot.status.command.dropped.stale == before + 2)
        assert pilot.status.mode == "ready"
