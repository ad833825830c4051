"""The built package is complete: programs need no file of the checkout."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from tests.built_package import build, outside_environment, pip_into, run_outside

ROOT = Path(__file__).parent.parent
NEEDED = (
    "tsd_demo.py",
    "tsd_mock.py",
    "tsd_dashboard.py",
    "tsd_link.py",
    "tsd_certs.py",
    "tsd_router.py",
    "tsd_lab.py",
    "tsd_record.py",
    "tsd_replay.py",
    "tsd_foxglove.py",
    "tsd_ros.py",
    "tsd_twin/py.typed",
    "tsd_twin/robots/tsd.toml",
    "tsd_twin/dashboard/bundle/index.html",
    "tsd_twin/dashboard/bundle/page.js",
    "tsd_twin/dashboard/bundle/page.css",
    "tsd_twin/dashboard/bundle/frame.js",
    "tsd_twin/dashboard/bundle/inter.woff2",
    "tsd_twin/dashboard/bundle/LICENSES.txt",
    "tsd_twin/dashboard/bundle/inter.LICENSE.txt",
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


@pytest.mark.system
def test_the_wheel_has_programs_robots_page_and_meshes(wheel_through_sdist: Path) -> None:
    names = set(zipfile.ZipFile(wheel_through_sdist).namelist())
    assert [name for name in NEEDED if name not in names] == []
    stls = {path.name for path in (ROOT / "meshes/tsd").glob("*.stl")}
    assert {f"tsd_twin/meshes/tsd/{name}" for name in stls} <= names
    assert [name for name in names if name.startswith("web/") or "node_modules" in name] == []


@pytest.mark.system
def test_what_the_wheel_holds_finds_its_own_files(
    wheel_through_sdist: Path, tmp_path: Path
) -> None:
    """Unpacked elsewhere and first on the path, it needs no file of the checkout."""
    shutil.unpack_archive(wheel_through_sdist, tmp_path, "zip")
    code = (
        "from tsd_twin import models, robots; import tsd_twin;"
        "folder = models.shipped_model('tsd'); assert (folder / 'tsd.urdf').is_file();"
        "print(tsd_twin.__file__, folder, robots.load_robot('tsd').name);"
        "from tsd_twin.errors import install_command; print(install_command('mujoco'))"
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
    assert shlex.split(answer.splitlines()[-1]) == [
        *(sys.executable, "-m", "pip", "install"),
        "tsd-twin[mujoco]",
    ]


@pytest.fixture(scope="module")
def installed(wheel_through_sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` of a new environment with the wheel, sharing the dependencies of this one.

    They are added to the path as a folder, whose `.pth` files are ignored, so the editable install
    of the checkout there is not visible. The wheel's dependencies are not shown to suffice.
    """
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder)
    python = folder / "bin/python"
    answer = _run(
        [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], folder
    )
    ours = Path(sysconfig.get_path("purelib"))
    (Path(answer.strip()) / "dependencies.pth").write_text(f"{ours}\n", "utf-8")
    # Without --ignore-installed it would replace the checkout.
    flags = ["--no-deps", "--no-index", "--ignore-installed"]
    _run([*pip_into(python), "install", *flags, str(wheel_through_sdist)], folder)
    return folder / "bin"


def _run(command: list[str], folder: Path) -> str:
    """Return the output of a program started outside the checkout."""
    done = run_outside(command, folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


WRONG = """
import tsd_twin

with tsd_twin.connect() as robot, robot.control("script") as base:
    base.drive(vx_mps="0.5", duration_s=1.0)
    print(robot.state.odom.pose.x_mm)
"""


@pytest.mark.system
def test_a_type_checker_reads_the_types_of_the_wheel(installed: Path, tmp_path: Path) -> None:
    """With the installed package, examples have no errors, and two mistakes are found."""
    for name in ("01_drive.py", "02_go_to.py", "08_ask_for_control.py"):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    strict = {"typeCheckingMode": "strict", "reportMissingTypeStubs": False}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(strict), encoding="utf-8")
    pyright = Path(sys.executable).with_name("pyright")
    flags = ["--outputjson", "--pythonpath", str(installed / "python")]
    done = run_outside([str(pyright), *flags], tmp_path)
    found = json.loads(done.stdout)["generalDiagnostics"]
    assert {Path(each["file"]).name for each in found} == {"wrong.py"}, found
    rules = {each["rule"] for each in found}
    assert {"reportArgumentType", "reportAttributeAccessIssue"} <= rules, found


@pytest.mark.system
def test_the_installed_wheel_sees_nothing_of_the_checkout(installed: Path) -> None:
    modules = "tsd_mock.__file__, tsd_twin.__file__"
    code = f"import json, sys, tsd_mock, tsd_twin; print(json.dumps([sys.path, {modules}]))"
    path, *files = json.loads(_run([str(installed / "python"), "-c", code], installed))
    assert not {str(ROOT), str(ROOT / "src"), str(ROOT / "app")} & set(path)
    assert all(Path(file).is_relative_to(installed.parent) for file in files)


@pytest.mark.system
def test_the_installed_program_explains_itself_and_runs_a_robot(installed: Path) -> None:
    mock = str(installed / "tsd-mock")
    assert "A simulated robot on the bus." in _run([mock, "--help"], installed)
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [mock, "--listen", "tcp/127.0.0.1:0", "--until-eof"],
        cwd=installed, env=outside_environment(), stdin=pipe, stdout=pipe, stderr=pipe, text=True,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        ready = process.stdout.readline()
        process.stdin.close()
        assert process.wait(30) == 0
    assert ready.startswith("ready: ")
    assert "tcp/127.0.0.1:" in ready
