"""Every script in `examples/` is short, runs, and shows the result in its first line."""

from __future__ import annotations

import csv
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

import tsd_twin
from tests.support.markdown_pages import ROOT
from tests.support.programs import Program, mock_robot, run_script
from tests.support.viser_client import Node, ViserClient, viser_client
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.client.state import PlanarPose

FOLDER = ROOT / "examples"
SCRIPTS = sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.fixture(scope="module")
def mock() -> Generator[Program]:
    with mock_robot() as it:
        yield it


@pytest.fixture(scope="module")
def endpoint(mock: Program) -> str:
    return mock.ready().split()[-1]


def run(name: str, folder: Path, *arguments: str) -> str:
    """Run a script in `folder` as working directory, and return its output."""
    return run_script(FOLDER / f"{name}.py", folder, *arguments)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", text.replace(",", ""))]


def test_there_are_thirteen_and_each_is_tested_here() -> None:
    assert [int(name[:2]) for name in SCRIPTS] == list(range(1, 14))
    tested = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in SCRIPTS if f'"{name}"' not in tested] == []


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_is_short_and_says_first_what_one_sees(name: str) -> None:
    lines = (FOLDER / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert 8 <= len(lines) <= (80 if name == "13_own_dashboard" else 40)
    assert re.fullmatch(r'"""[A-Z].*\."""', lines[0])


def test_the_first_has_twelve_lines_at_most() -> None:
    assert len((FOLDER / "01_drive.py").read_text(encoding="utf-8").splitlines()) <= 12


@pytest.mark.system
def test_drive(endpoint: str, tmp_path: Path) -> None:
    with tsd_twin.connect(endpoint) as robot:
        before = robot.state.odom.pose
        run("01_drive", tmp_path, endpoint)
        after = robot.state.odom.pose
    assert math.dist(before[:2], after[:2]) == pytest.approx(0.5, abs=0.15)
    assert after.heading_rad - before.heading_rad == pytest.approx(1.0, abs=0.3)


@pytest.mark.system
def test_go_to(endpoint: str, tmp_path: Path) -> None:
    lines = run("02_go_to", tmp_path, endpoint).splitlines()
    corners = [(0.5, 0.0, 135.0), (0.5, 0.5, -135.0), (0.0, 0.5, -45.0), (0.0, 0.0, 45.0)]
    for line, (x_m, y_m, heading_deg) in zip(lines, corners, strict=True):
        x, y, heading = numbers(line)
        assert math.dist((x, y), (x_m, y_m)) < 0.05
        assert math.remainder(heading - heading_deg, 360.0) == pytest.approx(0.0, abs=5.0)


@pytest.mark.system
def test_follow_a_path(endpoint: str, tmp_path: Path) -> None:
    off_mm, points = numbers(run("03_follow_a_path", tmp_path, endpoint))
    assert points == 59
    assert off_mm < 100.0


@pytest.mark.system
def test_read_and_plot(endpoint: str, tmp_path: Path) -> None:
    (states,) = numbers(run("04_read_and_plot_state", tmp_path, endpoint).split(" in ")[0])
    assert states > 60
    assert (tmp_path / "state.png").read_bytes().startswith(b"\x89PNG")


def test_simulate_fast(tmp_path: Path) -> None:
    x_m, x_mm, y_mm, count, times = numbers(run("05_simulate_fast", tmp_path))
    assert x_m == pytest.approx(2.0, abs=0.1)
    assert 10.0 < x_mm < 200.0
    assert 10.0 < y_mm < 200.0
    assert count == 1000
    assert times > 100.0


def test_own_robot(tmp_path: Path) -> None:
    said = run("06_own_robot", tmp_path)
    assert "wheel1, wheel2, wheel3, wheel4" in said
    *_, x_m, y_m, heading_rad = numbers(said)
    assert (x_m, y_m, heading_rad) == pytest.approx((1.5, 0.3, 1.57), abs=0.03)


def test_pose_sensor(tmp_path: Path) -> None:
    without_mm, with_mm = numbers(run("07_pose_sensor", tmp_path))
    assert with_mm < 0.2 * without_mm


@pytest.mark.system
def test_ask_for_control(endpoint: str, tmp_path: Path) -> None:
    said = run("08_ask_for_control", tmp_path, endpoint).splitlines()
    assert said == ["alice has control", "bob asks for control", "bob has control"]
    # The refusal ends the script, because Bob does not wait for Alice.
    command = [sys.executable, str(FOLDER / "08_ask_for_control.py"), endpoint]
    with tsd_twin.connect(endpoint) as robot, robot.control("carol", arm=False):
        refused = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S
        )
    assert refused.returncode == 1
    assert "ControlDenied" in refused.stderr


