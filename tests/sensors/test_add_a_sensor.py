"""A sensor in one file and one table, both from the documentation."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.support.logged_runs import eventful_run
from tests.support.markdown_pages import code, page
from tsd_twin import sensors
from tsd_twin.control import RobotController
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.errors import RobotFileError
from tsd_twin.estimation.consistency import chi_square_bound
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, wrap
from tsd_twin.recording.rerun import Rerun, stretches
from tsd_twin.registry import KindError
from tsd_twin.robots import RobotDescription
from tsd_twin.robots.loader import parse_description, read_description
from tsd_twin.simulation import simulate

PAGE = page("add_a_sensor.md")
FILE, TABLE = code(PAGE, "python")[0], code(PAGE, "toml")[0]
PERIOD_S = 0.01
HOLD_S, START_S, DRIVE_S = 2.5, 5.0, 30.0


@pytest.fixture(autouse=True)
def range_finder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install the page's file in the sensors package."""
    (tmp_path / "range_finder.py").write_text(FILE, encoding="utf-8")
    monkeypatch.setattr(sensors, "__path__", [*sensors.__path__, str(tmp_path)])
    yield
    sys.modules.pop("tsd_twin.sensors.range_finder", None)
    sensors.find.cache_clear()


def robot(*tables: str, name: str = "tsd") -> RobotDescription:
    return parse_description("\n".join([read_description(name), *tables]), "my.toml")


class Drive:
    """Simulated robot with a seed, and the estimate from its sensors."""

    def __init__(self, described: RobotDescription, seed: int) -> None:
        self.simulated = simulate(described, seed=seed, noise=1.0)
        self.estimator = StateEstimator(described)
        self.kinematics = described.kinematics()
        self.wheels = [joint.kind is JointKind.VELOCITY for joint in self.kinematics.joints]
        self.readings: list[float] = []
        self.nees: list[float] = []

    def run(self, seconds: float) -> Drive:
        for i in range(round(seconds / PERIOD_S)):
            t_s = i * PERIOD_S
            drives = t_s > START_S  # Wheels of gimbals take some seconds to spin up.
            twist = np.array([0.25 * np.sin(0.7 * t_s), 0.2 * np.sin(0.45 * t_s), 0.0]) * drives
            setpoint = self.kinematics.inverse(twist)
            setpoint[self.wheels] *= t_s > HOLD_S
            self.simulated.command(setpoint)
            self.simulated.advance(PERIOD_S)
            measured = self.simulated.measure()
            self.readings.append(float(measured[-1]))
            self.estimator.advance(t_s + PERIOD_S, measured, setpoint, PERIOD_S)
        return self

    @property
    def error(self) -> np.ndarray[Any, Any]:
        estimate, truth = self.estimator.pose, self.simulated.pose
        off = truth.xy_heading - estimate.xy_heading
        off[2] = wrap(off[2])
        return off

    @property
    def covariance(self) -> np.ndarray[Any, Any]:
        return np.array(self.estimator.odometry(0).pose_covariance)


def test_the_range_finder_is_a_kind_of_sensor_and_others_are_not() -> None:
    assert "range_finder" in sensors.kinds()
    with pytest.raises(KindError, match="there is no sensor 'sonar' \\(sensors are range_finder"):
        sensors.find("sonar")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("wall_m", "wal_m", "unknown key 'wal_m' in [sensors[0]], did you mean 'wall_m'?"),
        ("wall_m = 2.0", "wall_m = -2.0", "sensors[0].wall_m: expected float > 0.0"),
        ("wall_m = 2.0", "", "key 'wall_m' is missing in [sensors[0]]"),
        ("range_finder", "sonar", "sensors[0]: there is no sensor 'sonar'"),
        ('kind = "range_finder"', "", "sensors[0]: key 'kind' is missing"),
        ("wall_deg = 0.0", "wall_deg = nan", "sensors[0].wall_deg: nan is not a finite number"),
    ],
)
def test_an_error_in_the_table_is_named(old: str, new: str, says: str) -> None:
    with pytest.raises(RobotFileError, match=re.escape(says)):
        robot(TABLE.replace(old, new))


def test_two_sensors_need_two_names() -> None:
    with pytest.raises(RobotFileError, match="two sensors have the same name"):
        robot(TABLE, TABLE)
    described = robot(
        TABLE, TABLE.replace("front", "left").replace("wall_deg = 0", "wall_deg = 90")
    )
    assert [channel.name for channel in described.sensors][-2:] == ["front", "left"]


@pytest.mark.parametrize("name", ["atlas"])
def test_robots_that_do_not_drive_on_a_floor_have_none(name: str) -> None:
    with pytest.raises(RobotFileError, match="drives on a floor"):
        robot(TABLE, name=name)


def test_a_description_with_sensors_survives_encoding() -> None:
    described = robot(TABLE)
    again = msgspec.convert(msgspec.to_builtins(described), type(described))
    assert again == described
    assert again.sensors == described.sensors


