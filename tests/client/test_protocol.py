"""Properties of the operator protocol, in virtual time."""

from __future__ import annotations

import math
import struct
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.client import ClientError, ControlLost, RobotSilent, RobotStopped
from tsd_twin.client.held_lease import RENEW_PERIOD_S
from tsd_twin.client.protocol import (
    COMMAND_PERIOD_S,
    SETPOINT_TIMEOUT_S,
    STATUS_TIMEOUT_S,
    ControlProtocol,
    TwistCommand,
)
from tsd_twin.messages.cdr import decode_twist
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply, LeaseRequest
from tsd_twin.messages.status import CommandStatus, LeaseStatus, RobotStatus

ROBOT = robots.load_robot("tsd")
LEASE = "0f" * 16
TWIST = (0.3, 0.0, 0.0)


def status(mode: str = "ready", holder: str | None = "alice", **fields: Any) -> RobotStatus:
    return RobotStatus(mode=mode, lease=LeaseStatus(holder=holder), **fields)


def granted(now_s: float = 0.0) -> ControlProtocol:
    """A protocol that holds the lease of a ready robot."""
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    protocol.receive_status(status(), 1, now_s)
    protocol.grant(LeaseReply(True, LEASE, "alice", 2.0, "", 0.25), now_s)
    return protocol


def parts(command: TwistCommand) -> tuple[int, bytes, int]:
    return struct.unpack("<Q16sQ", command.attachment)


def speed(command: TwistCommand) -> float:
    return float(np.abs(decode_twist(command.payload).twist).max())


@given(st.lists(st.one_of(st.none(), st.integers(-3, 30)), max_size=60))
def test_numbers_rise_and_each_command_echoes_the_newest_status(steps: list[int | None]) -> None:
    """Statuses arrive in any order; None is a command."""
    protocol, newest, last = granted(), 1, 0
    for step in steps:
        if step is None:
            number, lease, echoed = parts(protocol.command(TWIST, "base_link", 0.0))
            assert number > last
            assert lease == bytes.fromhex(LEASE)
            assert echoed == newest
            last = number
        else:
            # Up to three behind the latest, as with reordering.
            seq = max(1, newest + step)
            protocol.receive_status(status(), seq, 0.0)
            newest = max(newest, seq)


def test_a_restarted_robot_counts_its_statuses_from_one() -> None:
    protocol = granted()
    protocol.receive_status(status(), 5000, 0.1)
    protocol.receive_status(status("disarmed"), 1, 0.2)
    assert protocol.status_seq == 1
    assert protocol.mode is Mode.DISARMED


@given(
    st.lists(st.floats(0.001, 0.3), min_size=1, max_size=40),
    st.lists(st.booleans(), min_size=40, max_size=40),
)
def test_a_set_point_moves_the_robot_for_no_longer_than_its_time_out(
    gaps_s: list[float], refreshes: list[bool]
) -> None:
    """For any schedule of caller and sender, no motion is sent 0.2 s after a refresh."""
    protocol, now_s, seq = granted(), 0.0, 1
    refreshed_s = -math.inf
    for gap_s, refresh in zip(gaps_s, refreshes, strict=False):
        now_s, seq = now_s + gap_s, seq + 1
        protocol.receive_status(status("driving" if protocol.in_motion else "ready"), seq, now_s)
        if refresh:
            refreshed_s = now_s
            command = protocol.set_velocity(TWIST, "base_link", now_s)
        else:
            command = protocol.poll_command(now_s)
        if command is not None and speed(command) > 0.0:
            assert now_s - refreshed_s < SETPOINT_TIMEOUT_S


