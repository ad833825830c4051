"""The laws of safety hold; `test_mutants.py` shows that each is needed."""

from __future__ import annotations

import pytest

from tests.firmware.rules import ALL_LAWS, LAWS
from tests.support.firmware_host import Bench

OF_THE_RECEIVER = (
    "the_kill_switch_stops",
    "a_switch_between_its_ends_does_not_chatter",
    "a_lost_radio_control_stops",
    "a_lost_radio_control_is_missed_after_a_reset_too",
    "an_expected_receiver_is_missed_when_power_comes",
    "the_channels_of_the_receiver_are_those_of_the_setup",
    "the_radio_control_begins_at_the_low_end_of_its_stick",
    "the_radio_control_takes_over_and_gives_back",
    "the_radio_control_begins_with_its_switch_and_no_speed",
    "the_radio_control_is_stopped_like_the_pc",
    "power_makes_a_new_start",
)


@pytest.mark.parametrize("name", LAWS)
def test_law(name: str, bench: Bench) -> None:
    LAWS[name](bench)


@pytest.mark.parametrize("name", ALL_LAWS)
def test_law_holds_without_the_chip(name: str, native_bench: Bench) -> None:
    ALL_LAWS[name](native_bench)


@pytest.mark.timeout(400)
@pytest.mark.parametrize("name", ALL_LAWS)
def test_law_holds_on_an_rp2040(name: str, rp2040_bench: Bench) -> None:
    ALL_LAWS[name](rp2040_bench)


@pytest.mark.parametrize("name", OF_THE_RECEIVER)
def test_law_holds_for_a_receiver_with_sbus(name: str, sbus_bench: Bench) -> None:
    LAWS[name](sbus_bench)
