"""Committed meshes match the generator; folders can be written, read, and be invalid."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
import trimesh

from tsd_twin.errors import MeshError
from tsd_twin.models import (
    load_parts,
    read_model,
    robot_urdf,
    shipped_model,
    urdf,
    write_model,
)
from tsd_twin.robots import load_robot, robot_names

TSD = ("chassis", "outer", "inner", "wheel")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a copy of the committed files of the `tsd` robot."""
    return Path(shutil.copytree(shipped_model("tsd"), tmp_path / "tsd"))


@pytest.mark.parametrize("name", robot_names())
def test_committed_files_are_what_the_generator_makes(name: str, tmp_path: Path) -> None:
    write_model(load_robot(name), tmp_path)
    generated = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    committed = {path.name: path.read_bytes() for path in shipped_model(name).iterdir()}
    assert sorted(generated) == sorted(committed)
    different = [file for file in generated if generated[file] != committed[file]]
    assert not different, f"run python -m tsd_twin.models {name}"


def test_the_urdf_of_a_robot_of_ones_own_is_drawn() -> None:
    shipped = load_robot("tsd")
    heavier = msgspec.structs.replace(shipped.mass, total_kg=shipped.mass.total_kg + 1.0)
    own = msgspec.structs.replace(shipped, mass=heavier)
    assert robot_urdf(own) == urdf(own, load_parts(own)) != robot_urdf(shipped)
    mecanum = msgspec.structs.replace(load_robot("mecanum"), name="tsd")
    assert robot_urdf(mecanum) == urdf(mecanum, load_parts(mecanum))


@pytest.mark.parametrize("name", robot_names())
def test_what_a_robot_is_not_drawn_by_is_not_read_by_what_draws(name: str) -> None:
    """So a calibrated robot has the URDF of the original, which is the drawn one."""
    robot = load_robot(name)
    # Sensor tables are checked when a description is created.
    fields = robot.not_drawn & set(robot.__struct_fields__) - {"sensor_tables"}
    unread = {field: object() for field in fields}
    assert len(unread) >= 6
    own = msgspec.structs.replace(robot, **unread)
    assert robot_urdf(own) == robot_urdf(robot) == urdf(own, load_parts(own))


def test_a_robot_node_starts_without_what_draws() -> None:
    """Its URDF is a file, and loading the drawing modules would take half of its start."""
    code = """
import json, sys, tsd_bridge, tsd_mock
from tsd_twin import models, robots
texts = {name: models.robot_urdf(robots.load_robot(name)) for name in robots.robot_names()}
print(json.dumps([texts, list(sys.modules)]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    texts, loaded = json.loads(done.stdout)
    assert texts == {
        name: (shipped_model(name) / f"{name}.urdf").read_text("utf-8") for name in robot_names()
    }
    assert "tsd_twin.node" in loaded
    assert not set(loaded) & {"trimesh", "scipy", "matplotlib"}


@pytest.mark.parametrize("name", robot_names())
def test_committed_files_are_small(name: str) -> None:
    assert sum(path.stat().st_size for path in shipped_model(name).iterdir()) <= 1_000_000


@pytest.mark.parametrize("name", robot_names())
def test_committed_meshes_are_closed_and_have_no_flat_triangles(name: str) -> None:
    """Also after merging corners at the same place, as every STL reader does."""
    for path in shipped_model(name).glob("*.stl"):
        mesh = trimesh.load_mesh(path)
        assert mesh.is_volume, path.name
        assert mesh.area_faces.min() > 0.0, path.name


def test_what_was_written_is_read(tmp_path: Path) -> None:
    robot = load_robot("tsd")
    write_model(robot, tmp_path)
    drawn, back = load_parts(robot), read_model(tmp_path, TSD)
    assert tuple(back) == TSD
    for link in TSD:
        for a, b in zip(drawn[link], back[link], strict=True):
            assert (a.name, a.link, a.material) == (b.name, b.link, b.material)
            assert b.mesh.volume == pytest.approx(a.mesh.volume, rel=1e-4)
            np.testing.assert_allclose(b.mesh.bounds, a.mesh.bounds, atol=1e-7)


def test_a_folder_of_own_meshes_replaces_the_drawing(folder: Path) -> None:
    own = trimesh.creation.box((0.1, 0.2, 0.3))
    (folder / "wheel_shell.stl").write_bytes(own.export(file_type="stl"))
    robot = load_robot("tsd")
    body = msgspec.structs.replace(robot.body, meshes=str(folder))
    shown = load_parts(msgspec.structs.replace(robot, body=body))
    shell = next(part for part in shown["wheel"] if part.name == "shell")
    np.testing.assert_allclose(np.ptp(shell.mesh.bounds, axis=0), (0.1, 0.2, 0.3), rtol=1e-6)


def test_a_missing_mesh_is_named(folder: Path) -> None:
    (folder / "outer_belt.stl").unlink()
    with pytest.raises(MeshError, match=r"outer_belt\.stl cannot be read"):
        read_model(folder, TSD)


def test_a_mesh_with_a_hole_is_named(folder: Path) -> None:
    open_box = trimesh.creation.box()
    open_box.update_faces(np.arange(12) > 0)
    (folder / "outer_belt.stl").write_bytes(open_box.export(file_type="stl"))
    with pytest.raises(MeshError, match="outer_belt is not a closed solid"):
        read_model(folder, TSD)


def test_a_file_that_is_no_mesh_is_named(folder: Path) -> None:
    (folder / "outer_belt.stl").write_bytes(b"\x00" * 20)
    with pytest.raises(MeshError, match=r"outer_belt"):
        read_model(folder, TSD)


def test_a_list_without_a_link_says_which(folder: Path) -> None:
    entries = json.loads((folder / "parts.json").read_text())
    kept = [entry for entry in entries if entry["link"] != "inner"]
    (folder / "parts.json").write_text(json.dumps(kept))
    with pytest.raises(MeshError, match="no part for inner"):
        read_model(folder, TSD)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('"roughness"', '"ruffness"', "unknown field `ruffness`"),
        ('"link": "wheel"', '"link": "weel"', "weel"),
        ('"name": "shell"', '"name": "../shell"', r"\$\[\d+\]\.name"),
    ],
)
def test_a_misspelt_list_says_where(folder: Path, old: str, new: str, problem: str) -> None:
    text = (folder / "parts.json").read_text()
    assert old in text
    (folder / "parts.json").write_text(text.replace(old, new))
    with pytest.raises(MeshError, match=problem):
        read_model(folder, TSD)


def test_a_folder_without_a_list_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"parts\.json cannot be read"):
        read_model(tmp_path, TSD)


def test_meshes_that_do_not_come_with_the_program_are_an_error() -> None:
    with pytest.raises(MeshError, match="no meshes of 'nobody'"):
        shipped_model("nobody")
