"""Support modules serve at least two packages; code for one package is in that package."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SUPPORT = ROOT / "tests/support"
MODULES = {path.stem for path in SUPPORT.rglob("*.py")}
MAX_MODULES = 35
FOLDERS = ("attack", "bench", "research", "scripts", "tests")
_SUPPORT = re.compile(r"\btests\.support(?:\.| import )(\w+)")
_TESTS = re.compile(r"^\s*(?:from|import) tests\.(\w+)", re.MULTILINE)


def package(path: Path) -> str:
    """Return the package of a file: its folder in `tests`, or its top folder."""
    top, *folders = path.relative_to(ROOT).parts[:-1]
    return f"{top}/{folders[0]}" if top == "tests" and folders else top


@cache
def sources() -> dict[Path, str]:
    """Return the texts of programs and tests."""
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    files += [path for path in (ROOT / "scripts").iterdir() if path.is_file()]
    return {path: path.read_text("utf-8") for path in files}


@cache
def users() -> dict[str, set[str]]:
    """Return the packages that use each support module, directly or through another one."""
    found: dict[str, set[str]] = {name: set() for name in MODULES}
    imports: dict[str, set[str]] = {}
    for path, text in sources().items():
        used = MODULES.intersection(_SUPPORT.findall(text))
        if SUPPORT in path.parents:
            imports[path.stem] = used
            continue
        for name in used:
            found[name].add(package(path))
    for _ in MODULES:
        for name, used in imports.items():
            for each in used:
                found[each] |= found[name]
    return found


@pytest.mark.parametrize("name", sorted(MODULES))
def test_support_module_serves_two_packages(name: str) -> None:
    assert len(users()[name]) >= 2, f"move {name} into {users()[name]}"


def test_support_has_few_modules() -> None:
    assert len(MODULES) <= MAX_MODULES


def test_package_imports_no_other_package_of_tests() -> None:
    packages = {path.name for path in (ROOT / "tests").iterdir() if path.is_dir()} - {"support"}
    wrong = [
        f"{path.relative_to(ROOT)} imports tests.{folder}"
        for path, text in sources().items()
        for folder in packages.intersection(_TESTS.findall(text))
        if package(path) != f"tests/{folder}"
    ]
    assert not wrong
