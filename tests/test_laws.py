"""The list of laws has each test once, under the subject of its file."""

from __future__ import annotations

import itertools
from pathlib import Path
from token import NAME
from tokenize import tokenize

from tests.list_laws import TESTS, law, laws, lines


def test_list_of_laws_has_each_test_once() -> None:
    files = sorted(TESTS.rglob("test_*.py"))
    names: list[str] = []
    for file in files:
        with file.open("rb") as source:
            words = [each.string for each in tokenize(source.readline) if each.type == NAME]
        names += [b for a, b in itertools.pairwise(words) if a == "def" and b[:5] == "test_"]
    shown = [line.removeprefix("- ") for line in lines() if line.startswith("- ")]
    assert sorted(shown) == sorted(map(law, names))
    assert sum(line.startswith("\n## ") for line in lines()) == len(files)


def test_law_is_a_sentence_and_its_file_the_subject() -> None:
    subject, found = laws(Path(__file__))
    assert subject == "The list of laws has each test once, under the subject of its file."
    assert found == [
        "List of laws has each test once.",
        "Law is a sentence and its file the subject.",
        "Only the folders that are asked for are listed.",
    ]


def test_only_the_folders_that_are_asked_for_are_listed() -> None:
    topics = [line for line in lines(("safety", "bus")) if line.startswith("# ")]
    assert topics == ["# bus", "# safety"]
