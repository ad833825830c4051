"""`make mutants` notices what it should, on a handful of the changes that it makes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.firmware.mutation import (
    FILES,
    TESTS,
    Memory,
    Referee,
    Verdict,
    mutants_of,
    read_list,
    run,
)

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


def test_mutants_are_broken_or_the_same_or_survive(referee: Referee, tmp_path: Path) -> None:
    mutants = [it for file in FILES for it in mutants_of(file) if it.name in KINDS]
    memory = Memory.read(tmp_path / "memory", "sources")
    found = {it.name: (kind, rule) for it, kind, rule in run(mutants, referee, (), memory)}
    assert {name: kind for name, (kind, _) in found.items()} == KINDS
    assert {rule for _, rule in found.values()} <= {"", *RULES}
    assert [kind for _, kind, _ in run(mutants[:1], referee, {NO_BYTE})] == ["equivalent"]
    again = Memory.read(tmp_path / "memory", "sources")
    unable = Referee(tmp_path / "without a rule")
    kinds = {it.name: (kind, rule) for it, kind, rule in run(mutants, unable, (), again)}
    assert kinds == found, "a run that was stopped goes on where it was"


def test_verdicts_count_while_no_source_changes(tmp_path: Path) -> None:
    file = tmp_path / "memory"
    memory = Memory.read(file, "some")
    memory.add("one", Verdict("code", "rule", 0.1))
    memory.add("two", Verdict("other code", "", 9.0))
    assert Memory.read(file, "some").judged == memory.judged
    changed = Memory.read(file, "others")
    assert changed.judged == {}
    assert changed.broke == {"one": "rule"}, "it is tried first"
    changed.add("one", Verdict("code", "", 9.0))
    again = Memory.read(file, "others")
    assert again.judged == changed.judged
    assert again.broke == {}


def test_what_is_listed_as_equivalent_is_a_change_and_has_a_reason() -> None:
    names = {it.name for file in FILES for it in mutants_of(file)}
    listed = read_list()
    assert set(listed) <= names
    assert all(listed.values())


def test_names_of_mutants_are_unique() -> None:
    names = [it.name for file in FILES for it in mutants_of(file)]
    assert len(set(names)) == len(names) > 900
    assert set(TESTS) >= set(RULES)
