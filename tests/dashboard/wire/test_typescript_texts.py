"""The generated type of the page texts has their nesting, and a function per template."""

from __future__ import annotations

import pytest

from tsd_twin.dashboard.wire.typescript_texts import places, texts_module


@pytest.mark.parametrize(
    ("text", "types"),
    [
        ("Nothing, with # and '.", {}),
        ("{done} of {all}", {"done": "Value", "all": "Value"}),
        ("{b} over {a}, {b}", {"b": "Value", "a": "Value"}),
        ("{n, plural, =0 {} one {# stop} other {# stops}}", {"n": "number"}),
        ("{n}: {n, plural, other {of {all}}}", {"n": "number", "all": "Value"}),
        ("{unit, select, m_s {metres} other {{unit}}}", {"unit": "Value"}),
        ("{name, select, none {nobody} other {{name}}}.", {"name": "Value | null"}),
        ("{ok, select, true {good} other {}}", {"ok": "boolean"}),
    ],
)
def test_places_have_types_in_the_order_of_appearance(text: str, types: dict[str, str]) -> None:
    assert list(places(text).items()) == list(types.items())


@pytest.mark.parametrize("text", ["{", "}", "{}", "a {name", "{two words}", "{n, plural, one {a}"])
def test_wrong_braces_are_errors(text: str) -> None:
    with pytest.raises(ValueError, match=r"brace|place"):
        places(text)


def test_a_table_has_strings_functions_lists_and_open_records() -> None:
    texts = {
        "deck": {"title": "Deck", "going": "{done} of {all} m", "keys": ["A", "B"]},
        "health": {"advice": ["All {count}.", "Look."], "drops": {"old": "too old"}},
        "steps": [{"title": "Arm", "text": "It spins."}, {"title": "Drive", "text": "It drives."}],
        "m/s": "metres",
    }
    assert texts_module(texts).endswith(
        """\
export interface Table {
  readonly deck: {
    readonly title: string;
    readonly going: (done: Value, all: Value) => string;
    readonly keys: readonly string[];
  };
  readonly health: {
    readonly advice: readonly [(count: Value) => string, string];
    readonly drops: Readonly<Record<string, string>>;
  };
  readonly steps: readonly {
    readonly title: string;
    readonly text: string;
  }[];
  readonly "m/s": string;
}
"""
    )
