"""docs/codes.md has every code with its parameters and sentence, a cause and a remedy."""

from __future__ import annotations

from tests.support.codes_table import cells, words
from tests.support.markdown_pages import page, tables
from tsd_twin.messages.codes import Code


def test_every_code_has_its_row() -> None:
    codes, _ = tables(page("codes.md"))
    assert [tuple(row[:3]) for row in codes] == [cells(code) for code in Code]
    assert all(cause and remedy for *_, cause, remedy in codes)


def test_every_word_has_its_row() -> None:
    _, shown = tables(page("codes.md"))
    assert [tuple(row) for row in shown] == words()
