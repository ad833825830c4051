"""docs/codes.md has every code with its parameters and sentence, a cause and a remedy."""

from __future__ import annotations

from tests.support.markdown_pages import page, tables
from tsd_twin.messages.codes import PARAMETERS, Code, Type
from tsd_twin.messages.sentences import TEMPLATES, WORDS


def cells(code: Code) -> tuple[str, str, str]:
    """Code, parameters and sentence of a code, as the page shows them."""
    parameters = ", ".join(_parameter(*each) for each in PARAMETERS[code].items())
    return f"`{code}`", parameters, f"`{TEMPLATES[code].replace('|', ' or ')}`"


def _parameter(name: str, kind: Type) -> str:
    if kind is Type.CAUSE:
        return f"`{name}`"
    return f"`{name}` {kind}"


def words() -> list[tuple[str, str, str]]:
    """Type, value and text of each word."""
    return [
        (str(kind), f"`{value}`", text)
        for kind, texts in WORDS.items()
        if kind is not Type.SERVOS
        for value, text in texts.items()
    ]


def test_every_code_has_its_row() -> None:
    codes, _ = tables(page("codes.md"))
    assert [tuple(row[:3]) for row in codes] == [cells(code) for code in Code]
    assert all(cause and remedy for *_, cause, remedy in codes)


def test_every_word_has_its_row() -> None:
    _, shown = tables(page("codes.md"))
    assert [tuple(row) for row in shown] == words()
