"""docs/lab.md shows the output of `tsd-lab`."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from research.__main__ import EXPERIMENTS as STUDIES
from tests.support.experiment_runs import run
from tests.support.markdown_pages import page, quoted, section, tables
from tsd_lab import EXPERIMENTS
from tsd_twin.lab.observer import Loop
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.sensors.pose import CameraNoise

PAGE = page("lab.md")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
RUNS = re.findall(
    r"```sh\n((?:tsd-lab|python -m research) [^\n]*)\n```\n\n```text\n(.*?)\n```", PAGE, re.DOTALL
)


def test_every_experiment_is_in_the_table() -> None:
    assert {quoted(row[0])[0] for row in tables(PAGE)[0]} == {
        *(f"tsd-lab {e.name}" for e in EXPERIMENTS),
        *(f"python -m research {e.name}" for e in STUDIES),
    }


@pytest.mark.parametrize(("command", "shown"), RUNS, ids=[command for command, _ in RUNS])
def test_what_is_shown_is_what_is_printed(tmp_path: Path, command: str, shown: str) -> None:
    name, *flags = shlex.split(command.replace("python -m research", "tsd-lab"))[1:]
    printed = "\n".join(run(tmp_path, name, *flags))
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    # Sums round differently on other processors, and the simulation amplifies that.
    numbers = [[float(n) for n in NUMBER.findall(text)] for text in (printed, shown)]
    assert numbers[0] == pytest.approx(numbers[1], rel=0.03, abs=0.02), printed


def test_the_loops_and_their_noise_are_those_of_the_code() -> None:
    rows = {
        quoted(row[0])[0]: row[1] for row in tables(section(PAGE, "## The square of the thesis"))[0]
    }
    assert list(rows) == [loop.value for loop in Loop]
    gyro, camera = Gyro(), CameraNoise()
    assert f"{gyro.noise_rad_per_s} rad/s, offset {gyro.bias_rad_per_s} rad/s" in rows["gyro"]
    assert (
        f"{camera.rate_hz:g} frames a second, {1000 * camera.latency_s:g} ms late" in rows["camera"]
    )
    assert f"{1000 * camera.sigma_m:g} mm and {camera.sigma_rad} rad" in rows["camera"]