@given(st.lists(st.floats(0.0005, 0.05), min_size=1, max_size=200))
def test_the_caller_cannot_flood_the_robot(gaps_s: list[float]) -> None:
    """For any refresh rate, at most 100 commands per second, plus the periodic ones."""
    protocol, now_s, refreshed_s, sent_s = granted(), 0.0, -math.inf, -math.inf
    for gap_s in gaps_s:
        now_s += gap_s
        protocol.receive_status(status("driving" if protocol.in_motion else "ready"), 2, now_s)
        if protocol.poll_command(now_s) is not None:
            assert now_s - sent_s > 0.0199
            sent_s = now_s
        if protocol.set_velocity(TWIST, "base_link", now_s) is not None:
            assert now_s - refreshed_s > 0.0099
            refreshed_s = sent_s = now_s


def test_a_refresh_at_50_hz_goes_out_at_once() -> None:
    """Even if the library repeated the last setpoint a moment before."""
    protocol = granted()
    for tick in range(1, 50):
        now_s = 0.021 * tick
        protocol.receive_status(status("driving" if protocol.in_motion else "ready"), tick, now_s)
        protocol.poll_command(now_s)
        assert protocol.set_velocity((0.001 * tick, 0.0, 0.0), "base_link", now_s) is not None


def test_a_set_point_that_expires_ends_in_zeros_until_the_robot_rests() -> None:
    protocol = granted()
    first = protocol.set_velocity(TWIST, "base_link", 1.0 - 1.0)
    assert first is not None
    zeros: list[TwistCommand] = []
    for tick in range(1, 60):
        now_s = 0.01 * tick
        rested = len(zeros) > 5
        shown = CommandStatus(seq=zeros[-1].seq if rested else first.seq)
        protocol.receive_status(
            status("ready" if rested else "driving", command=shown), 1 + tick, now_s
        )
        command = protocol.poll_command(now_s)
        if command is not None and now_s >= SETPOINT_TIMEOUT_S:
            assert speed(command) == 0.0
            zeros.append(command)
    assert len(zeros) == 6
    assert not protocol.in_motion


@pytest.mark.parametrize(
    ("news", "error"),
    [
        (status("stopped", stop_reason="software stop by bob"), RobotStopped),
        (status("fault", stop_reason="a servo is hot"), RobotStopped),
        (status("disarmed"), RobotStopped),
        (status("ready", stops=1, stop_reason="no command for 200 ms"), RobotStopped),
        (status("stopping", stops=1), RobotStopped),
        (status("driving", holder="bob"), ControlLost),
        (status("ready", holder=None), ControlLost),
    ],
)
def test_what_ends_a_motion(news: RobotStatus, error: type[ClientError]) -> None:
    protocol = granted()
    protocol.begin_motion(1.0 - 0.9)
    protocol.receive_status(news, 2, 1.0)
    with pytest.raises(error) as raised:
        protocol.check_motion(1.0)
    assert news.stop_reason in str(raised.value)


def test_a_failed_set_point_sends_nothing_and_raises_once() -> None:
    protocol = granted()
    protocol.set_velocity(TWIST, "base_link", 0.0)
    protocol.receive_status(status("stopping", stops=1, stop_reason="held up"), 2, 0.05)
    assert protocol.poll_command(0.05) is None
    assert protocol.poll_command(0.1) is None
    protocol.receive_status(status("ready", stops=1), 3, 0.15)
    with pytest.raises(RobotStopped, match="held up"):
        protocol.set_velocity(TWIST, "base_link", 0.15)
    assert protocol.set_velocity(TWIST, "base_link", 0.2) is not None


def test_silence_ends_a_motion() -> None:
    protocol = granted()
    protocol.begin_motion(0.0)
    protocol.check_motion(STATUS_TIMEOUT_S)
    with pytest.raises(RobotSilent):
        protocol.check_motion(STATUS_TIMEOUT_S + 0.01)


def test_a_status_from_before_the_grant_does_not_lose_the_lease() -> None:
    protocol = granted(now_s=10.0)
    protocol.receive_status(status(holder=None), 2, 10.2)
    assert protocol.has_lease
    protocol.receive_status(status(holder=None), 3, 10.4)
    assert not protocol.has_lease


