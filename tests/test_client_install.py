"""The wheel without extras: the client in an environment without other packages."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import venv
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.built_package import build, outside_environment, pip_into, run_outside
from tests.support.markdown_pages import ROOT, code, page
from tests.support.robot_node import PATIENT

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

LARGEST_MB = 120
ABSENT = ("scipy", "viser", "aiohttp", "matplotlib", "trimesh", "rosbags", "cryptography", "cv2")
EXAMPLES = (
    "01_drive.py",
    "02_go_to.py",
    "03_follow_a_path.py",
    "05_simulate_fast.py",
    "06_own_robot.py",
    "07_pose_sensor.py",
    "08_ask_for_control.py",
    "10_log_to_csv.py",
)
"""Examples that type-check without extras."""
EXTRAS = {
    "tsd-demo": "dashboard",
    "tsd-bridge": "bridge",
    "tsd-dashboard": "dashboard",
    "tsd-camera": "camera",
    "tsd-certs": "tls",
    "tsd-users": "dashboard",
    "tsd-lab": "lab",
    "tsd-record": "record",
    "tsd-replay": "record",
    "tsd-foxglove": "foxglove",
    "tsd-ros": "ros",
}
WITHOUT_EXTRA = ("tsd-mock", "tsd-link", "tsd-router")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a new environment with the wheel and its dependencies, without pip.

    Dependencies are copied from this environment, in the versions of the lock file.
    """
    dist, folder = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("environment")
    build(ROOT, "wheel", dist)
    venv.create(folder, symlinks=True)
    python = folder / "bin/python"
    flags = ["--no-deps", "--no-index", "--ignore-installed"]
    done = run_outside(
        [*pip_into(python), "install", *flags, str(next(dist.glob("*.whl")))], folder
    )
    assert done.returncode == 0, done.stderr
    (site,) = folder.glob("lib/python*/site-packages")
    (wheel,) = metadata.distributions(name="tsd-twin", path=[str(site)])
    for name in required_by(wheel):
        install_copy(name, site)
    return folder


def required_by(wheel: metadata.Distribution) -> set[str]:
    """Names of all packages that a distribution requires without extras."""
    found: set[str] = set()
    waiting = [wheel]
    while waiting:
        for text in waiting.pop().requires or []:
            requirement = Requirement(text)
            wanted = requirement.marker is None or requirement.marker.evaluate({"extra": ""})
            if wanted and requirement.name not in found:
                found.add(requirement.name)
                waiting.append(metadata.distribution(requirement.name))
    return found


def install_copy(name: str, site: Path) -> None:
    """Copy the files of an installed package, except its scripts."""
    for file in metadata.distribution(name).files or []:
        if ".." not in file.parts:
            (site / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(str(file.locate()), site / file)


def test_client_takes_less_than_120_megabytes(client: Path) -> None:
    files = [path for path in client.rglob("*") if path.is_file() and not path.is_symlink()]
    assert any(path.suffix == ".pyc" and "numpy" in path.parts for path in files)
    assert sum(path.stat().st_size for path in files) < LARGEST_MB * 1e6


def test_dependencies_of_the_wheel_suffice(client: Path) -> None:
    done = run_outside([*pip_into(client / "bin/python"), "check"], client)
    assert done.returncode == 0, done.stdout


def test_client_is_imported_without_the_packages_of_extras(client: Path) -> None:
    script = (
        "import importlib.util, tsd_twin; tsd_twin.connect, tsd_twin.SimulatedRobot;"
        f"print([name for name in {ABSENT} if importlib.util.find_spec(name)])"
    )
    done = run_outside([str(client / "bin/python"), "-c", script], client)
    assert done.stdout.strip() == "[]", done.stderr


def test_every_program_is_listed() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert set(settings["project"]["scripts"]) == {*EXTRAS, *WITHOUT_EXTRA}
    assert set(EXTRAS.values()) <= set(settings["project"]["optional-dependencies"])


@pytest.mark.parametrize("program", EXTRAS)
def test_program_without_its_extra_names_it(client: Path, program: str) -> None:
    module = [str(client / "bin/python"), "-m", program.replace("-", "_")]
    needed = f"'tsd-twin[{EXTRAS[program]}]'"
    begin = f"{program} needs the extra `{EXTRAS[program]}`: "
    for command in ([str(client / "bin" / program)], module):
        done = run_outside(command, client)
        assert done.returncode == 2
        assert done.stderr == f"{begin}{client / 'bin/python'} -m pip install {needed}\n"


@pytest.mark.parametrize("program", WITHOUT_EXTRA)
def test_program_without_an_extra_runs(client: Path, program: str) -> None:
    done = run_outside([str(client / "bin" / program), "--help"], client)
    assert done.returncode == 0, done.stderr


def test_missing_feature_of_a_program_names_its_extra(client: Path) -> None:
    flags = ["--listen", "tcp/127.0.0.1:0", "--plant", "mujoco"]
    done = run_outside([str(client / "bin/tsd-mock"), *flags], client)
    assert done.returncode == 2
    assert "needs the extra `mujoco`" in done.stderr
    assert done.stderr.count("\n") == 1


def test_lines_of_the_readme_drive_a_mock(client: Path, tmp_path: Path) -> None:
    script = code(page("../README.md"), "python")[0]
    (tmp_path / "tsd.toml").write_text(PATIENT, "utf-8")
    flags = ["--robot", "tsd.toml", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [str(client / "bin/tsd-mock"), *flags],
        cwd=tmp_path, env=outside_environment(), stdin=pipe, stdout=pipe, text=True,
    ) as mock:  # fmt: skip
        assert mock.stdin is not None
        assert mock.stdout is not None
        endpoint = mock.stdout.readline().split()[-1]
        script = script.replace("connect()", f"connect('{endpoint}')")
        done = run_outside([str(client / "bin/python"), "-c", script], client)
        mock.stdin.close()
        assert mock.wait(30) == 0
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("PlanarPose(x_m=0.")


WRONG = """
import tsd_twin

with tsd_twin.connect() as robot, robot.control("script") as base:
    base.drive(vx_mps="0.5", duration_s=1.0)
    print(robot.state.odom.pose.x_mm)
"""


def test_mypy_reads_the_types_of_the_wheel(client: Path, tmp_path: Path) -> None:
    for name in EXAMPLES:
        shutil.copy(ROOT / "examples" / name, tmp_path / f"example_{name}")
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    mypy = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull]
    files = sorted(path.name for path in tmp_path.glob("*.py"))
    done = run_outside([*mypy, "--python-executable", str(client / "bin/python"), *files], tmp_path)
    lines = [line for line in done.stdout.splitlines() if ": error:" in line]
    assert all(line.startswith("wrong.py") for line in lines), done.stdout
    assert [line.split("[")[-1] for line in lines] == ["arg-type]", "attr-defined]"], done.stdout
