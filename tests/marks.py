"""Marks that tests of a file may have, read from its text: a run skips files it has no test of."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from _pytest.mark.expression import Expression

from tests.slow_tests import TESTS, listed, long_listed, shared

TIMED = {"app", "bus", "dashboard", "hardware", "link_emulation", "node", "system"}
"""Folders of tests with real-time threads, sockets or robots, except tests marked `computes`."""
WRITTEN = ("busy", "computes", "system")
"""Marks that are written in test files."""
_OF_ALL = re.compile(r"^pytestmark = .*?(?:\n\n|\Z)", re.MULTILINE | re.DOTALL)


def all_marks(path: Path, written: frozenset[str]) -> frozenset[str]:
    """Return the marks of a test: those `written` in its file, and those its folder gives."""
    folders = path.relative_to(TESTS).parts[:-1]
    if not (written & {"system"}) and (TIMED.isdisjoint(folders) or "computes" in written):
        return written
    is_program = "app" in folders and "busy" not in written
    return written | ({"timed", "programs"} if is_program else {"timed"})


@cache
def possible_marks(path: Path) -> frozenset[frozenset[str]]:
    """Return every set of marks that a test of a file may have, by the text of the file."""
    text = path.read_text("utf-8")
    of_all = "".join(_OF_ALL.findall(text))
    some = [mark for mark in WRITTEN if f"mark.{mark}" in text]
    always = {mark for mark in some if f"mark.{mark}" in of_all}
    chances = itertools.product(*({mark in always, True} for mark in some))
    return frozenset(
        all_marks(path, frozenset(itertools.compress(some, chance))) for chance in chances
    )


def may_choose(expression: str, path: Path) -> bool:
    """Return whether a mark expression, as of `pytest -m`, may choose a test of a file."""
    compiled = Expression.compile(expression)
    known = {*WRITTEN, "timed", "programs"}
    known |= {mark for mark, names in _lists().items() if not _has_one(names, path)}
    unknown = sorted(compiled.idents() - known)
    return any(
        compiled.evaluate(lambda name, all_=marks | {*others}: name in all_)
        for marks in possible_marks(path)
        for others in _subsets(unknown)
    )


def _lists() -> dict[str, frozenset[str]]:
    return {"slow": listed(), "shared": shared(), "long": long_listed()}


def _has_one(names: frozenset[str], path: Path) -> bool:
    start = f"{path.relative_to(TESTS).as_posix()}::"
    return any(name.startswith(start) for name in names)


def _subsets(names: list[str]) -> Iterator[tuple[str, ...]]:
    for count in range(len(names) + 1):
        yield from itertools.combinations(names, count)
