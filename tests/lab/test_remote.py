"""A scripted operator drives a slalom over links: delay hurts, and prediction compensates it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run
from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.lab.remote import RemoteCase, RemoteRun, drive_slalom, link_of, max_age_s
from tsd_twin.safety.lease import speed_cap_mps

SPEED_MPS = 0.7


def drive(link: str, *, ghost: bool = False, cap: bool = False, seed: int = 0) -> RemoteRun:
    robot = robots.load_robot("tsd")
    return drive_slalom(RemoteCase(robot, link, ghost, cap, SPEED_MPS, seed))


def test_without_prediction_a_later_link_takes_the_robot_farther_off() -> None:
    off_m = [drive(f"delay={delay}ms").rms_m for delay in (1, 120, 250)]
    assert off_m == sorted(off_m)
    assert off_m[2] > 3.0 * off_m[0]


@pytest.mark.parametrize("seed", range(10, 13))
def test_the_predicted_pose_brings_a_late_operator_back_to_the_path(seed: int) -> None:
    late, predicted, direct = (
        drive("delay=250ms,jitter=5ms", seed=seed),
        drive("delay=250ms,jitter=5ms", ghost=True, seed=seed),
        drive("direct", seed=seed),
    )
    assert predicted.finished
    assert predicted.rms_m < 0.5 * late.rms_m
    assert predicted.rms_m < 1.5 * direct.rms_m


def test_the_speed_cap_of_a_slow_link_holds_for_an_operator_at_full_stick() -> None:
    link = "delay=250ms"
    capped, free = drive(link, cap=True), drive(link)
    speeds = [np.hypot(*np.diff(run.truth[:, :2], axis=0).T).max() / 0.02 for run in (capped, free)]
    cap_mps = speed_cap_mps(capped.case.robot, max_age_s(link_of(link, 0)))
    assert speeds[0] < 1.05 * cap_mps < speeds[1]
    assert capped.rms_m < free.rms_m


def test_on_a_direct_link_neither_makes_a_difference() -> None:
    runs = [drive("direct", ghost=ghost, cap=ghost) for ghost in (False, True)]
    assert runs[1].rms_m == pytest.approx(runs[0].rms_m, rel=0.1)
    assert all(run.finished and run.stops == 0 for run in runs)


def test_the_table_has_a_row_for_each_link_and_operator(tmp_path: Path) -> None:
    lines = run(tmp_path, "remote", "--link", "satellite", "--runs", "1", "--jobs", "1")
    assert [line.split(" | ")[1] for line in lines[-4:]] == [
        "as received",
        "ghost",
        "speed cap",
        "ghost and cap",
    ]
    assert is_picture(tmp_path / "remote.png")
    rows = (tmp_path / "remote.csv").read_text("utf-8").splitlines()
    assert rows[0].startswith("link,ghost,cap,seed,rms_m")
    assert len(rows) == 1 + 4


def test_a_robot_that_turns_a_sphere_drives_no_slalom(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="drives no slalom"):
        run(tmp_path, "remote", "--robot", "atlas", "--runs", "1", "--jobs", "1")
