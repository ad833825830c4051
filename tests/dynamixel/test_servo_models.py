"""Servo settings: every writable setting is compared, or exempt with a reason."""

from __future__ import annotations

import pytest

from firmware.simulator.mx64 import REGISTERS, Mx64
from tsd_twin.hardware.dynamixel.servo_models import (
    LONGEST_READ,
    MODELS,
    ServoModel,
    ServoSetting,
    span,
    wrong_setting,
)
from tsd_twin.messages.codes import Code, because

READ_ONLY = {
    1: {0: 3, 36: 9, 46: 1, 68: 2},
    2: {0: 7, 69: 2, 120: 27},
}
"""Address and size of model, version and telemetry."""
WIDE = {1: {30: 2}, 2: {24: 4, 40: 4, 102: 2, 104: 4, 116: 4}}
"""Sizes of exempt settings with more than a byte."""
NOT_COMPARED: dict[int, dict[int, str]] = {
    1: {
        3: "id: the calibration names it",
        4: "baud rate: a servo with another does not answer",
        17: "alarm LED: a light",
        24: "torque: switched and watched while the robot works",
        25: "LED: a light",
        30: "goal position: written in each cycle",
        47: "lock: protects the settings",
    },
    2: {
        7: "id: the calibration names it",
        8: "baud rate: a servo with another does not answer",
        24: "moving threshold: of a flag that nobody reads",
        40: "acceleration limit of an XM: of the profile, which must be off; not all have it",
        56: "external port: of an XM540, moves nothing",
        57: "external port: of an XM540, moves nothing",
        58: "external port: of an XM540, moves nothing",
        60: "startup configuration: what it restores is compared; not every firmware has it",
        64: "torque: switched and watched while the robot works",
        65: "LED: a light",
        102: "goal current: of other operating modes",
        104: "goal velocity: of other operating modes",
        116: "goal position: written in each cycle",
    },
}
"""Writable registers that are not compared, by protocol and address, with the reason."""
ALL = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


@pytest.mark.parametrize("number", [310, 311])
def test_each_register_of_the_manual_is_compared_or_listed_with_a_reason(number: int) -> None:
    model = MODELS[number]
    found: list[int] = []
    for s in model.settings:
        found += range(s.address, s.address + s.size)
    for at, size in READ_ONLY[model.protocol].items():
        found += range(at, at + size)
    documented = REGISTERS[model.protocol].documented
    for at in NOT_COMPARED[model.protocol]:
        if at in documented and at not in found:
            found += range(at, at + WIDE[model.protocol].get(at, 1))
    assert len(found) == len(set(found)), "none of them twice"
    assert documented - set(found) == set()


@pytest.mark.parametrize("number", [310, 311])
def test_a_servo_as_it_comes_from_the_factory_is_right(number: int) -> None:
    model = MODELS[number]
    servo = Mx64(1, model.protocol)
    assert int.from_bytes(servo.read(0, 2), "little") == number
    for s in model.settings:
        assert s.allows(s.value(servo.read(s.address, s.size))), s.name


@ALL
def test_reads_have_all_settings_in_their_order_and_nothing_else(model: ServoModel) -> None:
    groups = model.reads()
    assert [s for group in groups for s in group] == list(model.settings)
    for group in groups:
        assert span(group) == group[-1].address + group[-1].size - group[0].address
        assert span(group) <= LONGEST_READ[model.protocol]


@ALL
def test_limits_fit_into_the_row_of_the_firmware(model: ServoModel) -> None:
    addresses = [s.address for s in model.settings]
    assert addresses == sorted(set(addresses))
    for s in model.settings:
        assert -(1 << 15) <= s.least <= s.most < 1 << 15
        assert s.address + s.size <= 256


def test_wrong_register_is_named_with_both_values() -> None:
    setting = ServoSetting(9, 1, 25, 250, "return delay time")
    assert setting in MODELS[311].settings
    assert wrong_setting("5", 311, 9, 0) == because(
        Code.SERVO_SETTING,
        servo="5",
        setting="return delay time",
        register=9,
        value=0,
        wanted="25 to 250",
    )
    negative = wrong_setting("5", 311, 20, 2**32 - 5)
    assert (negative.params["setting"], negative.params["value"]) == ("homing offset", -5)
    assert wrong_setting("5", 0, 20, 3) == because(
        Code.SERVO_REGISTER, servo="5", register=20, value=3
    )
