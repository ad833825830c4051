"""The fault matrix of docs/bridge.md is what the robot in a box does."""

from __future__ import annotations

import re

import pytest

from tests.firmware.fault_matrix import FAULTS, Fault, measure, row
from tests.support.firmware_host import Bench
from tests.support.markdown_pages import page, section, tables

(ROWS,) = tables(section(page("bridge.md"), "### Fault matrix"))
CLOSE = 0.03
"""Seconds or metres: another compiler makes another firmware."""


def test_every_fault_is_listed() -> None:
    assert [(what, wiring) for what, wiring, *_ in ROWS] == [
        tuple(row(fault, None)[:2]) for fault in FAULTS
    ]


@pytest.mark.parametrize(
    ("fault", "cells"),
    list(zip(FAULTS, ROWS, strict=True)),
    ids=lambda value: re.sub(r"\W+", "_", "_".join(value[:2])) if isinstance(value, list) else "",
)
def test_it_goes_as_far_as_it_says_and_moves_only_after_a_new_arming(
    fault: Fault, cells: list[str], bench: Bench
) -> None:
    _, _, off_s, distance_m, tilt, before = cells
    result = measure(fault, bench)
    assert result.off_s == pytest.approx(float(off_s), abs=CLOSE)
    assert result.distance_m == pytest.approx(float(distance_m), abs=CLOSE)
    assert row(fault, result)[4:] == [tilt, before]
