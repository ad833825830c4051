"""Display names of operators are text in any script, without effect on the text around."""

from __future__ import annotations

import re
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.names import (
    MAX_NAMES,
    NAME_LENGTH,
    OperatorNames,
    display_name,
    id_of_name,
)

ANY_TEXT = st.text(st.characters(), max_size=90)
NAMES = ("محمد", "אבי לוי", "王小明", "Ольга", "Łukasz", "Søren", "Straßer", "வேலு", "O'Neill")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_any_script_is_kept(name: str) -> None:
    assert display_name(name) == name


@given(ANY_TEXT)
def test_a_name_is_one_line_of_bounded_length_in_normal_form(text: str) -> None:
    name = display_name(text)
    assert len(name) <= NAME_LENGTH
    assert name == name.strip()
    assert unicodedata.is_normalized("NFC", name)
    assert not {unicodedata.category(each) for each in name} & {"Cc", "Cs", "Zl", "Zp"}
    name.encode()  # It can be sent.


@given(ANY_TEXT)
def test_no_mark_of_text_direction_is_left(text: str) -> None:
    name = display_name("\u202e" + text + "\u2067")
    assert not re.search("[\u200e\u200f\u061c\u202a-\u202e\u2066-\u2069]", name)


@given(ANY_TEXT)
def test_a_name_that_is_fit_to_be_shown_stays_the_same(text: str) -> None:
    name = display_name(text)
    assert display_name(name) == name


def test_a_long_name_is_cut_between_letters_and_not_before_their_marks() -> None:
    letter = "x\u0301\u0302"  # No single character has both marks.
    assert display_name(letter * 30) == unicodedata.normalize("NFC", letter * 13)


@given(ANY_TEXT)
def test_an_id_has_the_letters_that_a_bus_key_may_have(text: str) -> None:
    assert re.fullmatch("[a-z0-9_-]{0,20}", id_of_name(text))


def test_an_id_spells_a_name_whole_or_not_at_all() -> None:
    assert id_of_name("Jörg B.") == "jorg-b"
    assert [id_of_name(name) for name in NAMES[:7]] == [""] * 7


@given(st.lists(st.tuples(st.sampled_from("abcdefghijkl"), st.text("xyz", max_size=2))))
def test_the_names_learnt_last_are_kept(heard: list[tuple[str, str]]) -> None:
    names = OperatorNames()
    for operator, name in heard:
        names.learn(operator, name)
    last: dict[str, str] = {}
    for operator, name in heard:
        if name:
            last.pop(operator, None)
            last[operator] = name
    assert dict(names.by_id) == dict(list(last.items())[-MAX_NAMES:])
