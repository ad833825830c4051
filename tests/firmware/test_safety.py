"""The laws of safety hold; `test_mutants.py` shows that each is needed."""

from __future__ import annotations

import pytest

from tests.support.firmware_host import Bench
from tests.support.firmware_rules import LAWS


@pytest.mark.parametrize("name", LAWS)
def test_law(name: str, bench: Bench) -> None:
    LAWS[name](bench)


@pytest.mark.parametrize("name", LAWS)
def test_law_holds_without_the_chip(name: str, native_bench: Bench) -> None:
    LAWS[name](native_bench)
