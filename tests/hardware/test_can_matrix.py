"""Fault matrix of a singularity drive with U2D2 and CAN wheels, in virtual time."""

from __future__ import annotations

import pytest

from tests.hardware.can_matrix import FAULTS, CanRig, row
from tests.support.can_motors import STATUS_S
from tests.support.markdown_pages import page, section, tables
from tests.support.wheel_matrix import PERIOD_S, Fault

pytestmark = pytest.mark.computes

RESOLUTION_S = PERIOD_S + STATUS_S
"""The Mega's figures have a resolution of a cycle, and measurements of a VESC are this old."""


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.what)
def test_wheels_are_off_as_soon_as_with_the_mega_and_stay_off_until_armed(
    monkeypatch: pytest.MonkeyPatch, fault: Fault[CanRig]
) -> None:
    rig = CanRig(monkeypatch)
    rig.harm(fault)
    assert 0.0 < rig.off_s <= fault.mega_s + RESOLUTION_S
    assert not rig.driven
    assert not fault.codes or set(rig.codes) & fault.codes
    fault.mend(rig)
    rig.run(1.5)
    assert not rig.driven, "mended, commanded, and nothing turns"
    assert rig.get_driving()


def test_the_page_has_the_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    (rows,) = tables(section(page("wheels.md"), "### Fault matrix of CAN wheels"))
    shown = ["| " + " | ".join(cells) + " |" for cells in rows]
    made: list[str] = []
    for fault in FAULTS:
        with monkeypatch.context() as patch:
            made.append(row(patch, fault))
    assert shown == made
