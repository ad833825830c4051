"""Pose measurements on `sensor/pose` correct the pose and have no other effect."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.controller_harness import PERIOD_S, ROBOT, ControllerHarness
from tsd_twin import robots
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.status import PoseSensorDrops
from tsd_twin.messages.topics import Sample
from tsd_twin.robots import RobotDescription
from tsd_twin.sensors.pose import Camera, CameraNoise
from tsd_twin.simulation import SimRobot

KEY = "twin/tsd/sensor/pose"
WALL_NS = 1_700_000_000_000_000_000
"""Wall-clock time of a robot at monotonic time zero."""


def wall_ns(now_s: float) -> int:
    return WALL_NS + round(now_s * 1e9)


def sample(
    pose: Array | Sequence[float], seen_s: float, frame: str = ODOM, length: float = 1.0
) -> Sample:
    planar = PoseStamped.planar(SE2(np.asarray(pose, dtype=float)), wall_ns(seen_s))
    message = PoseStamped(frame, planar.position_m, length * planar.wxyz, planar.stamp_ns)
    return Sample(KEY, encode_pose(message), b"")


def send(rig: ControllerHarness, *samples: Sample) -> None:
    rig.controller.add_pose_measurements(samples, rig.now_s, wall_ns(rig.now_s))


def dropped(rig: ControllerHarness) -> dict[str, int]:
    pose_sensor = rig.status().pose_sensor
    assert pose_sensor is not None
    return {k: n for k, n in msgspec.structs.asdict(pose_sensor.dropped).items() if n}


def watch(rig: ControllerHarness, camera: Camera, waiting: deque[Sample]) -> None:
    """Deliver the pending frames of a camera to the robot."""
    for frame in camera.capture(rig.now_s, SE2(rig.truth())):
        waiting.append(sample(frame.pose, frame.taken_s))
    send(rig, *waiting)
    waiting.clear()


def test_nobody_has_sent_any_and_the_status_says_nothing_of_them(rig: ControllerHarness) -> None:
    rig.wait(0.5)
    assert rig.status().pose_sensor is None
    assert rig.controller.alternative_odometry(0) is None


def test_a_late_pose_is_fused_and_the_status_says_how_many_and_how_late(
    rig: ControllerHarness,
) -> None:
    rig.get_ready()
    for _ in range(48):
        rig.wait(0.04)
        send(rig, sample(np.zeros(3), rig.now_s - 0.08))
    rig.tick()
    pose_sensor = rig.status().pose_sensor
    assert pose_sensor is not None
    assert (pose_sensor.used, pose_sensor.hz, pose_sensor.found) == (48, 25.0, 0)
    assert pose_sensor.latency_s == pytest.approx(0.09, abs=1e-6)
    rig.wait(1.1)
    pose_sensor = rig.status().pose_sensor
    assert pose_sensor is not None
    assert (pose_sensor.used, pose_sensor.hz, pose_sensor.latency_s) == (48, 0.0, None)


def test_what_is_not_used_is_counted_under_exactly_one_reason(rig: ControllerHarness) -> None:
    rig.wait(2.0)
    here, now_s = np.zeros(3), rig.now_s
    far = [9.0, 0.0, 0.0]
    cases = {
        "key": [Sample("twin/*/sensor/pose", sample(here, now_s).payload, b"")],
        "shape": [Sample(KEY, b"", b""), Sample(KEY, sample(far, 0).payload[:-1], b"")],
        "frame": [sample(here, now_s, BASE), sample(far, now_s + 9, "map")],
        "nonfinite": [sample([math.nan, 0, 0], now_s), sample([0, math.inf, 0], now_s + 9)],
        "quaternion": [sample(here, now_s, length=0.99), sample(here, now_s + 9, length=0.0)],
        "future": [sample(here, now_s + 0.02), sample(far, now_s + 1e6)],
        "old": [sample(here, now_s - 1.01), sample(far, now_s - 1e6), sample(here, -WALL_NS / 1e9)],
        "far": [sample(far, now_s), sample([0, 0, 3.0], now_s), sample([1e300, 0, 0], now_s)],
    }
    for reason, samples in cases.items():
        for each in samples:
            before = dropped(rig) if rig.status().pose_sensor else {}
            send(rig, each)
            rig.controller.step(rig.now_s, None, ())
            assert dropped(rig) == before | {reason: before.get(reason, 0) + 1}
    assert set(cases) | {"flood"} == set(PoseSensorDrops.__struct_fields__)
    pose_sensor = rig.status().pose_sensor
    assert pose_sensor is not None
    assert pose_sensor.used == 0
    np.testing.assert_allclose(rig.pose, 0.0, atol=1e-12)


@given(
    burst=st.integers(0, 80),
    more=st.lists(st.integers(0, 8), max_size=20),
)
@settings(max_examples=20)
def test_of_a_flood_each_is_used_or_counted_and_the_rest_of_the_second_is_served(
    burst: int, more: list[int]
) -> None:
    rig = ControllerHarness()
    rig.wait(0.5)
    for count in (burst, *more):
        send(rig, *[sample(np.zeros(3), rig.now_s - 0.001 * i) for i in range(count)])
        rig.tick()
    rig.wait(0.2)
    pose_sensor = rig.status().pose_sensor
    sent = burst + sum(more)
    if sent == 0:
        assert pose_sensor is None
        return
    assert pose_sensor is not None
    assert pose_sensor.used + pose_sensor.dropped.flood == sent
    assert pose_sensor.used >= min(sent, 16)


@given(twice=st.lists(st.booleans(), min_size=20, max_size=60))
@settings(max_examples=10)
def test_what_is_said_twice_is_believed_once(twice: list[bool]) -> None:
    """Duplicated messages add no information."""
    once, doubled = ControllerHarness(), ControllerHarness()
    for rig in (once, doubled):
        rig.wait(1.0)
        for again in twice:
            rig.wait(0.02)
            seen = sample([0.001, 0.0, 0.0], rig.now_s - 0.05)
            send(rig, seen)
            if again and rig is doubled:
                rig.tick(0.0)
                send(rig, seen)
        rig.tick()
    covariance = once.controller.odometry(0).pose_covariance
    np.testing.assert_allclose(
        doubled.controller.odometry(0).pose_covariance, covariance, rtol=1e-9
    )
    np.testing.assert_allclose(doubled.pose, once.pose, atol=1e-12)
    assert dropped(doubled) == ({"old": sum(twice)} if any(twice) else {})


# Invariants.


@pytest.mark.parametrize("frame", [BASE, ODOM])
@given(seed=st.integers(0, 99))
@settings(max_examples=8)
def test_a_pose_neither_moves_the_robot_nor_changes_what_it_may(frame: str, seed: int) -> None:
    """Compare a robot that receives arbitrary poses with one that receives none."""
    random = np.random.default_rng(seed)
    sent, alone = ControllerHarness(), ControllerHarness()
    pilots = [rig.get_ready() for rig in (sent, alone)]
    # Commands in `odom` axes depend on the heading, so send only poses that are rejected there.
    near = 0.01 if frame == BASE else 50.0
    for i in range(120):
        pose = random.normal(size=3) * [near, near, 0.0] + sent.pose
        junk = Sample(KEY, random.bytes(40), b"")
        send(sent, junk, sample(pose, sent.now_s - 0.1 * random.random()))
        for rig, pilot in zip((sent, alone), pilots, strict=True):
            if i < 60 and i % 2 == 0:
                rig.send(pilot, (0.4, 0.2, 0.5), frame)
            rig.tick()
        np.testing.assert_allclose(sent.setpoint, alone.setpoint, rtol=0.0, atol=1e-12)
        assert sent.mode is alone.mode
        assert sent.controller.supervisor.heartbeat == alone.controller.supervisor.heartbeat
    assert sent.mode is Mode.READY
    assert sent.status().lease == alone.status().lease
    assert sent.status().command == alone.status().command
    pose_sensor = sent.status().pose_sensor
    assert pose_sensor is not None
    assert (pose_sensor.used > 0) == (frame == BASE)


def test_being_found_again_stops_nothing_and_starts_nothing(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    for _ in range(100):
        rig.drive(pilot, (0, 0, 0), PERIOD_S)
        send(rig, sample([4.0, 1.0, 2.0], rig.now_s))
    events = [event for event in rig.controller.take_events() if event.kind == "pose"]
    assert len(events) == 1
    assert events[0].why is not None
    assert events[0].why.params["metres"] == pytest.approx(4.12, abs=0.01)
    np.testing.assert_allclose(rig.pose, [4.0, 1.0, 2.0], atol=1e-3)
    assert not rig.twist.any()
    pose_sensor = rig.status().pose_sensor
    assert pose_sensor is not None
    assert pose_sensor.found == 1


def test_a_robot_that_drives_is_not_put_elsewhere(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    for _ in range(150):
        rig.drive(pilot, (0.2, 0, 0), PERIOD_S)
        send(rig, sample([4.0, 1.0, 2.0], rig.now_s))
    assert rig.mode is Mode.DRIVING
    rig.tick()
    assert dropped(rig) == {"far": 150}
    assert abs(rig.pose[1]) < 0.01


def test_a_sphere_is_nowhere_and_says_so() -> None:
    rig = ControllerHarness(robot=robots.load_robot("atlas"))
    send(rig, sample(np.zeros(3), rig.now_s))
    rig.tick()
    assert dropped(rig) == {"frame": 1}


WITH_GYRO = robots.parse_description(robots.read_description("tsd") + "\n[gyro]\n", "my.toml")


@pytest.mark.parametrize(
    "robot",
    [*map(robots.load_robot, ("tsd", "omni4", "mecanum")), WITH_GYRO],
    ids=["tsd", "omni4", "mecanum", "gyro"],
)
def test_what_wheels_get_wrong_a_camera_puts_right(robot: RobotDescription) -> None:
    """Wheels have ten times the described errors; the robot drives circles for 30 s."""
    # The bus of a robot simulated without errors has no delay.
    exact = robot.with_delay(0.0)
    rig = ControllerHarness(SimRobot(exact, seed=3, noise=10.0), robot=exact)
    pilot = rig.get_ready()
    rig.place(*rig.truth(), pilot=pilot)
    rig.tick()
    camera, waiting = Camera(CameraNoise(), np.random.default_rng(5)), deque[Sample]()
    off: list[float] = []
    for _ in range(3000):
        rig.drive(pilot, (0.3, 0.1, 0.3), PERIOD_S)
        watch(rig, camera, waiting)
        off.append(math.dist(rig.pose[:2], rig.truth()[:2]))
    wheels = rig.controller.alternative_odometry(0)
    assert wheels is not None
    alone = math.dist(wheels.xy_heading[:2], rig.truth()[:2])
    assert max(off) < 0.03
    assert alone > 0.1
    assert dropped(rig) == {}
    assert ROBOT.pose_sensor == robot.pose_sensor
