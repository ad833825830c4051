"""A robot kind from another package: installed with the wheel, simulated, driven and shown.

`examples/diffdrive` is such a package. The checkout is not on the path of the environment.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.page_client import Page
from tests.support.withheld import AS_OTHERS, PATIENCE_S

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples/diffdrive"
ROVER = str(EXAMPLE / "rover.toml")


def _environment() -> dict[str, str]:
    return {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}


def _run(command: list[str], folder: Path, *, succeeds: bool = True) -> str:
    """Return the output of a program started outside the checkout."""
    done = subprocess.run(
        [*AS_OTHERS, *command],
        cwd=folder, env=_environment(), capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert (done.returncode == 0) is succeeds, done.stderr
    return done.stdout if succeeds else done.stderr


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` of a new environment with the wheel of this checkout and its dependencies."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder)
    python = str(folder / "bin/python")
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(_run([python, "-c", code], folder).strip())
    ours = Path(sysconfig.get_path("purelib"))
    (site / "dependencies.pth").write_text(f"{ours}\n", "utf-8")
    _install(ROOT, folder)
    return folder / "bin"


@pytest.fixture(scope="module")
def installed(plain: Path) -> Path:
    """The same environment with the package of the kind."""
    _install(EXAMPLE, plain.parent)
    return plain


def _install(source: Path, environment: Path) -> None:
    """Build and install the wheel of a package."""
    wheels = environment / f"dist-{source.name}"
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheels)]
    subprocess.run([*AS_OTHERS, *build], cwd=source, check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python"]
    flags = ["--no-deps", "--no-index", "--ignore-installed"]
    _run([*pip, str(environment / "bin/python"), "install", *flags, str(wheel)], environment)


@contextmanager
def _started(program: Path, *flags: str) -> Iterator[str]:
    """Start a program; yield its first line, and end it by closing its input."""
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [program, *flags, "--until-eof"],
        cwd=program.parent, env=_environment(), stdin=pipe, stdout=pipe, stderr=pipe, text=True,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            yield line
        finally:
            process.stdin.close()
            process.wait(30)


@pytest.mark.system
def test_without_its_package_the_kind_is_an_error_that_names_it(plain: Path) -> None:
    code = f"import tsd_twin; tsd_twin.load_robot({ROVER!r})"
    error = _run([str(plain / "python"), "-c", code], plain, succeeds=False)
    assert "the package tsd-twin-diffdrive, which provides it, is not installed" in error
    assert "kinds are singularity, omni, sphere, imported" in error


VIRTUAL = """
import json, sys
import numpy as np
import tsd_twin
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.estimation import exponential_error
from tsd_twin.lie import SE2
from tsd_twin.models import load_parts, robot_urdf

robot = tsd_twin.load_robot(sys.argv[1])
shown, events = {}, []
with tsd_twin.SimulatedRobot(sys.argv[1]) as client, client.control("script") as base:
    client.on_event(events.append)
    base.drive(vx_mps=0.5, duration_s=1.0)
    shown["ahead"] = [client.state.odom.pose.x_m, client.state.odom.pose.y_m]
    base.drive(omega_rad_per_s=1.0, duration_s=1.0)
    shown["heading_rad"] = client.state.odom.pose.heading_rad
    before = client.state.odom.pose
    base.drive(vx_mps=0.2, vy_mps=0.2, duration_s=0.5)
    after = client.state.odom.pose
    shown["sideways_m"] = abs(after.x_m - before.x_m) + abs(after.y_m - before.y_m)
    shown["limited"] = any(event.applied == [0.0, 0.0, 0.0] for event in events)

# Of 200 noisy robots, the squared errors over their covariance are chi-square with 3 degrees.
from diffdrive.odometry import DiffDriveOdometry

