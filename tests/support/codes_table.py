"""Rows of docs/codes.md that follow from the tables: code, parameters, sentence."""

from __future__ import annotations

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
