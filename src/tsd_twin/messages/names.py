"""Display names of operators, in any script; the bus identifies operators by id."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from types import MappingProxyType

NAME_LENGTH = 40
"""Maximum number of code points of a display name."""
MAX_NAMES = 8
"""Operators whose names a robot keeps; each status repeats them."""
_ID_LENGTH = 20
"""Maximum length of a name within an id."""
_JOINERS = frozenset("\u200c\u200d")
"""Format characters that Persian, Indic scripts and emoji need; all others are removed."""
_IN_IDS = frozenset("abcdefghijklmnopqrstuvwxyz0123456789_")


def display_name(text: str) -> str:
    """Return a name as it may be shown: NFC, one line, at most 40 code points, or "".

    Control characters and marks of text direction are removed, since they would change the text
    around the name.
    """
    kept = "".join(each if _is_shown(each) else " " * each.isspace() for each in text)
    name = " ".join(unicodedata.normalize("NFC", kept).split()).strip(" \u200c\u200d")
    end = NAME_LENGTH
    while end < len(name) and end > 0 and _continues(name[end]):
        end -= 1  # Do not cut a letter from its marks.
    return name[: end or NAME_LENGTH].strip(" \u200c\u200d")


def id_of_name(text: str) -> str:
    """Return a name as part of an id on the bus, or "" if it has letters beyond accented Latin.

    Accents are dropped, other characters become dashes: `Jörg B.` is `jorg-b`. A name in another
    script would lose letters, and a part of a name is worse than none.
    """
    plain = unicodedata.normalize("NFKD", display_name(text)).lower()
    base = "".join(each for each in plain if not unicodedata.combining(each))
    if any(each.isalpha() and each not in _IN_IDS for each in base):
        return ""
    spelled = "".join(each if each in _IN_IDS else "-" for each in base)
    return "-".join(filter(None, spelled.split("-")))[:_ID_LENGTH].rstrip("-")


def _is_shown(character: str) -> bool:
    return character in _JOINERS or unicodedata.category(character)[0] in "LMNPS"


def _continues(character: str) -> bool:
    return unicodedata.category(character)[0] == "M" or character in _JOINERS


class OperatorNames:
    """Display names of the most recent operators by id; a name grants no rights."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    @property
    def by_id(self) -> Mapping[str, str]:
        """Names by operator id."""
        return MappingProxyType(self._names)

    def learn(self, operator: str, text: str, *, replace: bool = True) -> None:
        """Keep the name of an operator; without `replace`, only if it has none yet."""
        name = display_name(text)
        if not operator or not name or (not replace and operator in self._names):
            return
        self._names.pop(operator, None)
        self._names[operator] = name
        while len(self._names) > MAX_NAMES:
            del self._names[next(iter(self._names))]
