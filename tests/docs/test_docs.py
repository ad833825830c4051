"""Links resolve, drawings match their scripts, and the documented layers match the linter's."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import tsd_twin
from tests.support.markdown_pages import ROOT, anchors, code, links, page, without_code
from tests.support.withheld import PATIENCE_S
from tsd_twin.client.errors import RobotStopped

FOLDERS = ("", "docs/", "docs/reference/", "meshes/", "firmware/", "firmware/simulator/")
PAGES = [path for folder in FOLDERS for path in ROOT.glob(f"{folder}*.md")]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for link in links(text):
        if "://" in link:
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        assert target.exists(), f"{link} leads nowhere"
        assert ROOT in target.parents, f"{link} leads out of the project"
        if anchor:
            assert anchor in anchors(target.read_text(encoding="utf-8")), f"{link}: no such heading"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_inline_formula_has_an_escape_that_markdown_eats(path: Path) -> None:
    prose = without_code(path.read_text(encoding="utf-8"))
    for formula in re.findall(r"\$([^$\n]+)\$", prose):
        assert not re.search(r"\\[^A-Za-z]", formula), formula


def test_every_page_is_linked_from_the_home_page_or_the_readme() -> None:
    listed = {link.partition("#")[0] for link in links(page("index.md"))}
    readme = {link.partition("#")[0] for link in links((ROOT / "README.md").read_text("utf-8"))}
    assert "docs/index.md" in readme
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/**/*.md")}
    assert not pages - listed - {link.removeprefix("docs/") for link in readme}


def test_the_drawings_are_what_their_scripts_draw(tmp_path: Path) -> None:
    """Includes modes.svg, which is drawn from the robot's mode table."""
    subprocess.run([sys.executable, str(ROOT / "docs/img/draw"), str(tmp_path)], check=True)
    drawn = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    committed = {
        path.name: path.read_text(encoding="utf-8") for path in ROOT.glob("docs/img/*.svg")
    }
    assert drawn == committed, "run: python docs/img/draw"


def test_the_layers_on_the_page_are_those_that_are_checked() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (layers,) = [c["layers"] for c in contracts if c.get("containers") == ["tsd_twin"]]
    (shown,) = code(page("architecture.md"), "text")
    assert shown.splitlines() == ["app", *layers]


@pytest.mark.system
def test_the_program_with_an_own_robot_io_runs_and_drives(tmp_path: Path) -> None:
    """Start it as in the docs, on a free port, and drive it with a script."""
    text = code(page("own_hardware.md"), "python")[0]
    (tmp_path / "my_robot.py").write_text(text, encoding="utf-8")
    flags = ["--listen", "tcp/127.0.0.1:0", "--until-eof"]
    command = [sys.executable, str(tmp_path / "my_robot.py"), *flags]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as node:
        assert node.stdin is not None
        assert node.stdout is not None
        try:
            endpoint = node.stdout.readline().split()[-1]
            with tsd_twin.connect(endpoint) as robot:
                for left in (2, 1, 0):
                    try:
                        with robot.control("script") as base:
                            base.drive(vx_mps=0.2, duration_s=0.5)
                        break
                    except RobotStopped:  # Starved, this process sent no messages.
                        if left == 0:
                            raise
                assert robot.state.odom.pose.x_m > 0.05
        finally:
            node.stdin.close()
        assert node.wait(timeout=PATIENCE_S) == 0


def test_every_folder_of_the_package_has_its_row() -> None:
    folders = {path.parent.name for path in (ROOT / "src/tsd_twin").glob("*/*.py")}
    linked = {Path(link).name for link in links(page("architecture.md"))}
    assert folders <= linked, "docs/architecture.md says what each folder is"


def test_contributing_and_the_readme_are_short() -> None:
    for name, longest in (("CONTRIBUTING.md", 30), ("README.md", 120)):
        assert len((ROOT / name).read_text(encoding="utf-8").splitlines()) <= longest
