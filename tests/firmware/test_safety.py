"""The laws of safety hold; `test_mutants.py` shows that each is needed."""

from __future__ import annotations

import pytest

from tests.firmware.laws import LAWS
from tests.firmware.pilot import Bench


@pytest.mark.parametrize("name", LAWS)
def test_law(name: str, bench: Bench) -> None:
    LAWS[name](bench)