def test_readings_come_at_the_rate_of_the_table() -> None:
    drive = Drive(robot(TABLE), 1).run(2.0)
    due = np.isfinite(drive.readings)
    assert due.sum() == 40
    assert abs(np.nanmean(drive.readings) - 2.0) < 0.5


def test_the_reading_is_sent_with_its_name() -> None:
    described = robot(TABLE)
    simulated = simulate(described, seed=1, noise=1.0)
    controller = RobotController(described, lambda: bytes(16))
    for i in range(5):
        simulated.advance(PERIOD_S)
        measured = simulated.measure()
        controller.step(i * PERIOD_S, measured, ())
    state = controller.joint_state(0)
    index = list(state.names).index("front")
    assert np.isfinite(measured[-1])
    assert state.position_rad[index] == measured[-1]


@pytest.mark.parametrize("name", ["tsd", "kiwi"])
def test_two_range_finders_shrink_the_covariance_of_the_pose_and_stay_consistent(name: str) -> None:
    """With seeds not used for tuning."""
    seeds = range(300, 304)
    front = TABLE + "scale_share = 0.0005\noffset_m = 0.001\n"
    left = front.replace("front", "left").replace("wall_deg = 0.0", "wall_deg = 90.0")
    tables = (front, left + "direction_deg = 90.0\n")
    own = [Drive(robot(name=name), seed).run(DRIVE_S) for seed in seeds]
    corrected = [Drive(robot(*tables, name=name), seed).run(DRIVE_S) for seed in seeds]
    sigma = [
        np.mean([np.sqrt(np.trace(drive.covariance[:2, :2])) for drive in drives])
        for drives in (own, corrected)
    ]
    assert sigma[1] < 0.8 * sigma[0]
    nees = [float(d.error @ np.linalg.solve(d.covariance, d.error)) for d in corrected]
    assert np.mean(nees) < chi_square_bound(3, 0.05)


def test_a_recording_with_readings_reruns_bit_for_bit_also_from_its_middle() -> None:
    run = eventful_run("\n".join([read_description("tsd"), TABLE]), 7)
    middle = len(run.batches) // 2
    for batches in (run.batches, run.batches[middle:]):
        (stretch,) = stretches(batches)
        result = Rerun(stretch, run.text).run()
        assert result.difference is None
        assert result.largest_difference == 0.0


def test_biases_are_learned_within_their_stated_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    sensors.find("range_finder")
    module: Any = sys.modules["tsd_twin.sensors.range_finder"]
    made: list[Any] = []

    class Kept(module.SimulatedRange):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            made.append(self)

    monkeypatch.setattr(module, "SimulatedRange", Kept)
    off: list[float] = []
    for seed in range(400, 410):
        drive = Drive(robot(TABLE), seed).run(DRIVE_S)
        found = drive.estimator.learned()
        assert found is not None
        scale, offset = found["front_scale_share"], found["front_offset_m"]
        assert offset.sigma < 0.003
        off.append((float(made[-1].true_scale) - 1.0 - scale.value) / scale.sigma)
        off.append((float(made[-1].true_offset_m) - offset.value) / offset.sigma)
    assert np.mean(np.square(off)) < 3.0


def test_a_reading_far_off_is_not_used() -> None:
    described = robot(TABLE)
    drive = Drive(described, 5).run(2.0)
    before = drive.estimator.pose.xy_heading.copy()
    joints = drive.simulated.measure()
    joints[-1] = 0.4
    drive.estimator.advance(2.01, joints, drive.simulated.joints, PERIOD_S)
    assert np.abs(drive.estimator.pose.xy_heading - before).max() < 0.01


@pytest.mark.parametrize("sent", [0, 1])
def test_hardware_may_omit_readings(sent: int) -> None:
    left = TABLE.replace("front", "left").replace("wall_deg = 0.0", "wall_deg = 90.0")
    drive = Drive(robot(TABLE, left), 7).run(0.1)
    measured = drive.simulated.measure()
    few = measured[: len(measured) - 2 + sent]
    drive.estimator.advance(0.11, few, drive.simulated.joints, PERIOD_S)
    assert np.isfinite(drive.estimator.pose.xy_heading).all()


def test_setting_the_pose_discards_earlier_readings() -> None:
    drive = Drive(robot(TABLE), 6).run(2.0)
    drive.estimator.set_pose(SE2(np.array([0.3, 0.2, 0.1])))
    np.testing.assert_allclose(drive.estimator.pose.xy_heading, [0.3, 0.2, 0.1])


@pytest.mark.parametrize("name", ["omni4", "tsd"])
def test_a_sensor_that_sees_nothing_changes_no_estimate(name: str) -> None:
    """Also with dead wheels and a gyro, whose readings come first."""
    blind = TABLE.replace("wall_m = 2.0", "wall_m = 90.0")
    gyro = [] if name == "omni4" else ["[gyro]"]
    alone, beside = (
        Drive(robot(*gyro, *tables, name=name), seed=3).run(8.0) for tables in ([], [blind])
    )
    assert np.isnan(beside.readings).all()
    poses = [each.estimator.pose.xy_heading for each in (alone, beside)]
    np.testing.assert_array_equal(*poses)
