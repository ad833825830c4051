"""From camera self-calibration to the square of the thesis, with real programs.

Drives a mock with all errors of a built robot and gimbal zeros off by 0.3°, under a simulated
camera that uses its own calibration result.
"""

from __future__ import annotations

import csv
import re
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture
from tests.support.programs import Program
from tests.support.robot_node import PATIENT
from tsd_twin import robots
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation.gimbal_actuation import Actuation

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(600)]

Start = Callable[..., Program]
BUILT = re.sub(r"zero_deg = \S+", "zero_deg = 0.3", PATIENT)
SEED = "3"
CAMERA = ("--simulate", "--seed", SEED)
GUIDED = ("--drive", "--yes", "--quiet", "--room", "2.84", "--speed", "1")


@contextmanager
def on_the_bus(start: Start, toml: Path, machine: Path, camera: Path) -> Generator[str]:
    """Run a machine, its controller configured by `toml`, under the camera; yield the endpoint."""
    mock = start(
        "tsd_mock", "--robot", str(toml), "--machine", str(machine), "--noise", "1",
        "--errors", "1", "--seed", SEED, "--listen", "tcp/127.0.0.1:0",
    )  # fmt: skip
    endpoint = mock.ready().split()[-1]
    watching = start(
        "tsd_camera", *CAMERA, "--file", str(camera), "--connect", endpoint, "--tag", "3=tsd"
    )
    watching.ready()
    yield endpoint
    assert watching.end(signal.SIGTERM) == 0, watching.sentence
    assert mock.end(signal.SIGTERM) == 0, mock.sentence


def lab(start: Start, endpoint: str, experiment: str, out: Path, *flags: str) -> list[str]:
    """Run a guided drive to its end; return its output."""
    program = start(
        "tsd_lab", experiment, *GUIDED, "--connect", endpoint, "--out", str(out), *flags
    )
    assert program.process.wait(200.0) == 0, program.sentence
    program.wait()
    return program.output


def errors_mm(lines: list[str]) -> list[float]:
    """Return RMS in time, largest distance from the path, and closure."""
    (line,) = [line for line in lines if line.startswith("RMS")]
    return [float(number) for number in re.findall(r"(\S+) mm", line)]


def test_a_robot_is_calibrated_and_drives_the_square_by_its_camera(
    start: Start, tmp_path: Path
) -> None:
    camera, toml, mine = (tmp_path / f"{name}.toml" for name in ("ceiling", "built", "mine"))
    toml.write_text(BUILT)
    for step in ("lens", "floor"):
        assert start("tsd_camera", "calibrate", step, *CAMERA, "--file", str(camera)).wait() == 0
    used, before, lines = toml, tuple[str, ...](), list[str]()
    for i in range(4):
        out = tmp_path / f"run{i}"
        with on_the_bus(start, used, used, camera) as endpoint:
            write = ("--write-to", str(mine)) if i == 3 else ()
            lines = lab(start, endpoint, "calibrate", out, *before, *write)
        used, before = out / "calibrate_next.toml", ("--log", str(out / "calibrate_log.csv"))
    assert lines[0].startswith("tsd: 4 runs")
    assert is_picture(tmp_path / "run3" / "calibrate.png")

    # The true errors drawn from the seed, read from the simulated actuators.
    robot = robots.description_of_kind(
        robots.parse_description(BUILT, "built"), SingularityDescription
    )
    true = Actuation(robot.with_errors(1.0), (), seed=int(SEED), noise=1.0)
    with (tmp_path / "run3" / "calibrate.csv").open(newline="", encoding="utf-8") as file:
        found = {row["name"]: float(row["found"]) for row in csv.DictReader(file)}
    zeros = [found[f"module{i}_{part}"] for i in (1, 2, 3) for part in ("alpha", "beta")]
    assert np.abs(np.degrees(true.zero_rad)).max() > 0.2
    assert zeros == pytest.approx(np.degrees(true.zero_rad), abs=0.02)
    # Wheel speed is not measured, so only the product of speed and radius is observable.
    spins = found["wheel_radius"] * np.array([found[f"module{i}_spin"] for i in (1, 2, 3)])
    true_spins = robot.drive.wheel_radius_m * true.sound_shares
    assert spins.mean() == pytest.approx(true_spins.mean(), rel=0.003)
    assert spins == pytest.approx(true_spins, rel=0.006)
    assert found["pivot_radius"] == pytest.approx(robot.drive.pivot_radius_m, rel=0.003)

    with on_the_bus(start, mine, toml, camera) as endpoint:
        lines = lab(start, endpoint, "square", tmp_path)
    assert lines[0].startswith("tsd: square of 1.00 m in 6.")
    assert is_picture(tmp_path / "square.png")
    with (tmp_path / "square.csv").open(newline="", encoding="utf-8") as file:
        pause_s = np.diff([float(row["t_s"]) for row in csv.DictReader(file)]).max()
    # The thesis has 160 mm from the path, open loop. The first number is by time, so it includes
    # the distance driven in a pause between commands: 3.4 mm were measured with 40 ms at most.
    late_mm = 1000.0 * 0.7 * pause_s
    assert (np.array(errors_mm(lines)) < [10.0 + late_mm, 20.0, 15.0]).all(), pause_s
