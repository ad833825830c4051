"""Each line of the firmware that keeps people safe is needed: without it a law is broken."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware.simulator.board import FIRMWARE
from tests.firmware.mutants import MUTANTS, Mutant
from tests.firmware.rules import ALL_LAWS
from tests.support.firmware_host import Bench
from tests.support.markdown_pages import section, tables

README = (FIRMWARE / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: re.sub(r"\W+", "_", mutant.what))
def test_mutant_breaks_its_law(
    mutant: Mutant, elf: Path, native: Path, rp2040: Path, tmp_path: Path
) -> None:
    assert all(program.exists() for program in (elf, native, rp2040))
    bench = Bench(mutant.build(tmp_path))
    broken = ""
    try:
        ALL_LAWS[mutant.law](bench)
        bench.finish()
    except (AssertionError, RuntimeError) as error:
        broken = str(error) or "broken"
    finally:
        bench.close()
    assert broken, f"{mutant.law} holds although {mutant.what}"


def test_every_law_has_a_mutant() -> None:
    assert {mutant.law for mutant in MUTANTS} == set(ALL_LAWS)


def test_the_mutants_are_listed() -> None:
    (rows,) = tables(section(README, "### Mutants"))
    listed = [(what, file.strip("`"), law.strip("`")) for what, file, law in rows]
    assert listed == [(mutant.what, mutant.file, mutant.law) for mutant in MUTANTS]
