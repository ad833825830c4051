"""`make mutants` notices what it should, on a handful of the changes that it makes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.firmware_mutation import FILES, TESTS, Referee, mutants_of, read_list, run

RULES = (
    "arming_wants_a_fresh_command",
    "arming_wants_zero_throttle_and_zero_goals",
    "test_the_light_is_on_while_a_source_has_the_robot",
)
NO_BYTE = (
    "table.c inside: return address >= block && address < block + size && length <= block + size "
    "- address; => return address >= block && address <= block + size && length <= block + size "
    "- address;"
)
KINDS = {
    "safety.c ask_to_arm: if (edge && beat) { => if (edge || beat) {": "broken",
    # It reads beyond the array, which no rule asks for.
    "safety.c goals_zero: for (uint8_t i = 0; i < CT_SERVOS; i++) { => "
    "for (uint8_t i = 0; i <= CT_SERVOS; i++) {": "broken",
    "host_line.c host_line_overrun: uint8_t seen = 0; => uint8_t seen = (0 + 1);": "same code",
    NO_BYTE: "survived",
}


@pytest.fixture
def referee(native: Path, tmp_path: Path) -> Referee:
    assert native.exists()
    it = Referee(tmp_path)
    assert it.prepare(RULES) == ""
    return it


def test_mutants_are_broken_or_the_same_or_survive(referee: Referee) -> None:
    mutants = [it for file in FILES for it in mutants_of(file) if it.name in KINDS]
    found = {it.name: (kind, rule) for it, kind, rule in run(mutants, referee, ())}
    assert {name: kind for name, (kind, _) in found.items()} == KINDS
    assert {rule for _, rule in found.values()} <= {"", *RULES}
    assert [kind for _, kind, _ in run(mutants[:1], referee, {NO_BYTE})] == ["equivalent"]


def test_what_is_listed_as_equivalent_is_a_change_and_has_a_reason() -> None:
    names = {it.name for file in FILES for it in mutants_of(file)}
    listed = read_list()
    assert set(listed) <= names
    assert all(listed.values())


def test_names_of_mutants_are_unique() -> None:
    names = [it.name for file in FILES for it in mutants_of(file)]
    assert len(set(names)) == len(names) > 900
    assert set(TESTS) >= set(RULES)
