"""Any path on the whole robot in virtual time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.experiment_runs import is_picture, run, table
from tsd_twin.cli.experiment import Output
from tsd_twin.errors import PathError, TwinError
from tsd_twin.lab.tracking import named_path
from tsd_twin.lie import SE2, Array
from tsd_twin.sensors.pose import Camera, CameraNoise


def off(columns: dict[str, Array], of: str = "truth") -> Array:
    return np.hypot(
        columns[f"{of}_x_m"] - columns["reference_x_m"],
        columns[f"{of}_y_m"] - columns["reference_y_m"],
    )


@pytest.mark.parametrize("name", ["circle", "parabola", "sine"])
def test_paths_are_followed_within_20_mm(tmp_path: Path, name: str) -> None:
    lines = run(tmp_path, "follow", "--path", name, "--loop", "camera")
    assert "loop: camera" in lines[0]
    assert off(table(tmp_path / "follow.csv")).max() < 0.02
    assert is_picture(tmp_path / "follow.png")


def test_points_of_your_own_with_the_tangent_as_heading(tmp_path: Path) -> None:
    points = ["0.5,0", "1.5,0", "1.5,0.8"]
    flags = ["--points", *points, "--cut", "0.3", "--heading", "tangent"]
    run(tmp_path, "follow", *flags, "--loop", "gyro", "--noise", "0")
    columns = table(tmp_path / "follow.csv")
    assert off(columns).max() < 0.02
    ends = [columns[f"truth_{axis}"][[0, -1]] for axis in ("x_m", "y_m", "heading_rad")]
    np.testing.assert_allclose(np.array(ends).T, [[0.5, 0, 0], [1.5, 0.8, np.pi / 2]], atol=0.01)


def test_a_loop_that_is_closed_by_more_is_better(tmp_path: Path) -> None:
    worst = {}
    apart = {}
    for loop in ("open", "wheels", "gyro", "camera"):
        run(tmp_path, "follow", "--path", "square", "--loop", loop, "--seed", "6")
        columns = table(tmp_path / "follow.csv")
        worst[loop] = off(columns).max()
        apart[loop] = np.hypot(
            columns["truth_x_m"] - columns["estimate_x_m"],
            columns["truth_y_m"] - columns["estimate_y_m"],
        ).max()
    assert max(worst["camera"], worst["gyro"]) < worst["open"] / 3
    assert apart["camera"] < 0.01 < apart["wheels"]


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        (["--points", "0,0", "here"], "a point is two numbers"),
        (["--points", "0,0"], "two points"),
        (["--points", "0,0", "1,0", "--smooth"], "three points"),
        (["--heading", "tangent"], "sharp corner"),
        (["--share", "2"], "share"),
        (["--robot", "nope"], "no such robot"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    tmp_path: Path, flags: list[str], text: str
) -> None:
    with pytest.raises(TwinError, match=text):
        run(tmp_path, "follow", *flags)
    assert not list(tmp_path.iterdir())


def test_a_path_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(PathError, match="square, line, circle"):
        named_path("nope")


def test_a_folder_that_cannot_be_made_is_said_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out = Output(tmp_path / "file" / "lab", quiet=True)
    with pytest.raises(TwinError, match="cannot be written to"):
        out.table("a", {"x": np.zeros(2)})


def test_a_camera_is_late_and_keeps_its_frame_rate() -> None:
    camera = Camera(CameraNoise(sigma_m=0.0, sigma_rad=0.0), np.random.default_rng(0))
    known = []
    for i in range(200):
        now_s = 0.01 * i
        for frame in camera.capture(now_s, SE2(np.array([now_s, 0.0, 0.0]))):
            assert now_s - frame.taken_s >= 0.08 - 1e-9
            assert frame.pose[0] == frame.taken_s
            known.append(frame.taken_s)
    assert len(known) == pytest.approx(24 * 1.92, abs=1)
    assert 1.0 / np.diff(known).mean() == pytest.approx(24.0, rel=0.02)
