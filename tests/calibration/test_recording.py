"""Bus messages become a calibration recording with all times on the robot's clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import table
from tsd_twin import robots
from tsd_twin.calibration.collect import (
    missing_spin_ratios,
    next_run_advice,
    spin_ratio_of,
    spin_ratios,
)
from tsd_twin.calibration.drive_log import (
    Recording,
    RobotRecorder,
    read_recordings,
    recording_columns,
)
from tsd_twin.cli.experiment import Output
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import JointState, encode_joints
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.status import RobotStatus, encode_stamp, encode_status
from tsd_twin.messages.topics import Sample
from tsd_twin.recording.channels import EntryMaker
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.robots import SingularityDescription

ROBOT = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription)
NAMES = [joint.name for joint in ROBOT.kinematics().joints]
AHEAD_S = 1_700_000_000.25
"""Wall clock minus monotonic clock."""


def joints(now_s: float, angles: Array, speeds: Array, ahead_s: float = AHEAD_S) -> Sample:
    """Joint message as the node sends it."""
    row = np.column_stack([angles.reshape(3, 2), speeds])
    is_angle = np.tile([True, True, False], 3)
    state = JointState(
        NAMES,
        np.where(is_angle, row.ravel(), np.nan),
        np.where(is_angle, 0.0, row.ravel()),
        round((now_s + ahead_s) * 1e9),
    )
    stamp = encode_stamp(1, round(now_s * 1e9))
    return Sample("twin/tsd/state/joints", encode_joints(state), stamp)


def pose(seen_s: float, x_m: float, heading: float = 0.0, ahead_s: float = AHEAD_S) -> Sample:
    """Pose message as a camera sends it."""
    stamp_ns = round((seen_s + ahead_s) * 1e9)
    message = PoseStamped.planar(SE2(np.array([x_m, 0.0, heading])), stamp_ns)
    return Sample("twin/tsd/sensor/pose", encode_pose(message), b"")


def samples(
    seconds: float = 2.0, late_s: float = 0.08, jump_s: float = 0.0
) -> Iterator[tuple[float, Sample]]:
    """All messages of a time interval; the wall clock jumps halfway."""
    for i in range(round(seconds / 0.02)):
        now_s = 100.0 + 0.02 * i
        ahead_s = AHEAD_S + (jump_s if i > 0.5 * seconds / 0.02 else 0.0)
        told = np.array([250.0, 200.0, 200.0])
        yield now_s, joints(now_s, np.full(6, 0.001 * i), np.full(3, 200.0), ahead_s)
        setpoint = joints(now_s, np.zeros(6), told, ahead_s)
        yield now_s, replace(setpoint, key="twin/tsd/state/setpoint")
        if i % 2:
            yield now_s, pose(now_s - late_s, now_s - late_s, 0.0, ahead_s)


def heard(seconds: float = 2.0, late_s: float = 0.08, jump_s: float = 0.0) -> RobotRecorder:
    recorder = RobotRecorder(ROBOT)
    take = {
        "joints": recorder.add_joints,
        "setpoint": recorder.add_setpoint,
        "pose": recorder.add_pose,
    }
    for _, sample in samples(seconds, late_s, jump_s):
        take[sample.key.rsplit("/", 1)[1]](sample)
    return recorder


def written(path: Path, *modes: tuple[float, str], robots_in_it: int = 1) -> Path:
    """Write a file like `tsd-record`, with modes by start time."""
    file, make = RecordingFile(path), EntryMaker()
    for now_s, sample in samples():
        log_ns = round((now_s + AHEAD_S) * 1e9)
        mode = [mode for since_s, mode in modes if since_s <= now_s][-1]
        status = RobotStatus(mode, hardware={"battery_v": 10.8})
        stamp = encode_stamp(1, round(now_s * 1e9))
        for number in range(robots_in_it):
            name = "tsd" if number == 0 else f"tsd-{number}"
            said = Sample(f"twin/{name}/state/status", encode_status(status), stamp)
            for each in (said, replace(sample, key=sample.key.replace("/tsd/", f"/{name}/"))):
                for entry in make.of_sample(each, log_ns):
                    file.add(entry)
    file.close()
    return path


def test_a_file_of_the_recorder_has_the_drive_that_was_heard(tmp_path: Path) -> None:
    """The run starts when the robot becomes ready and ends when it stops."""
    modes = [(0.0, "disarmed"), (100.5, "ready"), (100.8, "driving"), (101.5, "stopped")]
    (found,) = read_recordings(str(written(tmp_path / "run.mcap", *modes)), ROBOT)
    once = heard().recording(100.5, 101.48, battery_v=10.8)
    for name in ("t_s", "angles_rad", "commanded_rad_per_s", "camera_s", "camera_poses"):
        np.testing.assert_allclose(getattr(found, name), getattr(once, name), atol=1e-6)


def test_each_time_that_it_drives_is_a_run_and_standing_is_none(tmp_path: Path) -> None:
    twice = [(0.0, "driving"), (100.6, "disarmed"), (101.0, "ready"), (101.2, "driving")]
    runs = read_recordings(str(written(tmp_path / "twice.mcap", *twice)), ROBOT)
    assert [round(float(run.t_s[-1]), 2) for run in runs] == [0.58, 0.98]
    for name, modes, robots_in_it, says in (
        ("ready", [(0.0, "ready")], 1, "does not drive"),
        ("two", [(0.0, "driving")], 2, "has 2 robots"),
    ):
        path = written(tmp_path / f"{name}.mcap", *modes, robots_in_it=robots_in_it)
        with pytest.raises(TwinError, match=says):
            read_recordings(str(path), ROBOT)
    (tmp_path / "none.mcap").write_text("not a recording")
    with pytest.raises(TwinError, match="no recording"):
        read_recordings(str(tmp_path / "none.mcap"), ROBOT)


@pytest.mark.parametrize("late_s", [0.0, 0.08, 1.0])
def test_poses_stand_at_the_time_they_were_seen_on_the_clock_of_the_joints(late_s: float) -> None:
    recording = heard(late_s=late_s).recording(100.5, 101.5, battery_v=0.9 * 12.0)
    assert recording.t_s[0] == 0.0
    # In these messages, x moves at 1 m/s and joints count the rows.
    np.testing.assert_allclose(recording.camera_poses[:, 0] - 100.5, recording.camera_s, atol=0.02)
    np.testing.assert_allclose(
        recording.camera_s, recording.camera_poses[:, 0] - 100.5, atol=1e-3 + 0.02
    )
    np.testing.assert_allclose(recording.angles_rad[:, 0], 0.05 * (recording.t_s + 0.5), atol=2e-3)
    # Commanded speeds at the reported voltage; no speed was measured.
    np.testing.assert_allclose(recording.commanded_rad_per_s[3], [225.0, 180.0, 180.0])
    assert np.isnan(recording.spin_rad_per_s).all()


def test_what_is_no_pose_is_left_out_and_said() -> None:
    recorder = heard()
    good = len(recorder.recording(100.0, 102.0, None).camera_s)
    for sample, says in (
        (pose(101.0, np.nan), "nonfinite"),
        (pose(101.0 - 3600.0, 1.0), "s off the clock"),
        (pose(103.5, 1.0), "s off the clock"),
        (Sample("twin/tsd/sensor/pose", b"soon", b""), "shape"),
    ):
        assert recorder.add_pose(sample) is None
        assert says in recorder.refused
    recorder.add_joints(Sample("twin/tsd/state/joints", b"", b""))
    recorder.add_joints(joints(103.0, np.full(6, np.nan), np.full(3, 200.0)))
    recording = recorder.recording(100.0, 104.0, None)
    assert len(recording.camera_s) == good
    assert np.isfinite(recording.angles_rad).all()


def test_a_wall_clock_that_is_set_meanwhile_is_noticed() -> None:
    with pytest.raises(TwinError, match="clock of the robot was set"):
        heard(jump_s=0.2).recording(100.0, 102.0, None)


def test_a_drive_of_which_nothing_was_heard_is_none() -> None:
    with pytest.raises(TwinError, match="too few samples"):
        heard().recording(200.0, 300.0, None)


def test_a_recording_in_a_file_is_the_same_again(tmp_path: Path) -> None:
    """Frames fall between joint samples, and turn by more than half a turn."""
    once = heard().recording(100.5, 101.9, None)
    once.camera_poses[:, 2] = np.linspace(0.0, 7.0, len(once.camera_poses))
    out = Output(tmp_path)
    out.table("log", recording_columns([once, once]))
    assert len(set(table(tmp_path / "log.csv")["run"])) == 2
    for again in read_recordings(str(tmp_path / "log.csv"), ROBOT):
        np.testing.assert_allclose(again.t_s, once.t_s, atol=1e-5)
        np.testing.assert_allclose(again.angles_rad, once.angles_rad, atol=1e-6)
        np.testing.assert_allclose(again.commanded_rad_per_s, once.commanded_rad_per_s, rtol=1e-5)
        np.testing.assert_allclose(again.camera_s, once.camera_s, atol=1e-5)
        np.testing.assert_allclose(again.camera_poses, once.camera_poses, atol=1e-3)


def at_ratio(ratio: list[float]) -> Recording:
    recording = heard().recording(100.0, 102.0, None)
    recording.commanded_rad_per_s[:] = 260.0 * np.array(ratio)
    return recording


def test_each_run_is_told_what_is_to_come_and_leaves_a_description_for_it(tmp_path: Path) -> None:
    text = robots.read_description("tsd")
    runs: list[Recording] = []
    for _ in spin_ratios(3):
        robot = robots.description_of_kind(
            robots.parse_description(text, "next"), SingularityDescription
        )
        runs.append(at_ratio(robot.drive.spin_ratio or [1.0, 1.0, 1.0]))
        lines = next_run_advice(Output(tmp_path), "log.csv", text, runs)
        text = (tmp_path / "calibrate_next.toml").read_text("utf-8")
    assert not lines
    assert not missing_spin_ratios(runs)
    assert {tuple(spin_ratio_of(run)) for run in runs} == {tuple(ratio) for ratio in spin_ratios(3)}


def test_what_was_recorded_before_is_not_written_over(tmp_path: Path) -> None:
    out, log = Output(tmp_path), tmp_path / "log.csv"
    out.refuse_overwrite("log.csv", None)
    log.write_text("precious")
    with pytest.raises(TwinError, match="add to it with --log"):
        out.refuse_overwrite("log.csv", None)
    out.refuse_overwrite("log.csv", str(log))
