"""The process of the shadow twins answers as a twin in this process does, and is replaced."""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Generator
from pathlib import Path

import msgspec
import psutil
import pytest

from tsd_twin import robots
from tsd_twin.client.virtual import SimulatedRobot
from tsd_twin.dashboard.sessions import shadow_process
from tsd_twin.dashboard.sessions.shadow_process import ShadowProcess, TwinSample
from tsd_twin.errors import TwinError
from tsd_twin.messages.cdr import decode_joints, decode_odometry, encode_joints, encode_odometry
from tsd_twin.messages.status import decode_stamp, decode_status, encode_stamp, encode_status
from tsd_twin.messages.topics import JOINTS, ODOM, SETPOINT, STATUS
from tsd_twin.shadow import ShadowFeed, ShadowReport, ShadowTwin

NAMES = ("tsd", "kiwi", "atlas")
PERIODS = 60


@pytest.fixture
def process() -> Generator[ShadowProcess]:
    made = ShadowProcess()
    yield made
    made.close()
    assert not children()


def children() -> list[psutil.Process]:
    return psutil.Process().children()


def drive(name: str) -> list[list[TwinSample]]:
    """Return the messages of a driving robot, by period."""
    periods: list[list[TwinSample]] = []
    with SimulatedRobot(name, seed=31, noise=1.0) as robot, robot.control() as control:
        for _ in itertools.islice(control.driving(lambda _: (0.1, 0.05, 0.1)), PERIODS):
            state = robot.state
            stamp = encode_stamp(1, state.joints.stamp_ns)
            periods.append(
                [
                    TwinSample(STATUS.path, encode_status(state.status), stamp),
                    TwinSample(JOINTS.path, encode_joints(state.joints), stamp),
                    TwinSample(SETPOINT.path, encode_joints(state.setpoint), stamp),
                    TwinSample(ODOM.path, encode_odometry(state.odom.message), stamp),
                ]
            )
    return periods


def report_here(name: str, periods: list[list[TwinSample]]) -> ShadowReport:
    """Return the report of a twin in this process."""
    feed = ShadowFeed(ShadowTwin(robots.load_robot(name)))
    for status, joints, setpoint, odom in periods:
        robot_ns = decode_stamp(joints.attachment)[1]
        feed.status = decode_status(status.payload)
        feed.add("joints", decode_joints(joints.payload), robot_ns)
        feed.add("setpoint", decode_joints(setpoint.payload), robot_ns)
        feed.add("odom", decode_odometry(odom.payload, turning=name == "atlas"), robot_ns)
    return feed.twin.report()


@pytest.mark.parametrize("name", NAMES)
def test_its_reports_are_those_of_a_twin_in_this_process(process: ShadowProcess, name: str) -> None:
    periods, twin = drive(name), process.new_twin(robots.load_robot(name))
    for first in range(0, PERIODS, 7):
        samples = [sample for period in periods[first : first + 7] for sample in period]
        report = process.advance(twin, samples)
    assert report.compared_s > 0.2
    assert msgspec.json.encode(report) == msgspec.json.encode(report_here(name, periods))


def test_invalid_messages_are_skipped(process: ShadowProcess) -> None:
    periods, twin = drive("kiwi"), process.new_twin(robots.load_robot("kiwi"))
    invalid = [TwinSample(path, b"no", b"") for path in (STATUS.path, JOINTS.path, ODOM.path)]
    for period in periods:
        report = process.advance(twin, [*invalid, *period, *invalid])
    assert report == report_here("kiwi", periods)


def test_twins_begin_again_after_their_process_has_died(process: ShadowProcess) -> None:
    periods, twin = drive("kiwi"), process.new_twin(robots.load_robot("kiwi"))
    for period in periods:
        process.advance(twin, period)
    (child,) = children()
    child.kill()
    for period in periods[:30]:
        report = process.advance(twin, period)
    assert report == report_here("kiwi", periods[:30])
    process.end(twin)
    assert process.advance(twin, []) == ShadowReport(0.0)


def test_a_process_that_never_answers_is_ended(
    process: ShadowProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = process.new_twin(robots.load_robot("kiwi"))
    process.advance(twin, [])
    (child,) = children()
    monkeypatch.setattr(shadow_process, "ANSWER_TIMEOUT_S", 0.0)
    os.kill(child.pid, signal.SIGSTOP)
    with pytest.raises(TwinError, match="does not answer"):
        process.advance(twin, [])
    assert not children()


def test_modules_in_the_current_folder_are_not_loaded(
    process: ShadowProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('not the library')")
    monkeypatch.chdir(tmp_path)
    twin = process.new_twin(robots.load_robot("kiwi"))
    assert process.advance(twin, []) == ShadowReport(0.0)
