"""Codes, their parameters and their sentences."""

from __future__ import annotations

import json
import math
import re
import typing
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.messages.reasons import example_reasons
from tsd_twin.hardware.dynamixel.control_table import Refusal, Trip
from tsd_twin.messages import codes
from tsd_twin.messages.codes import (
    DECIMALS,
    PARAMETERS,
    Code,
    Reason,
    Type,
    because,
    problem_of,
)
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.sentences import TEMPLATES, WORDS, full_sentence, sentence
from tsd_twin.messages.services import LeaseRequest
from tsd_twin.messages.topics import Service

RELEASED = Path(__file__).with_name("codes.json")
_SLOT = re.compile(r"\{(\w+)(?::[+,]?(?:\.(\d))?)?\}")


def test_every_code_has_parameters_and_a_sentence() -> None:
    assert list(PARAMETERS) == list(Code)
    assert list(TEMPLATES) == list(Code)


@pytest.mark.parametrize("code", list(Code))
def test_template_uses_only_parameters_of_its_code(code: Code) -> None:
    types = {name.removesuffix("?"): kind for name, kind in PARAMETERS[code].items()}
    for name, decimals in _SLOT.findall(TEMPLATES[code]):
        assert name in types
        if decimals:
            assert int(decimals) >= DECIMALS[types[name]], "the sender has rounded to these"
    needed = {name for name in PARAMETERS[code] if not name.endswith("?")}
    unconditional = re.sub(r"\[[^]]*]", "", TEMPLATES[code])
    assert {name for name, _ in _SLOT.findall(unconditional)} <= needed


@pytest.mark.parametrize("code", list(Code))
def test_released_codes_keep_their_parameters(code: Code) -> None:
    """`codes.json` is append-only: a new code or parameter gets a new line."""
    released = json.loads(RELEASED.read_text(encoding="utf-8"))
    assert released[code].items() <= PARAMETERS[code].items()
    added = PARAMETERS[code].keys() - released[code].keys()
    assert not added, "add the parameter to codes.json; it must be optional"


def test_no_released_code_is_removed() -> None:
    assert json.loads(RELEASED.read_text(encoding="utf-8")).keys() == set(Code)


def test_words_are_those_of_the_lists_behind_them() -> None:
    assert WORDS[Type.MODE].keys() == set(Mode)
    assert WORDS[Type.TRIP].keys() == {trip.name.lower() for trip in Trip}
    assert WORDS[Type.OBSTACLE].keys() == {refusal.name.lower() for refusal in Refusal}
    operations = typing.get_args(typing.get_type_hints(LeaseRequest)["op"])
    services = {service.removeprefix("srv/") for service in Service}
    assert WORDS[Type.REQUEST].keys() == {*operations, *services}


@given(reason=example_reasons())
def test_reasons_survive_json_and_have_one_sentence(reason: Reason) -> None:
    assert problem_of(reason) == ""
    back = msgspec.json.decode(msgspec.json.encode(reason), type=Reason)
    assert back == reason
    assert sentence(back) == sentence(reason)
    assert not re.search(r"[\[\]{}|]|\bNone\b", sentence(reason))
    assert full_sentence(reason).endswith(".")


def test_unknown_code_is_shown_as_its_words() -> None:
    assert sentence(Reason("wheel_came_off", {"wheel": "left"})) == "wheel came off"
    assert full_sentence(Reason("wheel_came_off")) == "Wheel came off."


def test_unknown_word_is_shown_as_it_is() -> None:
    reason = Reason(Code.BOARD_TRIP, {"trip": "meteor_strike"})
    assert sentence(reason) == "the board disarmed itself: meteor strike"


def test_parameters_of_a_newer_version_are_ignored() -> None:
    reason = Reason(Code.HELD_BY, {"holder": "bob", "since_s": 3.0})
    assert sentence(reason) == "bob has control"


@pytest.mark.parametrize(
    ("reason", "problem"),
    [
        (Reason("nothing"), "unknown code"),
        (Reason(Code.HELD_BY), "has parameters"),
        (Reason(Code.ARM_FIRST, {"x": 1.0}), "has parameters"),
        (Reason(Code.LOOP_LATE, {"ms": "140"}), "ms is '140'"),
        (Reason(Code.HELD_BY, {"holder": 3.0}), "holder is 3.0"),
        (Reason(Code.REQUEST_REFUSED, {"request": "arm"}), "has parameters"),
        (Reason(Code.COMMAND_DROPPED, {}, Reason("nothing")), "unknown code"),
    ],
)
def test_wrong_parameters_are_found(reason: Reason, problem: str) -> None:
    assert problem in problem_of(reason)


def test_wrong_parameter_fails_the_test_that_makes_it() -> None:
    with pytest.raises(AssertionError, match="held_by: has parameters"):
        because(Code.HELD_BY)


@given(ms=st.floats())
def test_robot_never_fails_over_a_number(ms: float) -> None:
    codes.checks = False
    try:
        reason = because(Code.LOOP_LATE, ms=ms)
    finally:
        codes.checks = True
    assert isinstance(reason.params["ms"], int if math.isfinite(ms) else str)


def test_deeply_nested_causes_are_no_message() -> None:
    text = b'{"code":"a"}'
    for _ in range(9):
        text = b'{"code":"a","cause":' + text + b"}"
    with pytest.raises(msgspec.ValidationError, match="at most 8 causes"):
        msgspec.json.decode(text, type=Reason)
