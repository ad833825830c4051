"""`python -m research` lists all studies, each with examples."""

from __future__ import annotations

from research.__main__ import EXPERIMENTS
from tests.support.markdown_pages import ROOT
from tsd_lab import EXPERIMENTS as SHIPPED


def test_examples_name_the_program() -> None:
    for study in EXPERIMENTS:
        assert study.examples
        assert all(f"python -m research {study.name}" in each for each in study.examples)


def test_every_study_is_listed_and_not_shipped() -> None:
    files = {path.stem for path in (ROOT / "research").glob("*.py")} - {"__init__", "__main__"}
    names = {study.name.replace("-", "_") for study in EXPERIMENTS}
    assert names == files - {"open_loop", "sphere"}  # Modules used by others.
    assert names.isdisjoint(each.name for each in SHIPPED)
