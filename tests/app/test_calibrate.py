"""`tsd-lab calibrate --drive` on a robot in a separate process, under a camera."""

from __future__ import annotations

import csv
import os
import re
import select
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.bus_operator import BusOperator
from tests.support.experiment_runs import is_picture
from tests.support.programs import Program
from tests.support.robot_node import PATIENT, QUICK, running
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_mock import OverheadCamera
from tsd_twin import robots
from tsd_twin.calibration.drive_log import read_recordings
from tsd_twin.calibration.operator import watch_keys
from tsd_twin.calibration.zeroing import twist_by_zero_offsets
from tsd_twin.robots import SingularityDescription
from tsd_twin.safety.loop_watch import LATE_S
from tsd_twin.simulation import simulate

pytestmark = pytest.mark.system

Start = Callable[..., Program]
BUILT = re.sub(r"zero_deg = \S+", "zero_deg = 0.3", PATIENT)
"""The same robot, with larger gimbal errors than alignment by hand leaves."""


def drive(
    start: Start, endpoint: str, folder: Path, *flags: str, experiment: str = "calibrate"
) -> Program:
    """Drive the robot at `endpoint` without asking for confirmation."""
    return start(
        "tsd_lab", experiment, "--drive", "--yes", "--connect", endpoint, "--out", str(folder),
        *flags,
    )  # fmt: skip


def test_a_mock_under_a_camera_is_driven_and_what_is_wrong_with_it_found(
    start: Start, tmp_path: Path
) -> None:
    toml, folder = tmp_path / "built.toml", tmp_path / "lab"
    toml.write_text(BUILT)
    mock = start(
        "tsd_mock", "--robot", str(toml), "--noise", "1", "--errors", "1", "--seed", "4",
        "--camera", "--listen", "tcp/127.0.0.1:0",
    )  # fmt: skip
    endpoint = mock.ready().rpartition(" ")[2]
    lab = drive(start, endpoint, folder, "--room", "2.84", "--speed", "1", "--write-to", str(toml))
    assert lab.wait() == 0, lab.sentence
    assert is_picture(folder / "calibrate.png")
    log = folder / "calibrate_log.csv"
    # True zero angles of the simulated gimbals, from the seed.
    robot = robots.description_of_kind(
        robots.parse_description(BUILT, "built"), SingularityDescription
    )
    assert len(read_recordings(str(log), robot)) == 1
    machine = simulate(robot, seed=4, noise=1.0, errors=1.0)
    true = np.array(machine.joints).reshape(-1, 3)[:, :2]
    assert np.abs(np.degrees(true)).max() > 0.2
    with (folder / "calibrate.csv").open(newline="", encoding="utf-8") as file:
        found = {row["name"]: float(row["found"]) for row in csv.DictReader(file)}
    zeros = np.radians(
        [found[f"module{i}_{part}"] for i in (1, 2, 3) for part in ("alpha", "beta")]
    )
    # One run observes only three combinations of the six zeros, so check those to 0.03 degrees.
    creep = twist_by_zero_offsets(robot)
    off = np.abs(creep @ (zeros - true.ravel()))
    assert (off < np.radians(0.03) * np.linalg.norm(creep, axis=1)).all()
    assert found["pivot_radius"] == pytest.approx(robot.drive.pivot_radius_m, rel=0.01)
    written = robots.description_of_kind(robots.load_robot(str(toml)), SingularityDescription)
    assert written.calibration.tilt_offset_deg[0][0] == pytest.approx(
        np.degrees(zeros[0]), abs=1e-3
    )
    # Continue with a second run, which adds to the first.
    assert any(f"--log {log}" in line for line in lab.output)
    again = drive(start, endpoint, folder)
    assert again.wait() != 0
    assert "would be written over" in again.sentence


@pytest.mark.parametrize("experiment", ["calibrate", "square"])
def test_a_lab_that_is_killed_on_the_way_leaves_the_robot_at_rest(
    start: Start, tmp_path: Path, experiment: str
) -> None:
    with (
        running(toml=QUICK) as node,
        BusOperator(node) as alice,
        node.client() as bus,
        OverheadCamera(bus, node.id),
    ):
        fast = ("--room", "1.2", "--speed", "1")
        lab = drive(start, node.endpoint, tmp_path, *fast, experiment=experiment)
        alice.wait_until(lambda: lab.process.poll() or np.hypot(*alice.truth.twist[:2]) > 0.3)
        assert lab.end(signal.SIGKILL) == -signal.SIGKILL, lab.sentence
        withheld = WithheldTime()
        killed_at = alice.truth.xy_heading[:2]
        # The robot stops automatically, and its lease expires.
        alice.wait_until(lambda: alice.status.mode == "ready")
        alice.wait_until(lambda: np.abs(alice.truth.twist).max() < 0.05)
        # At 1 m/s, the robot stops within 0.31 m of the last accepted command (docs/safety.md);
        # this run is slower.
        travel_m = np.hypot(*(alice.truth.xy_heading[:2] - killed_at))
        assert travel_m < 0.35 + 1.0 * withheld.total_s
        alice.wait_until(lambda: alice.status.lease.holder is None)


@pytest.mark.parametrize("ends", ["Ctrl-C", "SIGTERM", "camera lost"])
def test_square_that_ends_on_the_way_leaves_the_robot_disarmed_and_released(
    start: Start, tmp_path: Path, ends: str
) -> None:
    with running(toml=QUICK) as node, BusOperator(node) as alice, node.client() as bus:
        camera = OverheadCamera(bus, node.id)
        with camera:
            lab = drive(start, node.endpoint, tmp_path, "--room", "1.2", experiment="square")
            alice.wait_until(lambda: lab.process.poll() or np.hypot(*alice.truth.twist[:2]) > 0.2)
            if ends != "camera lost":
                assert lab.end(signal.SIGINT if ends == "Ctrl-C" else signal.SIGTERM) != 0
        # The camera has ended.
        assert lab.wait() != 0
        says = "no pose measurement for 1.5 s" if ends == "camera lost" else "interrupted"
        assert says in lab.sentence
        alice.wait_until(lambda: alice.status.mode == "disarmed")
        alice.wait_until(lambda: alice.status.lease.holder is None)
        # The robot disarms when the commanded twist is zero; its gimbals follow.
        alice.wait_until(lambda: np.abs(alice.truth.twist).max() < 0.05)
        assert not list(tmp_path.iterdir())


def test_without_a_camera_nothing_moves(start: Start, tmp_path: Path) -> None:
    with running(toml=QUICK) as node, BusOperator(node) as alice, WithheldTime() as withheld:
        lab = drive(start, node.endpoint, tmp_path)
        assert lab.wait() != 0
        assert f"no pose measurements on twin/{node.id}/sensor/pose" in lab.sentence
        assert "\n" not in lab.sentence
        late = {"loop"} if withheld.total_s > LATE_S else set[str]()
        assert {event["kind"] for event in alice.events} <= {"pose"} | late
        assert alice.status.mode == "disarmed"


def test_a_key_is_noticed_without_enter_and_the_terminal_left_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outside, inside = os.openpty()
    with os.fdopen(inside, "r") as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        os.write(outside, b"typed ahead")
        with watch_keys() as pressed:
            assert not pressed()
            os.write(outside, b"x")
            assert select.select([terminal], [], [], PATIENCE_S)[0]
            assert pressed()
            assert not pressed()
        os.write(outside, b"a line\n")
        assert terminal.readline() == "a line\n"
    os.close(outside)
