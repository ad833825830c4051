"""Rules for the page texts: languages agree, every text is used, none has markup."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tsd_twin.dashboard.wire.typescript_texts import ENGLISH, LOOKED_UP, Source, places
from tsd_twin.messages.codes import PARAMETERS
from tsd_twin.messages.sentences import TEMPLATES, WORDS

ROOT = Path(__file__).parents[2]
FOLDER = ENGLISH.parent
LANGUAGES = sorted(path.stem for path in FOLDER.glob("??.json"))
OTHERS = [each for each in LANGUAGES if each != "en"]
PAGE = {
    path: path.read_text("utf-8")
    for path in sorted((ROOT / "web/src").rglob("*.ts*"))
    if path.name != "texts.ts"
}
_STRING = re.compile(r'"([^"\n]*)"')
_NAME = re.compile(r"\.(\w+)|\b(\w+):")
_TAKEN_APART = re.compile(r"\{([^{}]*)\} = ")
SENT = {
    text
    for path in sorted((ROOT / "src/tsd_twin").rglob("*.py"))
    for text in _STRING.findall(path.read_text("utf-8"))
}
"""Strings in the package, including codes, modes and labels."""
WORDS_OF_MESSAGES = set(re.findall("[a-z]+", PAGE[ROOT / "web/src/generated/wire.ts"].lower()))
UNIONS = {
    text
    for path, source in PAGE.items()
    if path.parent.name in {"generated", "store", "text"}
    for text in _STRING.findall(source)
}
"""Strings in sources that declare codes and unions, used as keys elsewhere."""
REFUSED = {text for source in PAGE.values() for text in _STRING.findall(source)}
"""Strings in all sources, including each code with which the page refuses something."""


def read(name: str) -> Source:
    source: Source = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return source


def texts(source: Source, *path: str) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield path and text of each text in a table."""
    if isinstance(source, str):
        yield path, source
        return
    pairs = source.items() if isinstance(source, dict) else enumerate(source)
    for key, each in pairs:
        yield from texts(each, *path, str(key))


@cache
def named_by(area: str) -> tuple[set[str], set[str]]:
    """Return names and strings in the folders whose sources use the texts of an area."""
    uses = re.compile(rf"texts\(\)\.{area}\b|\{{[^{{}}]*\b{area}\b[^{{}}]*\}} = texts\(\);")
    folders = {path.parent for path, text in PAGE.items() if uses.search(text)}
    source = "\n".join(text for path, text in PAGE.items() if path.parent in folders)
    names = {name for pair in _NAME.findall(source) for name in pair}
    names |= set(re.findall(r"\w+", " ".join(_TAKEN_APART.findall(source))))
    return names, set(_STRING.findall(source))


def is_used(path: tuple[str, ...]) -> bool:
    """Return whether a source in a folder using the area names the key, or others define it."""
    *table, key = (each for each in path if not each.isdigit())  # A list is used as a whole.
    if table == ["common", "refusals"]:
        return key in REFUSED
    names, strings = named_by(table[0])
    if ".".join(table) in LOOKED_UP:
        is_field = set(key.lower().split()) <= WORDS_OF_MESSAGES
        return is_field or key in SENT | strings
    return key in names | strings | UNIONS


@pytest.mark.parametrize("language", OTHERS)
def test_languages_have_the_same_texts_with_the_same_places(language: str) -> None:
    english, other = dict(texts(read("en"))), dict(texts(read(language)))
    assert list(other) == list(english)
    differ = {path for path in english if set(places(english[path])) != set(places(other[path]))}
    assert differ == set()


@pytest.mark.parametrize("language", OTHERS)
def test_languages_have_all_sentences_and_words(language: str) -> None:
    sentences = read(f"{language}_sentences")
    assert isinstance(sentences, dict)
    assert set(sentences) == {"templates", "words"}
    assert set(sentences["templates"]) == set(map(str, PARAMETERS)) == set(map(str, TEMPLATES))
    english = {(str(kind), str(key)) for kind, words in WORDS.items() for key in words}
    assert {path for path, _ in texts(sentences["words"])} == english


def test_every_text_is_used() -> None:
    assert [".".join(path) for path, _ in texts(read("en")) if not is_used(path)] == []


def test_an_unused_text_is_found() -> None:
    assert not is_used(("deck", "no_such_text"))
    assert not is_used(("common", "modes", "no_such_mode"))
    assert not is_used(("fleet", "keptForYou"))


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.json")))
def test_texts_are_neither_blank_nor_markup(name: str) -> None:
    found = list(texts(read(name)))
    assert found
    for path, text in found:
        assert text == text.strip() != "", path
        assert not re.search(r"<\w|</|&\w+;", text), path


def test_looked_up_tables_exist_and_have_at_most_one_place_per_text() -> None:
    found = {path[:-1]: text for path, text in texts(read("en"))}
    assert {".".join(each) for each in found} >= LOOKED_UP
    for path, text in texts(read("en")):
        if ".".join(path[:-1]) in LOOKED_UP:
            assert len(places(text)) <= 1, path
