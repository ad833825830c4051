"""Acceptance of commands, and drop reasons of the rest."""

from __future__ import annotations

import dataclasses
import itertools
import pickle
import random
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.cdr import TwistStamped, encode_twist
from tsd_twin.messages.commands import Command, encode_attachment
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import Sample
from tsd_twin.safety import Lease
from tsd_twin.safety.command_gate import CommandGate

LEASE_ID = b"L" * 16
REASONS = ("stale", "lease", "order", "nonfinite", "key", "shape")
FRESH = 7
"""Number of a status sent just now."""
OLD = 3
"""Number of a status sent 1 s ago."""
NOW_S = 50.0


def lease(holder: str = "alice", id_: bytes = LEASE_ID, max_age_s: float = 0.25) -> Lease:
    return Lease(holder, id_, NOW_S + 2.0, max_age_s, 1.0, 0.2)


def new_gate() -> CommandGate:
    gate = CommandGate()
    gate.record_status(OLD, NOW_S - 1.0)
    gate.record_status(FRESH, NOW_S)
    return gate


def sample(
    seq: int = 1,
    lease_id: bytes = LEASE_ID,
    status_seq: int = FRESH,
    vx: float = 0.5,
    operator: str = "alice",
    frame: str = "base_link",
) -> Sample:
    twist = np.array([vx, 0.0, 0.0, 0.0, 0.0, 0.0])
    return Sample(
        f"twin/tsd/cmd/{operator}/twist",
        encode_twist(TwistStamped(frame, twist)),
        encode_attachment(seq, lease_id, status_seq),
    )


def counts(gate: CommandGate) -> dict[str, int]:
    return {k: v for k, v in msgspec.to_builtins(gate.dropped).items() if v}


def drop(gate: CommandGate, bad: Sample, of: Lease | None, now_s: float = NOW_S) -> str:
    """Return the drop reason of a sample."""
    before, accepted = counts(gate), gate.accepted
    outcome = gate.validate(bad, of, now_s)
    assert isinstance(outcome, MessageError)
    assert gate.accepted == accepted
    after = counts(gate)
    assert sum(after.values()) == sum(before.values()) + 1
    assert after[outcome.reason] == before.get(outcome.reason, 0) + 1
    return outcome.reason


def test_a_command_that_keeps_all_rules_counts() -> None:
    gate = new_gate()
    outcome = gate.validate(sample(), lease(), NOW_S)
    assert isinstance(outcome, Command)
    assert (outcome.operator, outcome.seq, outcome.twist[0]) == ("alice", 1, 0.5)
    assert gate.accepted == 1
    assert counts(gate) == {}


@pytest.mark.parametrize(
    ("reason", "bad"),
    [
        ("key", sample(operator="*")),
        ("key", dataclasses.replace(sample(), is_put=False)),
        ("shape", dataclasses.replace(sample(), payload=b"hello")),
        ("shape", dataclasses.replace(sample(), attachment=b"")),
        ("shape", sample(frame="map")),
        ("nonfinite", sample(vx=np.nan)),
        ("nonfinite", sample(vx=np.inf)),
        ("lease", sample(lease_id=b"M" * 16)),
        ("lease", sample(operator="bob")),
        ("stale", sample(status_seq=OLD)),
        ("stale", sample(status_seq=FRESH + 1)),
        ("stale", sample(status_seq=0)),
    ],
)
def test_each_broken_rule_is_counted_under_its_own_reason(reason: str, bad: Sample) -> None:
    gate = new_gate()
    assert drop(gate, bad, lease()) == reason
    assert counts(gate) == {reason: 1}


def test_without_a_lease_nothing_counts() -> None:
    assert drop(new_gate(), sample(), None) == "lease"


def test_the_lease_of_another_operator_does_not_help() -> None:
    gate = new_gate()
    assert drop(gate, sample(operator="bob"), lease("alice")) == "lease"
    assert drop(gate, sample(operator="alice"), lease("bob")) == "lease"


def test_a_command_that_is_sent_again_does_not_count_again() -> None:
    gate, first = new_gate(), sample(5)
    assert isinstance(gate.validate(first, lease(), NOW_S), Command)
    assert drop(gate, first, lease()) == "order"
    assert drop(gate, sample(4), lease()) == "order"
    assert isinstance(gate.validate(sample(6), lease(), NOW_S), Command)


def test_a_dropped_command_does_not_use_up_its_number() -> None:
    gate = new_gate()
    assert drop(gate, sample(9, status_seq=OLD), lease()) == "stale"
    assert drop(gate, sample(10, lease_id=b"M" * 16), lease()) == "lease"
    assert isinstance(gate.validate(sample(1), lease(), NOW_S), Command)


def test_a_new_lease_restarts_the_numbers() -> None:
    gate = new_gate()
    gate.validate(sample(1000), lease(), NOW_S)
    renewed = lease(id_=b"N" * 16)
    assert isinstance(gate.validate(sample(1, lease_id=b"N" * 16), renewed, NOW_S), Command)
    assert drop(gate, sample(1001), renewed) == "lease"


