"""systemd units, and the server setup command run in a folder instead of the root."""

from __future__ import annotations

import configparser
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.markdown_pages import ROOT

DEPLOY = ROOT / "deploy"
UNITS = sorted(DEPLOY.glob("*.service"))
SERVER = ("tsd-certs", "tsd-router", "tsd-dashboard", "tsd-record")


class Unit(configparser.RawConfigParser):
    """systemd unit; repeated keys are joined by newlines."""

    def __init__(self, file: Path) -> None:
        super().__init__(strict=False)
        text = file.read_text("utf-8").replace("\\\n", "")
        self.credentials = dict(
            line.partition("=")[2].split(":", 1)
            for line in text.splitlines()
            if line.startswith("LoadCredential=")
        )
        self.read_string(text)


@pytest.mark.parametrize("file", UNITS, ids=lambda file: file.stem)
def test_a_unit_has_an_own_user_no_new_privileges_and_a_read_only_system(file: Path) -> None:
    unit = Unit(file)
    service = unit["Service"]
    assert f"u {service['User']} " in (DEPLOY / "tsd-twin.sysusers.conf").read_text("utf-8")
    assert service["NoNewPrivileges"] == "yes"
    assert service["ProtectSystem"] == "strict"
    assert service["CapabilityBoundingSet"] == ""
    users = [Unit(other)["Service"]["User"] for other in UNITS]
    assert len(set(users)) == len(users)


@pytest.mark.parametrize("file", UNITS, ids=lambda file: file.stem)
@pytest.mark.system
def test_the_flags_of_a_unit_are_flags_of_its_program(file: Path) -> None:
    unit = Unit(file)
    program, *flags = shlex.split(unit["Service"]["ExecStart"])
    used = {flag for flag in flags if flag.startswith("--")}
    shown = subprocess.run(
        [sys.executable, "-m", Path(program).name.replace("-", "_"), "--help"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert used <= set(re.findall(r"--[a-z-]+", shown))
    named = re.findall(r"\$\{CREDENTIALS_DIRECTORY\}/(\S+)", unit["Service"]["ExecStart"])
    assert set(named) <= set(unit.credentials)


@pytest.mark.parametrize("file", UNITS, ids=lambda file: file.stem)
@pytest.mark.system
def test_systemd_reads_a_unit(file: Path, tmp_path: Path) -> None:
    text = re.sub(
        r"^ExecStart=\S+", f"ExecStart={sys.executable}", file.read_text("utf-8"), flags=re.M
    )
    copy = tmp_path / file.name
    copy.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [str(shutil.which("systemd-analyze")), "verify", "--man=no", str(copy)],
        capture_output=True,
        text=True,
    )
    complaints = [line for line in done.stderr.splitlines() if copy.name in line]
    assert complaints == []


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """Folder of our programs, as in a virtual environment."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("tsd-certs", "tsd-users"):
        script = folder / name
        module = name.replace("-", "_")
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n')
        script.chmod(0o755)
    return folder


def set_up(root: Path, programs: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(DEPLOY / "setup_server"), *arguments],
        env=os.environ | {"ROOT": str(root), "TSD_BIN": str(programs)},
        input="correct horse battery\n", capture_output=True, text=True,
    )  # fmt: skip


@pytest.mark.system
def test_one_command_makes_what_the_units_need_and_again_keeps_it(
    tmp_path: Path, programs: Path
) -> None:
    root = tmp_path / "root"
    done = set_up(root, programs, "lab.example", "lab1,lab2", "alice")
    assert done.returncode == 0, done.stderr
    for name in SERVER:
        unit = Unit(root / f"etc/systemd/system/{name}.service")
        for file in unit.credentials.values():
            assert (root / file.removeprefix("/")).is_file(), file
    keys = root / "etc/tsd-twin/keys"
    assert keys.stat().st_mode & 0o066 == 0
    private = {file.name for file in keys.iterdir() if not file.stat().st_mode & 0o004}
    assert private == {file.name for file in keys.iterdir() if file.suffix in (".key", ".sign")}
    assert '"renewal": "https://lab.example:7449"' in (keys / "lab1.json5").read_text("utf-8")
    for name in SERVER:
        start = Unit(root / f"etc/systemd/system/{name}.service")["Service"]["ExecStart"]
        for file in re.findall(r"/etc/tsd-twin/keys/\S+", start):
            assert (root / file.removeprefix("/")).is_file(), file
    before = {file.name: file.read_bytes() for file in keys.iterdir()}

    again = set_up(root, programs, "lab.example", "lab1,lab2,lab3", "alice")
    assert again.returncode == 0, again.stderr
    changed = {name for name, data in before.items() if (keys / name).read_bytes() != data}
    assert changed == {"router.json5"}
    assert "lab3.pem" in {file.name for file in keys.iterdir()}
    users = (root / "etc/tsd-twin/users.toml").read_text("utf-8")
    assert users.count("[users.alice]") == 1
    assert '"lab1", "lab2"' in users
