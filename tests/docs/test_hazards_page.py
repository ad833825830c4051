"""Code and tests named in docs/hazards.md exist."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest

from tests.support.markdown_pages import ROOT, page, quoted, tables

(ROWS,) = tables(page("hazards.md"))


def test_there_are_many_and_each_is_named_once() -> None:
    causes = [row[0] for row in ROWS]
    assert len(causes) >= 18
    assert len(set(causes)) == len(causes)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_the_rule_is_in_a_file_and_a_test_proves_it(row: list[str]) -> None:
    _, _, _, code, test = row
    (module,) = quoted(code)
    folder = ROOT if module.startswith("web/") else ROOT / "src/tsd_twin"
    assert (folder / module).is_file(), f"{module} is not there"
    ((file, _, name),) = [place.partition("::") for place in quoted(test)]
    assert name in functions_of(file), f"{file} has no {name}"


@cache
def functions_of(file: str) -> set[str]:
    """Return the names of the tests in a file, which the page writes as sentences."""
    if file.startswith("web/"):
        return set(
            re.findall(r'^ *test\("([^"]+)"', (ROOT / file).read_text("utf-8"), re.MULTILINE)
        )
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
