"""What is built is whole: nothing that the programs need stays behind in the checkout."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NEEDED = (
    "tsd_demo.py",
    "tsd_mock.py",
    "tsd_dashboard.py",
    "tsd_link.py",
    "tsd_certs.py",
    "tsd_lab.py",
    "tsd_twin/robots/tsd.toml",
    "tsd_twin/dashboard/static/overlay.js",
    "tsd_twin/meshes/tsd/tsd.urdf",
)


@pytest.fixture(scope="module")
def wheel_through_sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from the source archive, as packagers do, not from the checkout."""
    folder = tmp_path_factory.mktemp("dist")
    build(ROOT, "sdist", folder)
    archive = next(folder.glob("*.tar.gz"))
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    source = folder / archive.name.removesuffix(".tar.gz")
    build(source, "wheel", folder)
    return next(folder.glob("*.whl"))


def build(source: Path, target: str, into: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(into)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)


@pytest.mark.system
def test_the_wheel_has_programs_robots_page_and_meshes(wheel_through_sdist: Path) -> None:
    names = set(zipfile.ZipFile(wheel_through_sdist).namelist())
    assert [name for name in NEEDED if name not in names] == []
    stls = {path.name for path in (ROOT / "meshes/tsd").glob("*.stl")}
    assert {f"tsd_twin/meshes/tsd/{name}" for name in stls} <= names


@pytest.mark.system
def test_what_the_wheel_holds_finds_its_own_files(
    wheel_through_sdist: Path, tmp_path: Path
) -> None:
    """Unpacked far from the checkout, and first on the path, it needs nothing of the checkout."""
    shutil.unpack_archive(wheel_through_sdist, tmp_path, "zip")
    code = (
        "from tsd_twin import models, robots; import tsd_twin;"
        "folder = models.shipped_model('tsd'); assert (folder / 'tsd.urdf').is_file();"
        "print(tsd_twin.__file__, folder, robots.load_robot('tsd').name)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(tmp_path), "PATH": ""},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert answer.count(str(tmp_path)) == 2