total, count = 0.0, 200
many = tsd_twin.simulate(robot, (count,), seed=1, noise=1.0)
estimates = [DiffDriveOdometry(robot) for _ in range(count)]
drive = robot.kinematics()
for tick in range(400):
    turn = 0.5 if tick < 200 else -0.5
    many.command(np.tile(drive.inverse(np.array([0.4, 0.0, turn])), (count, 1)))
    many.advance(0.01)
    for estimate, joints in zip(estimates, many.measure()):
        estimate.follow(joints, np.zeros(0), None, 0.01)
for estimate, pose in zip(estimates, many.pose.xy_heading):
    off = exponential_error(estimate.pose, SE2(pose))
    total += off @ np.linalg.solve(estimate.pose_covariance + 1e-12 * np.eye(3), off)
shown["nees"] = total / count
shown["parts"] = sorted(load_parts(robot))
shown["urdf"] = "left_wheel" in robot_urdf(robot)
shown["panel"] = view_of(robot).telemetry(robot).info()["panel"]
print(json.dumps(shown))
"""


@pytest.mark.system
def test_the_robot_of_the_package_is_simulated_estimated_and_drawn(installed: Path) -> None:
    shown = json.loads(_run([str(installed / "python"), "-c", VIRTUAL, ROVER], installed))
    assert shown["ahead"][0] == pytest.approx(0.46, abs=0.05)
    assert shown["ahead"][1] == pytest.approx(0.0, abs=1e-6)
    assert shown["heading_rad"] == pytest.approx(0.95, abs=0.1)
    # Only a scale of zero removes sideways motion, which its event states.
    assert shown["sideways_m"] < 0.01
    assert shown["limited"]
    assert 2.0 < shown["nees"] < 4.5
    assert shown["parts"] == ["chassis", "wheel"]
    assert shown["urdf"]
    assert shown["panel"] == "joints"


OVER_THE_BUS = """
import json, sys
import tsd_twin

with tsd_twin.connect(sys.argv[1]) as client, client.control("script") as base:
    base.drive(vx_mps=0.4, duration_s=1.0)
    odom = client.state.odom
    print(json.dumps([odom.pose.x_m, odom.pose.y_m]))
"""


@pytest.mark.system
def test_the_robot_of_the_package_is_driven_over_the_bus(installed: Path) -> None:
    listen = ["--listen", "tcp/127.0.0.1:0"]
    with _started(installed / "tsd-mock", "--robot", ROVER, *listen) as line:
        (endpoint,) = re.findall(r"tcp/127\.0\.0\.1:\d+", line)
        python = str(installed / "python")
        x_m, y_m = json.loads(_run([python, "-c", OVER_THE_BUS, endpoint], installed))
    assert 0.1 < x_m < 0.6
    assert y_m == pytest.approx(0.0, abs=0.01)


@pytest.mark.system
def test_the_page_shows_the_panel_of_the_package(installed: Path) -> None:
    ports = ["--port", "0", "--bus-port", "0"]
    flags = ["--no-browser", "--no-record", "--robot", ROVER]
    with _started(installed / "tsd-demo", *flags, *ports) as line:
        (port,) = re.findall(r"http://\S+?:(\d+)", line)
        page = Page(int(port), "0123456789abcdef")
        try:
            card = page.until(lambda: page.last("robot"))
            assert card["panel"] == "joints"
            assert card["sideways"] is False
            names = ["left wheel", "right wheel", "curve radius"]
            assert [row["name"] for row in card["joints"]] == names
            page.make_ready()
            page.drive(vx=0.3, omega=0.5)
            rows = page.until(lambda: page.state["joints"] if _turns(page) else None)
            left, right, radius = rows
            assert right["setpoint"] > left["setpoint"] > 0.0
            assert radius["setpoint"] == pytest.approx(0.6, abs=0.05)
            page.let_go()
        finally:
            page.close()


def _turns(page: Page) -> bool:
    """Return whether the robot has reached its twist."""
    joints = page.state["joints"]
    return bool(joints) and joints[0]["value"] > 30.0 and joints[2]["setpoint"] is not None
