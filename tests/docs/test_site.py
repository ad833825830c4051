"""The documentation site is complete, linked and readable offline."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import tsd_twin
from tests.support.markdown_pages import ROOT, code, page, quoted, tables, without_code

PAGES = [path.relative_to(ROOT / "docs") for path in sorted(ROOT.glob("docs/**/*.md"))]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOADED = {"script": "src", "img": "src", "link": "href"}
"""Elements that load the URL in an attribute."""


class Elements(HTMLParser):
    """Collects the elements of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.formulas = 0
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value for name, value in attrs if value}
        self.ids |= {attributes[name] for name in ("id", "name") if name in attributes}
        if tag == "a" and "href" in attributes:
            self.links.append(attributes["href"])
        if LOADED.get(tag) in attributes:
            self.loaded.append(attributes[LOADED[tag]])
        self.formulas += tag == "math"


def build(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as built by `make docs`, with warnings as errors."""
    folder = tmp_path_factory.mktemp("site")
    built = build("scripts/build_docs", "--out", str(folder))
    assert built.returncode == 0, built.stderr
    return folder


@pytest.fixture(scope="module")
def elements(site: Path) -> dict[Path, Elements]:
    return {file: Elements(file) for file in site.rglob("*.html")}


def test_every_link_of_the_site_leads_somewhere(elements: dict[Path, Elements]) -> None:
    lost: list[str] = []
    for file, found in elements.items():
        for link in (*found.links, *found.loaded):
            url = urlsplit(link)
            if url.scheme:
                continue
            target = (file.parent / unquote(url.path)).resolve() if url.path else file
            heading = unquote(url.fragment)
            known = not heading or heading in elements[target].ids if target in elements else True
            if not target.exists() or not known:
                lost.append(f"{file.name}: {link}")
    assert lost == []


def test_nothing_is_loaded_from_another_host(site: Path, elements: dict[Path, Elements]) -> None:
    loaded = {link for found in elements.values() for link in found.loaded}
    assert len(loaded) > 20
    assert [link for link in loaded if urlsplit(link).netloc] == []
    styles = "".join(file.read_text(encoding="utf-8") for file in site.rglob("*.css"))
    assert re.findall(r"@import|url\(['\"]?(?:https?:)?//", styles) == []


def test_every_page_is_in_the_navigation(elements: dict[Path, Elements], site: Path) -> None:
    home = elements[site / "index.html"].links
    missing = [path for path in PAGES if path.with_suffix(".html").as_posix() not in home]
    assert [str(path) for path in missing] == ["index.md"]


def test_every_public_name_is_in_the_reference(elements: dict[Path, Elements], site: Path) -> None:
    documented = elements[site / "reference/api.html"].ids
    public = {f"tsd_twin.{name}" for name in tsd_twin.__all__ if name != "__version__"}
    assert not public - documented
    assert {"tsd_twin.RobotControl.drive", "tsd_twin.RobotClient.control"} <= documented


PROGRAMS = [*PROJECT["scripts"], "tsd-lab square"]
_HELP = """
import importlib, os, sys
for program in sys.argv[1:]:
    module, *command = program.split()
    main = importlib.import_module(module).main
    sys.stdout.flush()
    if os.fork() == 0:  # A parser gets its flags once.
        sys.argv = [module, *command, "--help"]
        main()
    os.wait()
    print("\\f", end="")
"""
"""Prints the help of each program from one process, which imports shared modules once."""


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    modules = [program.replace("tsd-", "tsd_", 1) for program in PROGRAMS]
    done = build(sys.executable, "-c", _HELP, *modules)
    assert done.returncode == 0, done.stderr
    return dict(zip(PROGRAMS, done.stdout.split("\f")[:-1], strict=True))


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_flag_that_help_shows_is_in_the_reference(
    program: str, helps: dict[str, str], elements: dict[Path, Elements], site: Path
) -> None:
    flags = re.findall(r"^  (?:-\w, )?(--[a-z-]+)", helps[program], re.MULTILINE)
    assert "--help" in flags
    ids = elements[site / "reference/commands.html"].ids
    assert [
        flag for flag in flags if f"cmdoption-{program.replace(' ', '-')}{flag[1:]}" not in ids
    ] == []


@pytest.mark.parametrize("path", PAGES, ids=str)
def test_every_formula_is_shown_as_one(
    path: Path, elements: dict[Path, Elements], site: Path
) -> None:
    text = (ROOT / "docs" / path).read_text(encoding="utf-8")
    prose = re.sub(r"`[^`]*`", "", without_code(text))
    formulas = len(re.findall(r"\$[^$]+\$", prose)) + len(code(text, "math"))
    assert elements[site / path.with_suffix(".html")].formulas == formulas


def test_links_to_source_lead_to_the_web_when_an_address_is_known(tmp_path: Path) -> None:
    """A broken link fails the build."""
    for name in ("conf.py", "_site"):
        (tmp_path / name).symlink_to(ROOT / "docs" / name)
    home = tmp_path / "index.md"
    home.write_text("# Home\n\n[the node](../src/tsd_twin/node)\n", encoding="utf-8")
    sphinx = (sys.executable, "-m", "sphinx", "-q", "-W", "-D", "source_url=https://web.example/x")
    assert build(*sphinx, str(tmp_path), str(tmp_path / "out")).returncode == 0
    assert "https://web.example/x/src/tsd_twin/node" in Elements(tmp_path / "out/index.html").links
    home.write_text("# Home\n\n[a page](gone.md)\n", encoding="utf-8")
    failed = build(*sphinx, str(tmp_path), str(tmp_path / "out"))
    assert failed.returncode != 0
    assert "gone.md" in failed.stderr


def test_every_message_of_troubleshooting_is_one_of_ours() -> None:
    files = [*ROOT.glob("src/tsd_twin/**/*.py"), *ROOT.glob("app/*.py"), ROOT / "Makefile"]
    source = "\n".join(file.read_text(encoding="utf-8") for file in files)
    source = re.sub(r'"\s*\n\s*f?"', "", source)  # Implicitly concatenated literals.
    messages = [quoted(row[0])[0] for rows in tables(page("troubleshooting.md")) for row in rows]
    shells = {"command not found"}
    parts = {part.strip().lower() for text in messages for part in text.split("...")}
    assert {part for part in parts if part not in source.lower()} == shells