def test_gimbal_angles(tmp_path: Path) -> None:
    (angle_deg,) = numbers(run("09_gimbal_angles", tmp_path))
    assert 2.0 < angle_deg < 4.0
    assert (tmp_path / "gimbals.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.system
def test_log_to_csv(endpoint: str, tmp_path: Path) -> None:
    run("10_log_to_csv", tmp_path, endpoint)
    with (tmp_path / "log.csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head[:5] == ["stamp_s", "mode", "x_m", "y_m", "heading_rad"]
    assert "module1_alpha" in head
    assert len(rows) > 60
    assert {len(row) for row in rows} == {len(head)}


@pytest.fixture(scope="module")
def recording(endpoint: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recording of 0.5 m of driving, which ends with a stop."""
    folder = str(tmp_path_factory.mktemp("drives"))
    recorder = Program(["tsd_record", "--connect", endpoint, "--dir", folder])
    try:
        path = Path(recorder.ready().split()[-1])
        end_s = time.monotonic() + PATIENCE_S
        while path.stat().st_size < 3000:
            assert time.monotonic() < end_s, "nothing is recorded"
            time.sleep(0.05)
        with tsd_twin.connect(endpoint) as robot, robot.control("script") as base:
            base.drive(vx_mps=0.5, duration_s=1.0)
            robot.stop("enough")
            robot.sleep(0.3)
            base.reset()
    finally:
        recorder.end()
        recorder.clean_up()
    return path


@pytest.mark.system
def test_read_a_recording(recording: Path, tmp_path: Path) -> None:
    way_m, duration_s = numbers(run("11_read_a_recording", tmp_path, str(recording)))
    assert way_m == pytest.approx(0.5, abs=0.15)
    assert duration_s > 2.0
    assert (tmp_path / "way.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.system
def test_stops_in_a_recording(recording: Path, tmp_path: Path) -> None:
    (line,) = run("12_stops_in_a_recording", tmp_path, str(recording)).splitlines()
    assert "From ready to stopped: enough." in line
    assert line.endswith("Told before: (0.00, 0.00) m/s script.")


@pytest.mark.system
def test_own_dashboard(endpoint: str, tmp_path: Path) -> None:
    command = [sys.executable, str(FOLDER / "13_own_dashboard.py"), endpoint]
    script = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        assert script.stdout is not None
        address = next(line for line in script.stdout if line.startswith("open http"))
        with tsd_twin.connect(endpoint) as robot:
            with viser_client(int(address.rsplit(":", 1)[1])) as viewer:
                drive_by_sliders(robot, viewer)
            until(robot, lambda: robot.state.mode == "ready")  # The browser is closed.
            until(robot, lambda: abs(robot.state.odom.twist.vx_mps) < 0.01)
            script.terminate()
            until(robot, lambda: robot.state.lease.holder is None)
    finally:
        script.kill()
        script.communicate(timeout=PATIENCE_S)


def drive_by_sliders(robot: tsd_twin.RobotClient, viewer: ViserClient) -> None:
    """Press the buttons, and leave the robot driving after a stop and a reset."""
    viewer.until(lambda: viewer.control("Release"))
    viewer.set("Take control", True)
    until(robot, lambda: robot.state.lease.holder is not None)
    # By rolling: sin(tilt) = v / (r_w omega), all of it alpha where forward is tangential.
    tilt_rad = math.asin(0.3 / (0.04 * 2500.0 * math.pi / 30.0))
    viewer.set("Forward (m/s)", 0.3)  # Shows the inverse kinematics, and must not start a motion.
    for round_ in range(2):
        viewer.set("Arm", True)
        until(robot, lambda: robot.state.mode == "ready")
        viewer.until(lambda: viewer.control("Forward (m/s)").value == 0.0)
        start = robot.state.odom.pose
        robot.sleep(0.3)
        assert robot.state.odom.pose == pytest.approx(start, abs=0.005)
        viewer.set("Forward (m/s)", 0.3)
        until(robot, lambda: robot.state.odom.twist.vx_mps > 0.25)
        viewer.until(lambda start=start: metres_ahead(start, viewer.node("/robot")) > 0.1)
        inner = viewer.node("/robot/module1_outer/module1_inner")
        viewer.until(
            lambda inner=inner: math.isclose(
                2.0 * math.asin(abs(inner.wxyz[1])), tilt_rad, rel_tol=0.1
            )
        )
        if round_ == 0:
            viewer.set("STOP", True)
            until(robot, lambda: robot.state.mode == "stopped")
            viewer.until(lambda: viewer.control("Forward (m/s)").value == 0.0)
            robot.sleep(0.5)  # A robot that receives commands refuses a reset.
            viewer.set("Reset", True)
            until(robot, lambda: robot.state.mode == "disarmed")


def metres_ahead(start: PlanarPose, node: Node) -> float:
    """Distance of a node ahead of a pose, because earlier scripts leave any heading."""
    x_m, y_m = node.position[0] - start.x_m, node.position[1] - start.y_m
    return x_m * math.cos(start.heading_rad) + y_m * math.sin(start.heading_rad)


def until(robot: tsd_twin.RobotClient, condition: Callable[[], bool]) -> None:
    """Wait until a condition of the robot's state holds."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, robot.state
        robot.sleep(0.02)


@pytest.mark.system
def test_a_script_that_is_killed_leaves_the_robot_at_rest_within_its_allowance(
    tmp_path: Path,
) -> None:
    """`01_drive.py` is killed by SIGKILL at speed, without a zero command or a release."""
    with mock_robot(shipped=True) as mock:
        endpoint = mock.ready().split()[-1]
        command = [sys.executable, str(FOLDER / "01_drive.py"), endpoint]
        with tsd_twin.connect(endpoint) as robot:
            script = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
            try:
                for state in robot.states(PATIENCE_S):
                    assert state.truth is not None
                    if state.mode == "driving" and state.truth.twist.vx_mps > 0.4:
                        break
                    assert script.poll() is None, "it has ended before it drove"
            finally:
                os.kill(script.pid, signal.SIGKILL)
                withheld = WithheldTime(mock.process.pid, os.getpid())
                killed = robot.state
                script.wait()
            assert killed.truth is not None
            assert killed.truth.twist.vx_mps > 0.2, "it was killed too late to show anything"
            end_s = time.monotonic() + PATIENCE_S
            while robot.state.mode != "ready":
                assert time.monotonic() < end_s
                robot.sleep(0.02)
            robot.sleep(0.5)  # The joints lag behind.
            rested = robot.state
            assert rested.truth is not None
            way_m = math.dist(killed.truth.pose[:2], rested.truth.pose[:2])
            allowance_m = robot.description.limits.stop_allowance_m
            assert way_m <= allowance_m + killed.truth.twist.vx_mps * withheld.total_s
            with WithheldTime(mock.process.pid, os.getpid()) as withheld:
                states = list(robot.states(2.0))
            seen = [state.truth.pose[:2] for state in states if state.truth is not None]
            assert len(seen) > 50 - 50.0 * withheld.total_s
            assert max(math.dist(pose, rested.truth.pose[:2]) for pose in seen) < 0.002
            # The lease has expired, so another program may drive.
            with robot.control("next", take_over=False) as base:
                base.drive(vx_mps=-0.2, duration_s=0.3)