@pytest.mark.parametrize("max_age_s", [0.25, 0.6, 1.0])
def test_the_age_is_counted_from_when_the_echoed_status_was_sent(max_age_s: float) -> None:
    gate = new_gate()
    granted = lease(max_age_s=max_age_s)
    assert isinstance(gate.validate(sample(1), granted, NOW_S + max_age_s - 1e-3), Command)
    assert drop(gate, sample(2), granted, NOW_S + max_age_s + 1e-3) == "stale"


def test_a_burst_of_stale_commands_has_no_effect() -> None:
    """Worst observed: a link stalls for 7.3 s, then delivers 347 commands at once, in order."""
    gate, numbers = CommandGate(), itertools.count(1)
    sent = []
    for i in range(365):
        gate.record_status(next(numbers), NOW_S + 0.02 * i)
        sent.append(sample(i, status_seq=i + 1))
    now_s = NOW_S + 0.02 * 365
    outcomes = [gate.validate(late, lease(max_age_s=0.25), now_s) for late in sent]
    counted = [o.seq for o in outcomes if isinstance(o, Command)]
    assert counted == list(range(353, 365))  # Commands of the last quarter of a second.
    assert counts(gate) == {"stale": 353}


def test_a_command_sent_before_a_stop_was_seen_does_not_count_after_it() -> None:
    """It is recent enough, but its sender may have released the stick since, under any lease."""
    gate, patient = new_gate(), lease(max_age_s=1.0)
    assert isinstance(gate.validate(sample(0), patient, NOW_S), Command)
    gate.reject_sent_before(NOW_S + 0.2)
    gate.record_status(FRESH + 1, NOW_S + 0.2)
    assert drop(gate, sample(1), patient, NOW_S + 0.3) == "stale"
    assert isinstance(gate.validate(sample(2, status_seq=FRESH + 1), patient, NOW_S + 0.3), Command)
    other = lease("bob", b"N" * 16, max_age_s=1.0)
    assert drop(gate, sample(1, b"N" * 16, operator="bob"), other, NOW_S + 0.3) == "stale"


@pytest.mark.parametrize("status_seq", [OLD, FRESH + 1, 0])
def test_a_zero_in_order_counts_however_old_it_is(status_seq: int) -> None:
    gate = new_gate()
    assert isinstance(gate.validate(sample(5), lease(), NOW_S), Command)
    gate.reject_sent_before(NOW_S + 0.1)
    zero = sample(6, status_seq=status_seq, vx=0.0)
    assert isinstance(gate.validate(zero, lease(), NOW_S + 0.5), Command)
    assert gate.is_stale_zero
    assert drop(gate, sample(6), lease()) == "order", "what was sent before the zero is over"
    assert drop(gate, sample(7, vx=0.0), None) == "lease"
    assert drop(gate, sample(7, vx=0.0, operator="bob"), lease()) == "lease"


def test_only_a_bounded_number_of_status_is_remembered() -> None:
    gate = CommandGate()
    for number in range(1000, 10_000):
        gate.record_status(number, NOW_S)
        if number < 2000:
            bound = len(pickle.dumps(gate))
    assert len(pickle.dumps(gate)) <= bound, "no more than 1000 are kept"
    assert isinstance(gate.validate(sample(status_seq=9_999), lease(), NOW_S), Command)
    assert drop(gate, sample(2, status_seq=1), lease()) == "stale"


samples = st.builds(
    sample,
    seq=st.integers(0, 20),
    lease_id=st.sampled_from([LEASE_ID, b"M" * 16]),
    status_seq=st.sampled_from([OLD, FRESH, FRESH, 99]),
    vx=st.sampled_from([0.0, 0.5, 1e300, np.nan, -np.inf]),
    operator=st.sampled_from(["alice", "alice", "bob", "*"]),
    frame=st.sampled_from(["base_link", "odom", "map"]),
) | st.builds(Sample, st.text(max_size=9), st.binary(max_size=9), st.binary(max_size=9))


@given(script=st.lists(samples, max_size=40), holder=st.none() | st.sampled_from(["alice", "bob"]))
def test_every_sample_is_counted_exactly_once(script: list[Sample], holder: str | None) -> None:
    gate = new_gate()
    of = lease(holder) if holder else None
    numbers = []
    for one in script:
        outcome: Any = gate.validate(one, of, NOW_S)
        if isinstance(outcome, Command):
            numbers.append(outcome.seq)
            assert outcome.operator == holder
            assert np.isfinite(outcome.twist).all()
    assert gate.accepted == len(numbers)
    assert gate.accepted + sum(counts(gate).values()) == len(script)
    assert set(counts(gate)) <= set(REASONS)
    assert all(a < b for a, b in itertools.pairwise(numbers))


def test_a_flood_out_of_order_counts_only_what_rises() -> None:
    gate, numbers = new_gate(), list(range(200))
    random.Random(1).shuffle(numbers)  # noqa: S311  No secret depends on it.
    highest, rising = -1, 0
    for number in numbers:
        gate.validate(sample(number), lease(), NOW_S)
        rising += number > highest
        highest = max(highest, number)
    assert (gate.accepted, counts(gate)) == (rising, {"order": 200 - rising})
