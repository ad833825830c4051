"""Fault matrix of robots on Dynamixel wheels, in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.markdown_pages import page, section, tables
from tests.support.robot_variants import WHEEL_ROBOTS
from tests.support.wheel_matrix import FAULTS, PERIOD_S, Fault, WheelRig, row
from tsd_twin.hardware.dynamixel.wheel_models import VELOCITY_UNIT_RAD_PER_S, WHEEL_MODELS

pytestmark = pytest.mark.computes

RECONNECTED_S = 0.5

EACH = pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.what)
CYCLE_S = 2.0 * PERIOD_S
"""The Mega's figures have a resolution of a cycle, and a servo's answer takes another."""


@pytest.mark.parametrize("name", ["kiwi", "mecanum"])
@EACH
def test_wheels_are_off_as_soon_as_with_the_mega_and_stay_off_until_armed(
    name: str, fault: Fault[WheelRig]
) -> None:
    rig = WheelRig(name)
    rig.harm(fault)
    assert 0.0 < rig.off_s <= fault.mega_s + CYCLE_S, rig.off_s
    assert not rig.driven
    fault.mend(rig)
    if rig.armed:
        rig.run(1.5)
        assert not rig.driven, "mended, commanded, and nothing turns"
    if fault.codes:
        assert fault.codes & set(rig.codes), rig.codes
    rig.run(RECONNECTED_S)
    assert rig.get_driving()


@pytest.mark.parametrize("name", WHEEL_ROBOTS)
def test_the_robot_drives_at_the_commanded_speed(name: str) -> None:
    rig = WheelRig(name)
    assert rig.get_driving()
    rig.run(0.5)
    wanted = rig.bus.command.setpoint
    there = [servo.speed_rad_per_s for servo in rig.servos]
    assert np.allclose(there, wanted, atol=VELOCITY_UNIT_RAD_PER_S)
    assert rig.bus.report is not None
    assert np.allclose(
        rig.bus.speeds(rig.bus.report, rig.line.now_s), wanted, atol=VELOCITY_UNIT_RAD_PER_S
    )


def test_the_page_has_the_rows() -> None:
    (rows,) = tables(section(page("wheels.md"), "### Fault matrix of servo wheels"))
    shown = ["| " + " | ".join(cells) + " |" for cells in rows]
    assert shown == [row("kiwi", fault) for fault in FAULTS]


def test_the_page_has_the_models() -> None:
    models = tables(section(page("wheels.md"), "## Dynamixel servos as wheels"))[0]
    assert {int(cells[1]) for cells in models} == set(WHEEL_MODELS)
    for name, number, rpm, volts, limit_c, unit in models:
        model = WHEEL_MODELS[int(number)]
        at = {setting.name: setting.least for setting in model.servo.settings}
        least_v, most_v = at["min voltage limit"] / 10.0, at["max voltage limit"] / 10.0
        assert name == model.servo.name
        assert float(rpm) == round(0.229 * model.velocity_limit, 1)
        assert volts == f"{least_v} to {most_v}"
        assert int(limit_c) == model.temperature_limit_c
        current = f"current, {model.servo.current_ma:g} mA"
        assert unit == ("load" if model.reports_load else current)
