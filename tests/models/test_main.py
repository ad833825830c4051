"""The generator as a command."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsd_twin.models import shipped_model
from tsd_twin.models.__main__ import main
from tsd_twin.robots import read_description


def test_a_shipped_robot_is_written_where_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tsd", "--to", str(tmp_path)]) == 0
    expected = sorted(path.name for path in shipped_model("tsd").iterdir())
    assert sorted(path.name for path in tmp_path.iterdir()) == expected
    assert capsys.readouterr().out.startswith(f"{tmp_path}: ")


def test_anyones_robot_goes_into_a_folder_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(read_description("tsd").replace('name = "tsd"', 'name = "mine"', 1))
    monkeypatch.chdir(tmp_path)
    assert main([str(file)]) == 0
    assert (tmp_path / "meshes" / "mine" / "mine.urdf").is_file()


def test_an_unknown_robot_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tds"]) == 1
    written = capsys.readouterr()
    assert "no such robot, did you mean 'tsd'?" in written.err
    assert written.err.count("\n") == 1
    assert not written.out
