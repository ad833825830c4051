"""`tsd-bridge --check` finds each wiring error at its step, before a motion that it endangers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.hardware.wired_machines import Bench
from tests.hardware.wiring_errors import (
    ERRORS,
    BusWheels,
    CanWheelsMachine,
    MegaMachine,
    MegaWithSensors,
    Rp2040WithTelemetry,
    U2D2Machine,
    Wired,
    WiringError,
    rows,
)
from tests.support.markdown_pages import ROOT, page
from tsd_twin.hardware.commissioning.sheet import read_sheet
from tsd_twin.hardware.commissioning.steps import Swing, Turn

pytestmark = pytest.mark.computes
PLANS = sorted((ROOT / "docs/wiring").glob("*.toml"))
MACHINES = (MegaMachine, BusWheels, U2D2Machine, CanWheelsMachine)


def walk(bench: Bench, machine: Wired, file: Path) -> list[str]:
    _, said = machine.check(file)
    assert not machine.driven
    assert bench.most_driven <= 1
    return said


@pytest.mark.parametrize("machine", [*MACHINES, MegaWithSensors, Rp2040WithTelemetry])
def test_sound_machine_passes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, machine: type[Wired]
) -> None:
    bench, file = Bench(monkeypatch), tmp_path / "sheet.json"
    it = machine(bench)
    said = walk(bench, it, file)
    results = read_sheet(file, it.robot.name, it.kind).results
    assert [result.step for result in results] == [step.name for step in it.steps()], said[-2]
    assert all(result.finding is None for result in results)


@pytest.mark.parametrize("error", ERRORS, ids=lambda it: f"{it.machine.plan}: {it.what}")
def test_wiring_error_is_found_at_its_step(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: WiringError
) -> None:
    bench, file = Bench(monkeypatch), tmp_path / "sheet.json"
    it = error.machine(bench)
    error.harm(it)
    it.person.answers |= error.answers
    names = [step.name for step in it.steps()]
    moving = [step.name for step in it.steps() if isinstance(step, (Swing, Turn))]
    if error.step in moving:
        it.begin(file, error.step)
    said = walk(bench, it, file)
    result = read_sheet(file, it.robot.name, it.kind).results[-1]
    assert result.finding is not None, said[-2]
    assert (result.step, result.finding.code) == (error.step, error.code), said[-2]
    if names.index(error.step) < names.index(moving[0]):
        assert not bench.most_driven
        assert not (isinstance(it, MegaMachine) and any(c.arm for c in it.board.commands))


def test_each_plan_has_ten_errors_or_more() -> None:
    counted = Counter(error.machine for error in ERRORS)
    assert min(counted[machine] for machine in MACHINES) >= 10


def test_page_has_each_error_that_commissioning_finds() -> None:
    lines, found = page("wiring.md").splitlines(), rows()
    start = lines.index("| Plan | Error | Found by | Code |") + 2
    assert lines[start : start + len(found) + 1] == [*found, ""]
    assert {error.machine.plan for error in ERRORS} == {plan.stem for plan in PLANS}
