"""The hint about a missing extra is a command for the environment of the program."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.markdown_pages import ROOT
from tsd_twin.errors import MissingExtraError, install_command


def test_in_a_checkout_it_is_installed_again_with_the_extra() -> None:
    words = shlex.split(install_command("mujoco"))
    assert words == [sys.executable, "-m", "pip", "install", "-e", f"{ROOT}[mujoco]"]
    hint = str(MissingExtraError("The plant `mujoco`", "mujoco"))
    assert hint == f"The plant `mujoco` needs the extra `mujoco`: {install_command('mujoco')}"


def command_of(package: Path) -> list[str]:
    """Return the hinted command of a package that is first on the path of another process."""
    code = "from tsd_twin.errors import install_command; print(install_command('mujoco'))"
    flags = [sys.executable, "-S", "-c", code]
    printed = subprocess.run(
        flags, env={"PYTHONPATH": str(package)}, check=True, capture_output=True, text=True
    )
    return shlex.split(printed.stdout)


def test_a_checkout_with_a_space_in_its_path_is_one_argument(tmp_path: Path) -> None:
    checkout = tmp_path / "my robots"
    (checkout / "src/tsd_twin").mkdir(parents=True)
    for name in ("__init__.py", "errors.py"):
        shutil.copy(ROOT / "src/tsd_twin" / name, checkout / "src/tsd_twin")
    shutil.copy(ROOT / "pyproject.toml", checkout)
    assert command_of(checkout / "src")[-2:] == ["-e", f"{checkout}[mujoco]"]