@given(st.lists(st.floats(0.001, 1.0), min_size=1, max_size=50))
def test_the_lease_is_renewed_in_time_and_no_more_often(gaps_s: list[float]) -> None:
    protocol, now_s, renewed_s = granted(), 0.0, 0.0
    for gap_s in gaps_s:
        now_s += gap_s
        request = protocol.renewal(now_s)
        assert (request is not None) == (now_s - renewed_s >= RENEW_PERIOD_S)
        if request is not None:
            renewed_s = now_s
            asked = msgspec.json.decode(request, type=LeaseRequest)
            assert (asked.op, asked.operator, asked.lease) == ("renew", "alice", LEASE)


def test_a_refused_renewal_loses_the_lease_and_silence_does_not() -> None:
    protocol = granted()
    request = protocol.renewal(1.0)
    assert request is not None
    protocol.receive_renewal(request, None, 1.0)
    assert protocol.has_lease
    refusal = LeaseReply(False, holder="bob", reason="this lease is not in force")
    protocol.receive_renewal(request, msgspec.json.encode(refusal), 0.01)
    with pytest.raises(ControlLost) as lost:
        protocol.command(TWIST, "base_link", 1.0)
    assert (lost.value.code, lost.value.params) == ("has_control_now", {"holder": "bob"})


def test_the_answer_to_a_renewal_of_an_earlier_lease_means_nothing() -> None:
    protocol = granted()
    request = protocol.renewal(1.0)
    assert request is not None
    protocol.grant(LeaseReply(True, "ab" * 16, "alice", 2.0, "", 0.25), 1.0)
    refusal = LeaseReply(False, reason="this lease is not in force")
    protocol.receive_renewal(request, msgspec.json.encode(refusal), 0.01)
    assert protocol.has_lease


def test_numbers_go_on_above_those_of_the_previous_holder() -> None:
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    protocol.receive_status(status(command=CommandStatus(seq=700)), 1, 0.0)
    protocol.grant(LeaseReply(True, LEASE, "alice", 2.0, "", 0.25), 0.0)
    command = protocol.command((0.0, 0.0, 0.0), "base_link", 0.0)
    assert command.seq > 700
    assert not protocol.at_rest_since(command.seq)
    protocol.receive_status(status(command=CommandStatus(seq=command.seq)), 2, 0.1)
    assert protocol.at_rest_since(command.seq)


def test_the_last_number_of_a_previous_holder_blocks_no_other() -> None:
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    protocol.receive_status(status(command=CommandStatus(seq=2**64 - 1)), 1, 0.0)
    protocol.grant(LeaseReply(True, LEASE, "alice", 2.0, "", 0.25), 0.0)
    command = protocol.command((0.0, 0.0, 0.0), "base_link", 0.0)
    assert not protocol.has_counted(command.seq)
    assert not protocol.at_rest_since(command.seq)
    protocol.receive_status(status(command=CommandStatus(seq=command.seq)), 2, 0.1)
    assert protocol.has_counted(command.seq)


@pytest.mark.parametrize("twist", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0)])
def test_a_twist_is_three_finite_numbers(twist: tuple[float, ...]) -> None:
    protocol = granted()
    with pytest.raises(ClientError, match="three finite numbers"):
        protocol.command(twist, "base_link", 0.0)
    with pytest.raises(ClientError, match="three finite numbers"):
        protocol.set_velocity(twist, "base_link", 0.0)


def test_without_the_lease_nothing_is_sent() -> None:
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    protocol.receive_status(status(), 1, 0.0)
    with pytest.raises(ControlLost):
        protocol.command(TWIST, "base_link", 0.0)
    with pytest.raises(ControlLost):
        protocol.set_velocity(TWIST, "base_link", 0.0)
    assert protocol.poll_command(COMMAND_PERIOD_S) is None
    assert protocol.renewal(10.0) is None
