"""A link specification is parsed exactly, round-trips, and is explained if invalid."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.errors import TwinError
from tsd_twin.link_emulation import PROFILES, LinkError, LinkSpec, Stall, Wander

times_s = st.floats(0.0, 1e4, allow_subnormal=False) | st.sampled_from([0.0, 1e-6, 0.15, 2.0])
shares = st.floats(0.0, 1.0, allow_subnormal=False) | st.sampled_from([0.0, 0.02, 1.0])
rates = st.floats(1e-3, 1e12) | st.sampled_from([1.0, 64e3, 1e6, math.inf])


@st.composite
def stalls(draw: st.DrawFn) -> Stall:
    length_s = draw(st.floats(0.001, 1e3))
    return Stall(length_s, draw(st.floats(length_s + 0.0011, 1e4)))


wanders = st.builds(Wander, times_s, st.floats(0.001, 1e4))
specs = st.builds(
    LinkSpec,
    times_s,
    times_s,
    shares,
    shares,
    st.none() | stalls(),
    rates,
    st.integers(0, 2**63),
    st.none() | wanders,
)


@given(specs)
def test_what_is_written_reads_the_same_to_the_last_bit(spec: LinkSpec) -> None:
    assert LinkSpec.parse(str(spec)) == spec


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("", LinkSpec()),
        ("delay=150ms", LinkSpec(delay_s=0.15)),
        ("delay=0.5s", LinkSpec(delay_s=0.5)),
        ("delay=1500us", LinkSpec(delay_s=0.0015)),
        ("jitter=30ms", LinkSpec(jitter_s=0.03)),
        ("wander=10ms@15s", LinkSpec(wander=Wander(0.01, 15.0))),
        ("loss=2%", LinkSpec(loss=0.02)),
        ("reorder=0.1%", LinkSpec(reorder=0.001)),
        ("stall=2s@10s", LinkSpec(stall=Stall(2.0, 10.0))),
        ("stall=200ms@1.5s", LinkSpec(stall=Stall(0.2, 1.5))),
        ("bandwidth=1Mbit", LinkSpec(bandwidth_bit_per_s=1e6)),
        ("bandwidth=64kbit", LinkSpec(bandwidth_bit_per_s=64e3)),
        ("bandwidth=2Gbit", LinkSpec(bandwidth_bit_per_s=2e9)),
        ("seed=7", LinkSpec(seed=7)),
        (" delay = 150 ms , loss=2% ,", LinkSpec(delay_s=0.15, loss=0.02)),
    ],
)
def test_each_word_is_read_with_its_unit(text: str, spec: LinkSpec) -> None:
    assert LinkSpec.parse(text) == spec


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_is_a_link_whose_properties_may_be_replaced(name: str) -> None:
    link = PROFILES[name].link
    assert LinkSpec.parse(name) == LinkSpec.parse(str(link)) == link
    assert LinkSpec.parse(f"{name},loss=7%") == replace(link, loss=0.07)


@pytest.mark.parametrize("name", PROFILES)
def test_the_docs_have_each_profile_with_its_figures(name: str) -> None:
    page = (Path(__file__).parents[2] / "docs" / "link.md").read_text("utf-8")
    assert f"| `{name}` | `{PROFILES[name].link}` | " in page


def test_a_profile_comes_first() -> None:
    with pytest.raises(LinkError, match="profile: wifi, 4g, satellite, transatlantic"):
        LinkSpec.parse("loss=7%,wifi")


def test_the_largest_fitting_unit_is_written_and_the_default_is_left_away() -> None:
    text = "delay=150ms,jitter=30ms,loss=2%,reorder=0.5%,stall=2s@10s,bandwidth=1.5Mbit,seed=7"
    assert str(LinkSpec.parse(text)) == text
    assert str(LinkSpec(delay_s=2e-5, bandwidth_bit_per_s=800)) == "delay=20us,bandwidth=800bit"
    assert str(LinkSpec()) == "delay=0s"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dealy=150ms", ["'dealy'", "did you mean 'delay'", "valid are delay, jitter, wander"]),
        ("wander=10ms", ["wander: '10ms' does not say how often", "10ms@15s"]),
        ("colour=red", ["'colour'", "valid are", "bandwidth"]),
        ("delay", ["'delay' has no value", "delay=150ms"]),
        ("loss=", ["'loss=' has no value", "loss=2%"]),
        ("delay=150", ["delay:", "'150' is no time", "us, ms, s", "such as 150ms"]),
        ("delay=150sec", ["'150sec' is no time", "us, ms, s"]),
        ("delay=-3ms", ["'-3ms' is no time"]),
        ("delay=nan", ["'nan' is no time"]),
        ("delay=1e3ms", ["'1e3ms' is no time"]),
        ("delay=" + "9" * 400 + "s", ["delay is inf s", "finite"]),
        ("loss=0.02", ["'0.02' is no share", "%", "such as 2%"]),
        ("loss=101%", ["loss is 101%", "0% to 100%"]),
        ("reorder=200%", ["reorder is 200%", "0% to 100%"]),
        ("bandwidth=1MB", ["'1MB' is no rate", "bit, kbit, Mbit, Gbit"]),
        ("bandwidth=0kbit", ["bandwidth must be more than zero"]),
        ("stall=2s", ["stall:", "'2s' does not say how often", "2s@10s"]),
        ("stall=2s@2s", ["stall of 2 s every 2 s cannot be", "end that long before the next"]),
        ("stall=0s@2s", ["cannot be", "must last 1ms or more"]),
        ("stall=2s@ten", ["'ten' is no time"]),
        ("seed=-1", ["seed:", "'-1' is no whole number"]),
        ("seed=1.5", ["'1.5' is no whole number"]),
        ("delay=1ms,delay=2ms", ["'delay' is given twice"]),
    ],
)
def test_a_mistake_is_named_with_what_is_valid(text: str, words: list[str]) -> None:
    with pytest.raises(LinkError) as raised:
        LinkSpec.parse(text)
    assert isinstance(raised.value, TwinError)
    for word in words:
        assert word in str(raised.value)


@pytest.mark.parametrize(
    "fields",
    [
        {"delay_s": -0.1},
        {"delay_s": math.nan},
        {"jitter_s": math.inf},
        {"loss": 1.5},
        {"loss": math.nan},
        {"reorder": -0.1},
        {"bandwidth_bit_per_s": -1.0},
        {"bandwidth_bit_per_s": math.nan},
        {"seed": -1},
    ],
)
def test_no_impossible_link_can_be_made_without_text_either(fields: dict[str, float]) -> None:
    with pytest.raises(LinkError):
        LinkSpec(**fields)


@pytest.mark.parametrize(
    ("length_s", "period_s"), [(-1.0, 2.0), (math.nan, 2.0), (1.0, math.inf), (1e-4, 1.0)]
)
def test_no_impossible_stall_can_be_made(length_s: float, period_s: float) -> None:
    with pytest.raises(LinkError):
        Stall(length_s, period_s)
