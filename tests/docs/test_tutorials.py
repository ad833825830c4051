"""The tutorials work as written: files load, scripts run, columns exist."""

from __future__ import annotations

import csv
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import tsd_twin
from tests.support.experiment_runs import run
from tests.support.markdown_pages import code, page, quoted, section, tables
from tsd_twin import errors, robots
from tsd_twin.client import errors as client_errors
from tsd_twin.errors import RobotFileError, TwinError
from tsd_twin.messages import errors as message_errors
from tsd_twin.robots import parse_description, read_description

TUTORIAL = page("own_robot.md")


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Write the reader's copy of `kiwi` with the lines of the page."""
    (lines,) = code(TUTORIAL, "toml")
    kiwi = read_description("kiwi")
    kept = kiwi[kiwi.index("\n[limits]") :]
    assert kiwi.index("[drive]") < kiwi.index("[limits]")
    file = tmp_path / "my.toml"
    file.write_text(lines + kept, encoding="utf-8")
    return file


def printed(script: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_five_wheeled_robot_drives_straight(own: Path) -> None:
    with tsd_twin.SimulatedRobot(str(own), seed=0) as robot, robot.control() as base:
        base.drive(vx_mps=0.3, duration_s=2.0)
        x_m, y_m, heading_rad = robot.state.odom.pose
    assert len(tsd_twin.load_robot(str(own)).kinematics().joints) == 5
    assert x_m == pytest.approx(0.6, abs=0.1)
    assert (y_m, heading_rad) == pytest.approx((0.0, 0.0), abs=0.01)


def test_its_wheels_are_compared_by_the_script(own: Path) -> None:
    (script,) = code(TUTORIAL, "python")
    lines = printed(script, own.parent).splitlines()
    assert len(lines) == 3 * 6
    # Turning left, all wheels drive counter-clockwise: 0.12 m x 1 rad/s over 0.029 m.
    turning = [float(re.findall(r"[-+]\d+\.\d+", line)[0]) for line in lines[13:]]
    assert turning == pytest.approx([0.12 / 0.029] * 5, abs=0.01)


def test_the_mistake_is_told_as_shown(own: Path) -> None:
    (shown,) = code(TUTORIAL, "text")
    text = own.read_text("utf-8").replace("wheel_radius_m = 0.029", "wheel_radius_m = 29")
    with pytest.raises(RobotFileError) as caught:
        parse_description(text, "my.toml")
    assert f"tsd-demo: {caught.value}\n" == shown


def test_what_a_driver_needs_of_the_kinematics_is_had_as_shown(tmp_path: Path) -> None:
    shown = printed(code(page("own_hardware.md"), "python")[1], tmp_path)
    assert "'wheel1', 'wheel2', 'wheel3'" in shown
    assert "20.0 0.8" in shown
    twist = [float(number) for number in re.findall(r"-?\d\.\d*(?:e-\d+)?", shown.splitlines()[1])]
    assert twist == pytest.approx([0.3, 0.0, 0.5], abs=1e-9)


def test_joints_have_the_order_and_units_of_the_table() -> None:
    rows = tables(section(page("own_hardware.md"), "## Units and joint order"))[0]
    for row in rows:
        kind = quoted(row[0])[0]
        described = next(
            robot
            for robot in map(robots.load_robot, robots.robot_names())
            if isinstance(robot, robots.DESCRIPTIONS[kind])
        )
        names = [joint.name for joint in described.kinematics().joints]
        shown = [name for name in quoted(row[1]) if not name.startswith("drive.")]
        assert names[: len(shown)] == shown
        assert {sensor.name for sensor in described.sensors} <= set(quoted(row[3]))


def test_the_figure_has_the_columns_and_is_drawn(tmp_path: Path) -> None:
    text = page("paper_figure.md")
    command = shlex.split(code(text, "sh")[0])
    folder = tmp_path / command[command.index("--out") + 1]
    run(folder, *command[1 : command.index("--out")])
    with (folder / "square.csv").open(encoding="utf-8") as file:
        columns = next(csv.reader(file))
    explained = [name for row in tables(text)[0] for name in quoted(row[0])]
    assert sorted(explained) == sorted(columns)
    (script,) = code(text, "python")
    printed(script, tmp_path)
    assert (tmp_path / "square.pdf").read_bytes().startswith(b"%PDF")


def test_every_error_is_on_its_page() -> None:
    shown = {quoted(row[0])[0] for row in tables(page("reference/errors.md"))[1]}
    named = {
        name
        for module in (errors, client_errors, message_errors)
        for name, kind in vars(module).items()
        if isinstance(kind, type)
        and issubclass(kind, TwinError)
        and kind is not TwinError
        and not {client_errors.ClientError, message_errors.MessageError}.intersection(
            kind.__mro__[1:]
        )
    }
    assert shown == named | {"LinkError", "HardwareError"}
