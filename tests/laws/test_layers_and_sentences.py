"""Source rules: no layer names a higher one, and no program parses English."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src/tsd_twin"
PROGRAMS = sorted((*PACKAGE.rglob("*.py"), *(ROOT / "app").glob("*.py")))
SCRIPTS = [
    path for path in sorted((ROOT / "web/src").rglob("*.ts*")) if "generated" not in path.parts
]
OF_LIBRARIES = {
    "config.py": "errors of Zenoh have no codes",
    "program.py": "errors of argparse have no codes",
}
"""Files that parse texts of libraries, with reasons."""
_PHRASE = re.compile(r"\b[a-z']{2,}[ ,]+[a-z']{2,}\b", re.IGNORECASE)
"""Two consecutive words, which no id, code, key or name contains."""
_TESTS_OF_TEXT = frozenset(
    ("startswith", "endswith", "find", "index", "count", "partition", "removeprefix", "split")
)
_JS_TEST_OF_TEXT = re.compile(
    r"""(?:[=!]==\s*|\b(?:includes|startsWith|endsWith|indexOf|split|search|match|test)\()"""
    r"""(?P<text>"[^"\n]*"|'[^'\n]*'|`[^`\n]*`|/[^/\n]+/)|(?P<regex>/[^/\n*]+/)\.(?:test|exec)\("""
)


def ranks() -> dict[str, int]:
    """Return the rank of each package and module, lowest layer first."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = (
        contract["layers"]
        for contract in project["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == ["tsd_twin"] and contract["type"] == "layers"
    )
    return {
        name.strip(): rank for rank, line in enumerate(reversed(layers)) for name in line.split("|")
    }


def names_of_packages(text: str) -> Iterator[str]:
    """Yield the packages named in a text, as modules or as folders."""
    for dotted, folder in re.findall(r"\btsd_twin\.(\w+)|\b(\w+)/(?:\w+/)*\w+\.(?:py|js)\b", text):
        yield dotted or folder


def test_no_layer_names_a_higher_one_in_a_string() -> None:
    rank = ranks()
    found = []
    for path in PACKAGE.rglob("*.py"):
        own = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if own not in rank:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found += [
                    f"{path.relative_to(ROOT)}:{node.lineno} names {name}"
                    for name in names_of_packages(node.value)
                    if rank.get(name, -1) > rank[own]
                ]
    assert not found


def english_tests(tree: ast.AST) -> Iterator[int]:
    """Yield the lines that compare a text with an English phrase or search for one."""
    for node in ast.walk(tree):
        operands: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            is_re = isinstance(node.func.value, ast.Name) and node.func.value.id == "re"
            if is_re or node.func.attr in _TESTS_OF_TEXT:
                operands = node.args
        elif isinstance(node, ast.MatchValue):
            operands = [node.value]
        for operand in operands:
            parts = getattr(operand, "elts", getattr(operand, "values", [operand]))
            texts = [str(part.value) for part in parts if isinstance(part, ast.Constant)]
            if any(map(_PHRASE.search, texts)):
                yield node.lineno


def test_no_program_compares_a_text_with_english() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in PROGRAMS
        if path.name not in OF_LIBRARIES
        for line in english_tests(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not found, "decide by the code of a reason, not by its sentence"


def english_tests_of_script(text: str) -> Iterator[int]:
    """Yield the lines of a script that compare a text with an English phrase."""
    for number, line in enumerate(text.splitlines(), 1):
        for match in _JS_TEST_OF_TEXT.finditer(line):
            if _PHRASE.search(match["text"] or match["regex"]):
                yield number


def test_no_script_of_the_page_compares_a_text_with_english() -> None:
    assert SCRIPTS
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in SCRIPTS
        for line in english_tests_of_script(path.read_text(encoding="utf-8"))
    ]
    assert not found, "decide by the code of a reason, not by its sentence"


@pytest.mark.parametrize(
    "line",
    [
        'if "has control" in text: ...',
        'if text == "take control first": ...',
        're.match(r"the robot is (\\w+)", text)',
        'text.startswith("no command for")',
        'match text:\n    case "let go first": ...',
    ],
)
def test_python_that_reads_english_is_found(line: str) -> None:
    assert list(english_tests(ast.parse(line)))


@pytest.mark.parametrize(
    "line",
    [
        'if (text.includes("has control")) {',
        'if (why === "take control first") {',
        "const held = /(.+) has control/.exec(why);",
        "why.match(/no command for (\\d+)/)",
    ],
)
def test_script_that_reads_english_is_found(line: str) -> None:
    assert list(english_tests_of_script(line))
