"""Every refusal that random operators get from a robot is in the table of codes."""

from __future__ import annotations

import pytest

from tests.control.test_refusals import RandomOperators
from tsd_twin import robots
from tsd_twin.messages.codes import Reason, problem_of
from tsd_twin.messages.sentences import full_sentence, sentence


@pytest.mark.parametrize("name", robots.robot_names())
def test_every_text_of_a_robot_is_the_sentence_of_a_known_code(name: str) -> None:
    operators, codes = RandomOperators(name, seed=7), set[str]()
    for _ in range(120):
        operators.act()
        status = operators.rig.status()
        refusals = status.refusals
        assert refusals is not None
        pairs: list[tuple[str | None, Reason | None, bool]] = [
            (getattr(refusals, field), refusals.why.get(field), False)
            for field in refusals.__struct_fields__
            if field != "why"
        ]
        pairs.append((status.stop_reason, status.stop, False))
        pairs += [(e.text, e.why, True) for e in operators.rig.controller.take_events()]
        for text, why, is_event in pairs:
            if why is None:
                assert not text
                continue
            assert problem_of(why) == ""
            assert text == (full_sentence(why) if is_event else sentence(why))
            codes.add(why.code)
    assert len(codes) > 20
