"""Calibrate a simulated machine with random errors and compare the result with the truth."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run
from tsd_twin import robots
from tsd_twin.calibration.report import edit_description
from tsd_twin.errors import TwinError

TEXT = robots.read_description("tsd")


class Calibrated(NamedTuple):
    folder: Path
    lines: list[str]


def figures(folder: Path) -> dict[str, dict[str, float]]:
    """Return the rows of the table by name, with NaN for empty cells."""
    with (folder / "calibrate.csv").open(newline="", encoding="utf-8") as file:
        return {
            row["name"]: {
                key: float(row[key] or "nan") for key in ("before", "found", "sigma", "true")
            }
            for row in csv.DictReader(file)
        }


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    """One calibrated machine, with its description in `my.toml`."""
    folder = tmp_path_factory.mktemp("machine")
    written = str(folder / "my.toml")
    return Calibrated(folder, run(folder, "calibrate", "--seed", "1", "--write-to", written))


def assert_found(rows: dict[str, dict[str, float]]) -> None:
    """Check errors against 0.05° and 0.5 %, and against the stated sigma.

    The sigma check allows for the layers of printed wheels, which change a radius by up to 0.25 %.
    """
    for name, row in rows.items():
        angle = name.endswith(("alpha", "beta"))
        bound = 0.05 if angle else 0.005 * row["true"]
        assert abs(row["found"] - row["true"]) < bound, name
        layers = 0.01 if angle else 0.0025 * row["true"]
        assert abs(row["found"] - row["true"]) < 5.0 * row["sigma"] + layers, name
    before = [abs(row["before"] - row["true"]) for name, row in rows.items() if "alpha" in name]
    assert max(before) > 0.05  # The initial error was significant.


def test_zeros_radii_and_spins_are_found(machine: Calibrated) -> None:
    rows = figures(machine.folder)
    assert len(rows) == 11
    assert_found(rows)
    assert is_picture(machine.folder / "calibrate.png")
    assert any("mm RMS before" in line for line in machine.lines)


@pytest.mark.parametrize(("seed", "errors"), [("7", "0"), ("8", "2")])
def test_so_they_are_of_other_machines_better_or_worse_built(
    tmp_path: Path, seed: str, errors: str
) -> None:
    run(tmp_path, "calibrate", "--seed", seed, "--errors", errors)
    assert_found(figures(tmp_path))


def test_a_recorded_log_says_what_the_drive_itself_said_also_when_clocks_disagree(
    machine: Calibrated, tmp_path: Path
) -> None:
    """The camera clock is 30 ms behind, and poses are in separate rows."""
    with (machine.folder / "calibrate_log.csv").open(newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    poses = [names.index(name) for name in ("x_m", "y_m", "heading_rad")]
    seen = [[*row[:1], str(float(row[1]) - 0.03), *row[2:]] for row in rows]
    for row in seen:
        row[2 : poses[0]] = [""] * (poses[0] - 2)
    for row in rows:
        row[poses[0] :] = ["nan"] * 3
    with (tmp_path / "log.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, *rows, *seen])
    lines = run(tmp_path, "calibrate", "--log", str(tmp_path / "log.csv"))
    (lag,) = [line.split() for line in lines if line.startswith("the joints lag the camera by")]
    # The errors in the description include a delay of 5 ms.
    assert float(lag[6]) == pytest.approx(35.0, abs=5.0 * float(lag[8]))
    again, first = figures(tmp_path), figures(machine.folder)
    for name, row in first.items():
        assert again[name]["found"] == pytest.approx(row["found"], abs=row["sigma"]), name
        assert np.isnan(again[name]["true"])


def test_what_is_written_is_what_was_found_and_comments_stay(machine: Calibrated) -> None:
    text = (machine.folder / "my.toml").read_text("utf-8")
    robot = robots.description_of_kind(
        robots.load_robot(str(machine.folder / "my.toml")), robots.SingularityDescription
    )
    rows = figures(machine.folder)
    assert robot.drive.wheel_radius_m == pytest.approx(rows["wheel_radius"]["found"], rel=1e-4)
    assert robot.calibration.tilt_offset_deg[1][0] == pytest.approx(
        rows["module2_alpha"]["found"], abs=1e-3
    )
    assert robot.calibration.spin_scale[2] == pytest.approx(rows["module3_spin"]["found"], rel=1e-4)
    changed = set(text.splitlines()) - set(TEXT.splitlines())
    assert {line.split(" = ")[0] for line in changed} == {
        "pivot_radius_m", "wheel_radius_m", "[calibration]", "tilt_offset_deg", "spin_scale",
        "motor_share",
    }  # fmt: skip
    sigma = [rows[name]["sigma"] / rows[name]["found"] for name in ("wheel_radius", "module1_spin")]
    assert robot.errors.motor_share == pytest.approx(math.hypot(*sigma), rel=0.05)
    assert robot.errors.motor_share < 0.01


def test_at_one_speed_three_directions_of_six_zeros_are_not_told(tmp_path: Path) -> None:
    lines = run(tmp_path, "calibrate", "--seed", "1", "--same-speed", "--no-tachometer")
    told = lines.index("not observable from these data, so kept as small as possible:")
    assert len(lines) - told - 1 == 3
    assert any("wheel radius times the speed" in line for line in lines)
    rows = figures(tmp_path)
    # The reported sigma shows it: much of the 1° prior remains for every beta zero.
    assert min(row["sigma"] for name, row in rows.items() if "beta" in name) > 0.3
    # Only the product of wheel radius and common spin is observable.
    product = [
        rows["wheel_radius"][which] * np.mean([rows[f"module{i}_spin"][which] for i in (1, 2, 3)])
        for which in ("found", "true")
    ]
    assert product[0] == pytest.approx(product[1], rel=0.005)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t_s,x_m\n1,2\n", "no column module1_alpha_rad"),
        ("t_s\nsoon\n", "cannot be read as a log"),
        ("", "no column t_s"),
    ],
)
def test_a_log_that_is_none_is_refused_in_a_sentence(tmp_path: Path, text: str, says: str) -> None:
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(TwinError, match=says):
        run(tmp_path, "calibrate", "--log", str(log))


def test_a_log_without_poses_is_refused(machine: Calibrated, tmp_path: Path) -> None:
    lines = (machine.folder / "calibrate_log.csv").read_text().splitlines()[:200]
    log = tmp_path / "log.csv"
    blind = [line.rpartition(",")[0] + "," for line in lines[1:]]
    log.write_text("\n".join([lines[0], *blind]))
    with pytest.raises(TwinError, match="two poses or more"):
        run(tmp_path, "calibrate", "--log", str(log))


def test_other_layouts_of_a_description_are_edited_as_well() -> None:
    before, _, after = TEXT.partition("[battery]")
    text = f"{before}[{after.partition('[')[2]}"
    text = "battery.nominal_v = 12.0 # Three cells.\n" + text
    changed = edit_description(text, "my.toml", {"calibration": {"spin_scale": [1.0, 1.1, 1.0]}})
    assert "battery.nominal_v = 12.0 # Three cells.\n" in changed
    assert robots.parse_description(changed, "my.toml") != robots.parse_description(text, "my.toml")
    again = edit_description(changed, "my.toml", {"calibration": {"spin_scale": [1.0, 1.0, 1.2]}})
    assert again.count("[calibration]") == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (robots.read_description("kiwi"), "singularity is needed here"),
        (TEXT.replace("[motor]", "[motr]"), "did you mean 'motor'"),
        ("[[[", "not valid TOML"),
    ],
)
def test_what_is_no_such_description_is_left_alone(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "my.toml"
    file.write_text(text)
    with pytest.raises(TwinError, match=says):
        edit_description(
            file.read_text(), str(file), {"calibration": {"spin_scale": [1.0, 1.0, 1.0]}}
        )


def test_impossible_figures_are_not_written() -> None:
    with pytest.raises(TwinError, match=r"calibration.spin_scale has 2 entries"):
        edit_description(TEXT, "my.toml", {"calibration": {"spin_scale": [1.0, 1.0]}})
