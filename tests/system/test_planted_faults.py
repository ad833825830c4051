"""Each planted fault is caught by its test."""

from __future__ import annotations

import pytest

from tests.planted_faults import FAULTS, Fault, fails


@pytest.mark.system
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_is_caught(fault: Fault) -> None:
    assert fails(fault.test, fault.name)
