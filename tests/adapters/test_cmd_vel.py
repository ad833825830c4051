"""Rules by which `cmd_vel` drives the robot and holds control, as pure logic."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.adapters.cmd_vel import (
    AT_REST_S,
    DISCOVERY_S,
    IDLE_S,
    LARGEST,
    MAX_AGE_S,
    PAUSE_S,
    TWIST,
    TWIST_STAMPED,
    Action,
    CmdVel,
    CmdVelOperator,
    Drive,
    HandOver,
    LeaseAction,
    State,
    decode_cmd_vel,
)
from tsd_twin.messages.cdr import BASE, ODOM, TwistStamped, encode_twist
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.ros_types import encode_cdr, make_twist
from tsd_twin.messages.status import LeaseStatus, Refusals, RobotStatus

ME = "foxglove-1"
PUSH = CmdVel((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
ZERO = CmdVel((0.0,) * 6)
PERIOD_S = 0.05
REST = Drive((0.0,) * 6, BASE, None)


def status(
    mode: str, holder: str | None = None, requested_by: str | None = None, reason: str | None = None
) -> RobotStatus:
    """Build a robot status."""
    lease = LeaseStatus(holder, requested_by=requested_by)
    return RobotStatus(mode, lease=lease, refusals=Refusals(drive=reason))


FREE, MINE = status("ready"), status("driving", ME)


def holder(now_s: float = 0.0) -> CmdVelOperator:
    """An operator that has just been granted the lease."""
    operator = CmdVelOperator(ME)
    assert operator.on_twist(PUSH, now_s, FREE, now_s) == [LeaseAction.ACQUIRE]
    operator.acquired(now_s)
    return operator


def poll_until(operator: CmdVelOperator, start_s: float, end_s: float) -> None:
    """Poll as a running program that has control."""
    for now_s in np.linspace(start_s, end_s, 11):
        assert not operator.poll(now_s, status("ready", ME))


def moves(actions: list[Action]) -> bool:
    return any(isinstance(action, Drive) and any(action.twist) for action in actions)


def texts(actions: list[Action]) -> str:
    return " ".join(action for action in actions if isinstance(action, str))


def test_a_twist_takes_a_free_robot_and_the_next_one_drives_it() -> None:
    operator = holder()
    assert operator.on_twist(PUSH, 0.05, MINE, 0.05) == [Drive(PUSH.twist, BASE, 0.05)]
    odom = CmdVel(PUSH.twist, ODOM)
    assert operator.on_twist(odom, 0.1, MINE, 0.1) == [Drive(PUSH.twist, ODOM, 0.1)]


def test_zeros_take_no_lease_and_keep_none() -> None:
    operator = CmdVelOperator(ME)
    assert not any(operator.on_twist(ZERO, 0.1 * i, FREE, 0.1 * i) for i in range(100))
    operator = holder()
    for i in range(1, round(IDLE_S / 0.1)):
        assert not operator.on_twist(ZERO, 0.1 * i, MINE, 0.1 * i)
        assert not operator.poll(0.1 * i, MINE)
    assert LeaseAction.GIVE_BACK in operator.poll(IDLE_S, MINE)
    assert operator.state is State.FREE


@given(st.floats(0.0, IDLE_S), st.booleans())
def test_a_conflict_ends_the_lease_also_while_driving(now_s: float, drives: bool) -> None:
    operator = holder()
    if drives:
        operator.on_twist(PUSH, now_s, MINE, now_s)
    actions = operator.poll(now_s, MINE, "two robots have one name")
    assert actions == [LeaseAction.GIVE_BACK, "the robot is disarmed: two robots have one name"]
    assert operator.state is State.FREE
    assert not operator.poll(now_s, FREE, "two robots have one name")


@given(st.floats(), st.integers(0, 5), st.booleans())
def test_only_finite_numbers_of_a_plausible_size_move_it(
    number: float, axis: int, held: bool
) -> None:
    twist = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    twist[axis] = number
    operator = holder() if held else CmdVelOperator(ME)
    x, y, z, wx, wy, wz = twist
    actions = operator.on_twist(CmdVel((x, y, z, wx, wy, wz)), 1.0, MINE if held else FREE, 1.0)
    plausible = math.isfinite(number) and abs(number) <= LARGEST
    acts = any(isinstance(action, Drive | LeaseAction) for action in actions)
    assert acts == (plausible and any(twist))


def test_a_frame_that_the_robot_does_not_know_is_refused() -> None:
    actions = holder().on_twist(CmdVel(PUSH.twist, "map"), 1.0, MINE, 1.0)
    assert not moves(actions)
    assert "'map'" in texts(actions)


@given(st.floats(0.0, 1.0))
def test_a_twist_that_may_be_too_old_does_not_count(age_s: float) -> None:
    operator = holder()
    assert moves(operator.on_twist(PUSH, 5.0, MINE, 5.0 - age_s)) == (
        5.0 - (5.0 - age_s) <= MAX_AGE_S
    )


def test_what_a_stalled_link_delivers_at_once_moves_nothing_until_the_publisher_has_paused() -> (
    None
):
    """Five seconds of twists arrive together while the publisher still holds its stick."""
    operator = holder()
    assert moves(operator.on_twist(PUSH, 1.0, MINE, 1.0))
    for i in range(100):
        assert not moves(operator.on_twist(PUSH, 6.0 + 1e-4 * i, MINE, 1.0))
    for i in range(40):  # Fresh twists follow without a pause.
        assert not moves(operator.on_twist(PUSH, 6.1 + PERIOD_S * i, MINE, 6.1 + PERIOD_S * i))
    after_s = 6.1 + 39 * PERIOD_S + PAUSE_S
    assert moves(operator.on_twist(PUSH, after_s, MINE, after_s))


def test_a_late_zero_still_ends_a_motion() -> None:
    operator = holder()
    assert moves(operator.on_twist(PUSH, 1.0, MINE, 1.0))
    assert operator.on_twist(ZERO, 1.1, MINE, -5.0) == [REST]


@pytest.mark.parametrize("mode", sorted(set(Mode) - {Mode.READY, Mode.DRIVING}))
def test_a_stick_that_is_held_while_the_robot_cannot_move_does_not_start_it_later(
    mode: str,
) -> None:
    operator = CmdVelOperator(ME)
    held = status(mode, reason="because of this")
    actions = operator.on_twist(PUSH, 0.0, held, 0.0)
    assert held.no_drive_reason in texts(actions)
    for i in range(1, 60):
        actions = operator.on_twist(PUSH, PERIOD_S * i, FREE, PERIOD_S * i)
        assert LeaseAction.ACQUIRE not in actions
    last_s = PERIOD_S * 59
    assert operator.on_twist(ZERO, last_s + 0.01, FREE, last_s) == []
    assert operator.on_twist(PUSH, last_s + 0.02, FREE, last_s) == [LeaseAction.ACQUIRE]


def test_what_was_sent_before_the_end_of_arming_does_not_count_after_it() -> None:
    operator = CmdVelOperator(ME)
    assert operator.on_request(0.0), "the lease is needed"
    operator.acquired(0.1)
    assert not moves(operator.on_twist(PUSH, 0.2, status("disarmed", ME), 0.2))
    operator.request_done(3.0)
    ready = status("ready", ME)
    assert not moves(operator.on_twist(PUSH, 3.1, ready, 2.95)), "held back, after a pause"
    late_s = 3.1 + PAUSE_S
    assert moves(operator.on_twist(PUSH, late_s, ready, late_s - 0.05))


def test_twists_during_a_request_move_nothing_when_it_is_done() -> None:
    operator = holder()
    assert not operator.on_request(1.0), "the lease is held"
    arming = status("arming", ME)
    for i in range(60):
        assert not moves(operator.on_twist(PUSH, 1.0 + PERIOD_S * i, arming, 1.0 + PERIOD_S * i))
    operator.request_done(4.0)
    for i in range(1, 60):
        now_s = 4.0 + PERIOD_S * i
        assert not moves(operator.on_twist(PUSH, now_s, status("ready", ME), now_s))


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.booleans(), st.booleans()), max_size=40))
def test_lost_control_is_not_taken_back_by_any_twists(
    steps: list[tuple[float, bool, bool]],
) -> None:
    operator = holder()
    assert moves(operator.on_twist(PUSH, 0.1, MINE, 0.1))
    said = operator.lost("bob has control now", 0.2)
    assert "bob has control now" in texts(said)
    now_s = 0.2
    for step_s, zero, free in steps:
        now_s += step_s
        view = FREE if free else status("driving", "bob")
        actions = operator.on_twist(ZERO if zero else PUSH, now_s, view, now_s)
        assert not any(isinstance(action, Drive | LeaseAction) for action in actions)
        assert not operator.poll(now_s, view)
    assert operator.on_request(now_s), "a request of a person takes it"
    operator.denied("bob drives", now_s)
    later_s = now_s + 10.0
    assert LeaseAction.ACQUIRE not in operator.on_twist(PUSH, later_s, FREE, later_s), (
        "it is lost as before"
    )
    assert operator.on_request(later_s)
    operator.acquired(later_s)
    again_s = later_s + PAUSE_S + 0.01
    poll_until(operator, later_s, again_s)
    assert moves(operator.on_twist(PUSH, again_s, MINE, again_s))


def test_another_operator_is_not_disturbed_and_the_stick_has_to_be_let_go_before_it_takes() -> None:
    operator = CmdVelOperator(ME)
    for i in range(20):
        actions = operator.on_twist(PUSH, PERIOD_S * i, status("driving", "bob"), PERIOD_S * i)
        assert not moves(actions)
        assert LeaseAction.ACQUIRE not in actions
    for i in range(20, 40):  # Bob has disconnected, and the stick is still held.
        assert LeaseAction.ACQUIRE not in operator.on_twist(PUSH, PERIOD_S * i, FREE, PERIOD_S * i)
    later_s = PERIOD_S * 39 + PAUSE_S
    assert operator.on_twist(PUSH, later_s, FREE, later_s) == [LeaseAction.ACQUIRE]


def test_a_motion_that_the_robot_has_ended_begins_again_only_after_a_pause() -> None:
    operator = holder()
    assert moves(operator.on_twist(PUSH, 1.0, MINE, 1.0))
    operator.motion_failed("tsd stopped by itself", 1.1)
    for i in range(20):
        now_s = 1.15 + PERIOD_S * i
        assert not moves(operator.on_twist(PUSH, now_s, status("ready", ME), now_s))


def test_a_person_who_asks_gets_control_when_no_twist_moves_the_robot() -> None:
    operator = holder()
    asked = status("driving", ME, requested_by="bob")
    for i in range(1, 40):
        operator.on_twist(PUSH, PERIOD_S * i, asked, PERIOD_S * i)
        assert not operator.poll(PERIOD_S * i, asked), "not in the middle of a motion"
    actions = operator.poll(PERIOD_S * 39 + AT_REST_S + 1e-6, asked)
    assert HandOver("bob") in actions
    assert operator.state is State.LOST


def test_a_twist_that_no_robot_reads_for_a_while_does_not_move_one_when_it_is_read_again() -> None:
    """A second robot changes the topic name; when it leaves, the name reverts."""
    operator = holder()
    assert moves(operator.on_twist(PUSH, 0.1, MINE, 0.1))
    for i in range(60):
        operator.on_unread(0.15 + PERIOD_S * i)
    now_s = 0.15 + PERIOD_S * 60
    assert not moves(operator.on_twist(PUSH, now_s, MINE, now_s))


@given(
    st.sampled_from(["free", "taking", "held"]),
    st.floats(0.0, 20.0),
    st.floats(0.0, DISCOVERY_S - 0.01),
)
def test_a_robot_that_comes_back_is_not_moved_by_a_twist_that_was_held_on(
    state: str, away_s: float, found_s: float
) -> None:
    """Its node was unreachable, so no twists arrived; then its topic is found again."""
    operator = CmdVelOperator(ME)
    if state != "free":
        assert operator.on_twist(PUSH, 0.0, FREE, 0.0) == [LeaseAction.ACQUIRE]
    if state == "held":
        operator.acquired(0.0)
    back_s = 0.1 + away_s
    said = texts(operator.connected(back_s))
    assert bool(said) == (state != "free")
    start_s = back_s + found_s
    for now_s in np.arange(start_s, start_s + 5.0, PERIOD_S):
        operator.poll(now_s, FREE)
        actions = operator.on_twist(PUSH, now_s, FREE, now_s)
        assert LeaseAction.ACQUIRE not in actions
        assert not moves(actions)
    later_s = start_s + 5.0 + PAUSE_S + 0.01
    poll_until(operator, start_s + 5.0, later_s)
    again = operator.on_twist(PUSH, later_s, FREE, later_s)
    # Lost control is taken again only by service call.
    assert (LeaseAction.ACQUIRE in again) == (state != "held")


def test_a_topic_that_gets_its_name_back_moves_nothing_by_a_twist_that_was_held_on() -> None:
    """While a second robot existed, this topic was not read."""
    operator = holder()
    assert moves(operator.on_twist(PUSH, 0.1, MINE, 0.1))
    operator.topic_opened(10.0)
    for now_s in np.arange(11.0, 14.0, PERIOD_S):
        assert not moves(operator.on_twist(PUSH, now_s, MINE, now_s))
    assert operator.state is State.HELD


def test_the_same_sentence_is_not_said_fifty_times_a_second() -> None:
    operator = CmdVelOperator(ME)
    bad = CmdVel((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))
    said = [operator.on_twist(bad, 0.02 * i, FREE, 0.02 * i) for i in range(100)]
    assert sum(map(bool, said)) == 1
    assert operator.dropped == 100


# Decoding.

NUMBERS = (0.5, -0.25, 0.125, 1.0, -2.0, 3.0)
LINEAR = dict(zip("xyz", NUMBERS[:3], strict=True))
ANGULAR = dict(zip("xyz", NUMBERS[3:], strict=True))
AS_JSON = {"linear": LINEAR, "angular": ANGULAR}


@pytest.mark.parametrize("name", [TWIST, "geometry_msgs/Twist"])
def test_a_twist_means_the_same_in_each_encoding(name: str) -> None:
    cdr = encode_cdr(make_twist(NUMBERS))
    assert decode_cmd_vel("cdr", name, cdr) == CmdVel(NUMBERS)
    assert decode_cmd_vel("json", name, json.dumps(AS_JSON).encode()) == CmdVel(NUMBERS)


@pytest.mark.parametrize("name", [TWIST_STAMPED, "geometry_msgs/TwistStamped"])
def test_of_a_stamped_twist_the_frame_counts_and_the_stamp_does_not(name: str) -> None:
    for stamp in (0, 10**18):
        cdr = encode_twist(TwistStamped(ODOM, np.array(NUMBERS), stamp))
        assert decode_cmd_vel("cdr", name, cdr) == CmdVel(NUMBERS, ODOM)
    header: dict[str, Any] = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": ODOM}
    text = json.dumps({"header": header, "twist": AS_JSON}).encode()
    assert decode_cmd_vel("json", name, text) == CmdVel(NUMBERS, ODOM)


@pytest.mark.parametrize(
    ("encoding", "name", "payload"),
    [
        ("json", TWIST, b'{"linear": {"x": NaN}}'),
        ("json", TWIST, b'{"linear": {"x": "1"}}'),
        ("json", TWIST, b'{"speed": 1.0}'),
        ("json", TWIST, b"[" * 100_000),
        ("json", TWIST, b"\xff\xfe"),
        ("json", TWIST_STAMPED, json.dumps(AS_JSON).encode()),
        ("json", "nav_msgs/msg/Odometry", b"{}"),
        ("cdr", TWIST, b""),
        ("cdr", TWIST, b"\0\1\0\0" + bytes(20)),
        ("cdr", TWIST, bytes(1_000_000)),
        ("protobuf", TWIST, b"{}"),
        ("json", "", b"{}"),
    ],
)
def test_what_is_no_twist_is_refused(encoding: str, name: str, payload: bytes) -> None:
    with pytest.raises(MessageError):
        decode_cmd_vel(encoding, name, payload)


@given(st.sampled_from(["cdr", "json"]), st.sampled_from([TWIST, TWIST_STAMPED]), st.binary())
def test_any_bytes_are_a_twist_or_are_refused(encoding: str, name: str, payload: bytes) -> None:
    try:
        message = decode_cmd_vel(encoding, name, payload)
    except MessageError:
        return
    assert len(message.twist) == 6


@pytest.mark.parametrize("first", ["a twist", "a poll"])
def test_time_in_which_the_program_stood_still_is_no_pause_of_the_publisher(first: str) -> None:
    """All twists of that time may be lost, and a held stick is not a new push."""
    operator, ready, now_s = holder(), status("ready", ME), 0.0
    assert moves(operator.on_twist(PUSH, 0.05, MINE, 0.05))
    operator.poll(0.1, MINE)
    start_s = 0.1 + 5.0 * PAUSE_S
    if first == "a poll":
        operator.poll(start_s, ready)
    for now_s in start_s + PERIOD_S * np.arange(40):
        assert not moves(operator.on_twist(PUSH, now_s, ready, now_s))
        operator.poll(now_s, ready)
    paused_s = now_s + PAUSE_S
    poll_until(operator, now_s, paused_s)
    assert moves(operator.on_twist(PUSH, paused_s, ready, paused_s))


def streaming(operator: CmdVelOperator, start_s: float, end_s: float, view: RobotStatus) -> bool:
    """Stream twists without a pause; return whether one moves the robot."""
    times_s = np.arange(start_s, end_s, PERIOD_S)
    moved = [moves(operator.on_twist(PUSH, now_s, view, now_s)) for now_s in times_s]
    return any(moved)


AT_REST = status("ready", ME)


def test_a_controller_that_streams_moves_again_after_a_stall_by_resume_and_only_once() -> None:
    operator = holder()
    assert streaming(operator, 0.1, 0.5, MINE)
    for stall_s in (1.0, 5.0):
        late = operator.on_twist(PUSH, stall_s, AT_REST, stall_s - 1.0)
        assert "too late" in texts(late)
        assert not streaming(operator, stall_s + 0.05, stall_s + 2.0, AT_REST)
        assert operator.waits_for_pause(stall_s + 2.0)
        assert operator.resume(stall_s + 2.0, AT_REST) == ""
        assert not operator.waits_for_pause(stall_s + 2.0)
        assert streaming(operator, stall_s + 2.05, stall_s + 2.5, AT_REST)


def test_resume_is_refused_while_the_robot_moves_or_cannot_be_driven() -> None:
    operator = holder()
    assert streaming(operator, 0.1, 0.5, MINE)
    assert "at rest" in operator.resume(0.6, MINE)
    assert "at rest" in operator.resume(0.6, AT_REST), "it has driven just now"
    disarmed = status("disarmed", ME)
    assert disarmed.no_drive_reason in operator.resume(5.0, disarmed)
    assert "alice" in operator.resume(5.0, status("ready", "alice"))
    operator.lost("taken", 5.0)
    assert "arm" in operator.resume(6.0, AT_REST)


def test_resume_counts_no_twist_that_was_sent_before_it() -> None:
    operator = holder()
    operator.on_unread(0.9)
    assert operator.resume(1.0, AT_REST) == ""
    assert not moves(operator.on_twist(PUSH, 1.1, AT_REST, 0.95))
    assert moves(operator.on_twist(PUSH, 1.15, AT_REST, 1.05))


def test_an_unproven_twist_ends_a_pause_and_moves_nothing() -> None:
    operator = holder()
    operator.on_unread(0.0)
    assert texts(operator.on_twist(PUSH, 1.0, MINE, 1.0, "not known yet")) == "not known yet"
    assert moves(operator.on_twist(PUSH, 1.05, MINE, 1.05))
    operator.on_unread(1.1)
    assert not moves(operator.on_twist(PUSH, 1.15, MINE, 1.15, "not known yet"))
    assert not moves(operator.on_twist(PUSH, 1.2, MINE, 1.2)), "no pause was there"
    assert operator.on_twist(ZERO, 1.25, MINE, 1.25, "not known yet") == [REST]
