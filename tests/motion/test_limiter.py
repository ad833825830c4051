"""Limits that scale the whole twist: invariants, bounds and final twist."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.motion import TwistLimiter
from tsd_twin.robots.description import Limits

ROBOT = robots.load_robot("tsd")
DT_S = 0.01
ROUNDING = 1.0 + 1e-9

magnitudes = st.sampled_from([1e-300, 1e-9, 1e-3, 0.1, 1.0, 1.0, 3.0, 30.0, 1e9, 1e300])
"""Deliberately near zero and far beyond all limits."""


@st.composite
def twists(draw: st.DrawFn, largest: float = np.inf) -> Array:
    twist = np.array([draw(st.floats(-1.0, 1.0, allow_subnormal=False)) for _ in range(3)])
    twist *= draw(st.sampled_from([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    return twist * min(draw(magnitudes), largest)


class Case:
    """A limiter with independently stated limits."""

    def __init__(self, drive: SingularityKinematics, limits: Limits) -> None:
        self.drive, self.limits = drive, limits
        self.limiter = TwistLimiter(drive, limits)

    def sines(self, twist: Array) -> Array:
        """Sine of each module's tilt: pivot speed over rim speed."""
        x, y = self.drive.pivots_m.T
        ground = np.hypot(twist[0] - twist[2] * y, twist[1] + twist[2] * x)
        return ground / (self.drive.wheel_radius_m * abs(self.drive.spin_rad_per_s))

    def usage(self, twist: Array, share: float = 1.0) -> list[float]:
        """Fraction of each limit that a twist uses: speed, turn rate, tilt."""
        limits = self.limits
        return [
            float(np.hypot(*twist[:2]) / (limits.speed_mps * share)),
            abs(twist[2]) / (limits.turn_rate_rad_per_s * share),
            self.sines(twist).max() / np.sin(self.drive.max_tilt_rad),
        ]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """The `tsd` robot, or any other."""
    if draw(st.booleans()):
        return Case(ROBOT.kinematics(), ROBOT.limits)
    drive = SingularityKinematics(
        azimuths_rad=np.cumsum(draw(st.lists(st.floats(0.3, 1.5), min_size=2, max_size=4))),
        pivot_radius_m=draw(st.floats(0.05, 1.0)),
        wheel_radius_m=draw(st.floats(0.01, 0.2)),
        spin_rad_per_s=draw(st.floats(50.0, 1500.0)),
        max_tilt_rad=draw(st.floats(0.1, 1.2)),
        max_tilt_rate_rad_per_s=draw(st.floats(0.5, 20.0)),
    )
    limits = Limits(*[draw(st.floats(0.1, 10.0)) for _ in range(5)])
    return Case(drive, limits)


# The cap.


@given(case=cases(), twist=twists(), share=st.floats(0.05, 1.0))
def test_the_cap_keeps_direction_and_curvature_and_every_limit(
    case: Case, twist: Array, share: float
) -> None:
    capped = case.limiter.cap(twist, share)
    assert np.isfinite(capped).all()
    assert max(case.usage(capped, share)) <= ROUNDING
    largest = np.abs(twist).argmax()
    assume(twist[largest] != 0.0)
    kept = capped[largest] / twist[largest]
    assert 0.0 < kept <= 1.0
    np.testing.assert_allclose(capped, twist * kept, rtol=1e-9, atol=1e-300)


@given(case=cases(), twist=twists(largest=1e6), share=st.floats(0.05, 1.0))
def test_the_cap_takes_no_more_than_it_must(case: Case, twist: Array, share: float) -> None:
    capped = case.limiter.cap(twist, share)
    if max(case.usage(twist, share)) <= 1.0:
        np.testing.assert_allclose(capped, twist, rtol=1e-12)
    else:
        assert max(case.usage(capped, share)) == pytest.approx(1.0)
    np.testing.assert_allclose(case.limiter.cap(capped, share), capped, rtol=1e-12)


@pytest.mark.parametrize("size", [1e9, 1e300, 1.7e308])
def test_a_request_beyond_all_measure_asks_for_full_speed(size: float) -> None:
    limiter = TwistLimiter(ROBOT.kinematics(), ROBOT.limits)
    np.testing.assert_allclose(limiter.cap(np.array([size, 0, 0])), [1, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(
        limiter.cap(np.array([size, -size, 0])), [0.5**0.5, -(0.5**0.5), 0], rtol=1e-12
    )
    np.testing.assert_allclose(limiter.cap(np.array([0, 0, -size])), [0, 0, -3], rtol=1e-12)
    mixed = limiter.cap(np.array([size, size, size]))
    np.testing.assert_allclose(mixed, mixed[0], rtol=1e-12)


# Transition.


def advance(
    limiter: TwistLimiter, current: Array, request: Array, dt_s: float, share: Array | float = 1.0
) -> Array:
    return limiter.approach(current, limiter.cap(request, share), dt_s)


@given(case=cases(), start=twists(), request=twists(), dt_s=st.floats(1e-3, 0.1))
def test_a_step_goes_straight_and_no_faster_than_allowed(
    case: Case, start: Array, request: Array, dt_s: float
) -> None:
    limits = case.limits
    current, goal = case.limiter.cap(start), case.limiter.cap(request)
    step = advance(case.limiter, current, request, dt_s) - current
    acceleration = max(limits.acceleration_mps2, limits.deceleration_mps2)
    if np.hypot(*goal[:2]) > np.hypot(*current[:2]):
        acceleration = limits.acceleration_mps2
    assert np.hypot(*step[:2]) <= acceleration * dt_s * ROUNDING + 1e-15
    assert abs(step[2]) <= limits.angular_acceleration_rad_per_s2 * dt_s * ROUNDING + 1e-15
    whole = goal - current
    assert step @ step <= whole @ whole * ROUNDING
    np.testing.assert_allclose(np.cross(step, whole), 0.0, atol=1e-9 * max(1.0, whole @ whole))
    assert step @ whole >= 0.0


@given(case=cases(), start=twists(), request=twists(), dt_s=st.floats(1e-3, 0.1))
def test_between_two_allowed_twists_all_is_allowed(
    case: Case, start: Array, request: Array, dt_s: float
) -> None:
    current = case.limiter.cap(start)
    for _ in range(5):
        current = advance(case.limiter, current, request, dt_s)
        assert max(case.usage(current)) <= ROUNDING


@given(case=cases(), start=twists(), request=twists(), dt_s=st.floats(1e-3, 0.05))
def test_no_gimbal_is_asked_to_turn_faster_than_its_servo_can(
    case: Case, start: Array, request: Array, dt_s: float
) -> None:
    current = case.limiter.cap(start)
    following = advance(case.limiter, current, request, dt_s)
    # Joint angles before and after, from the kinematics instead of the limiter's bound.
    change = (case.drive.inverse(following) - case.drive.inverse(current)).reshape(-1, 3)[:, :2]
    assert np.abs(change).max() <= case.drive.max_tilt_rate_rad_per_s * dt_s * ROUNDING + 1e-12


@pytest.mark.parametrize("tilt_rate", [0.2, 0.7, 1.2])
def test_slow_servos_slow_the_robot_down(tilt_rate: float) -> None:
    """Wheels that turn slowly tilt far for little speed, so here the servos limit."""
    drive = ROBOT.kinematics().with_spin(60.0)
    drive = dataclasses.replace(drive, max_tilt_rate_rad_per_s=tilt_rate)
    limiter = TwistLimiter(drive, ROBOT.limits)
    current, fastest = np.zeros(3), 0.0
    for _ in range(20):
        following = advance(limiter, current, np.array([0.5, 0.0, 0.0]), DT_S)
        change = (drive.inverse(following) - drive.inverse(current)).reshape(-1, 3)[:, :2]
        fastest = max(fastest, np.abs(change).max() / DT_S)
        current = following
    assert 0.8 * tilt_rate < fastest <= tilt_rate * ROUNDING


@given(case=cases(), start=twists(), request=twists() | st.just(np.zeros(3)))
def test_what_is_asked_for_is_reached_exactly_and_kept(
    case: Case, start: Array, request: Array
) -> None:
    current, goal = case.limiter.cap(start), case.limiter.cap(request)
    for _ in range(20_000):
        if (current == goal).all():
            break
        current = advance(case.limiter, current, request, 0.05)
    np.testing.assert_array_equal(current, goal)
    np.testing.assert_array_equal(advance(case.limiter, current, request, 0.05), goal)


@given(case=cases(), start=twists())
def test_braking_only_ever_slows_and_keeps_the_curvature(case: Case, start: Array) -> None:
    current = first = case.limiter.cap(start)
    for _ in range(10):
        slower = advance(case.limiter, current, np.zeros(3), DT_S)
        assert (np.abs(slower) <= np.abs(current)).all()
        assert (slower * current >= 0.0).all()
        np.testing.assert_allclose(
            np.cross(slower, first), 0.0, atol=1e-12 * max(1.0, first @ first)
        )
        current = slower


@given(
    case=cases(),
    starts=st.lists(twists(), min_size=1, max_size=4),
    data=st.data(),
)
def test_a_batch_is_each_of_its_members(
    case: Case, starts: list[Array], data: st.DataObject
) -> None:
    n = len(starts)
    requests = data.draw(st.lists(twists(), min_size=n, max_size=n))
    shares = np.array(data.draw(st.lists(st.floats(0.05, 1.0), min_size=n, max_size=n)))
    current = np.stack([case.limiter.cap(start) for start in starts])
    together = advance(case.limiter, current, np.stack(requests), DT_S, shares)
    for i in range(n):
        alone = advance(case.limiter, current[i], requests[i], DT_S, float(shares[i]))
        np.testing.assert_allclose(together[i], alone, rtol=1e-12, atol=1e-300)


# Numbers of the `tsd` robot.


def run(request: Array, start: Array, seconds: float) -> Array:
    limiter = TwistLimiter(ROBOT.kinematics(), ROBOT.limits)
    twists = [start]
    for _ in range(round(seconds / DT_S)):
        twists.append(advance(limiter, twists[-1], request, DT_S))
    return np.array(twists)


def test_from_one_metre_a_second_it_brakes_within_85_mm() -> None:
    speeds = run(np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.3)[:, 0]
    # v^2 / (2 a) with a = 6 m/s^2 is 83 mm; held for a period each, the steps add half of one.
    assert np.trapezoid(speeds, dx=DT_S) == pytest.approx(1.0 / 12.0, abs=2e-3)
    assert speeds[17] == 0.0


def test_it_is_at_full_speed_after_a_quarter_of_a_second() -> None:
    speeds = run(np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.3)[:, 0]
    np.testing.assert_allclose(speeds[:26], 0.04 * np.arange(26), atol=1e-12)
    assert speeds[25] == pytest.approx(1.0)


def test_reversing_passes_through_rest() -> None:
    speeds = run(np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 1.0)[:, 0]
    assert speeds[-1] == -1.0
    assert (np.diff(speeds) <= 0.0).all()
    assert np.abs(np.diff(speeds)).max() <= 0.06 * ROUNDING


def test_turning_and_driving_stop_together() -> None:
    path = run(np.zeros(3), np.array([0.6, 0.0, 2.0]), 0.3)
    moving = path[path[:, 0] > 0.0]
    np.testing.assert_allclose(moving[:, 2] / moving[:, 0], 2.0 / 0.6)
    assert not path[-1].any()


@given(case=cases(), current=twists(largest=3.0), request=twists(), share=st.floats(0.1, 1.0))
def test_one_twist_is_the_member_of_a_batch(
    case: Case, current: Array, request: Array, share: float
) -> None:
    limiter, close = case.limiter, {"rtol": 1e-12, "atol": 1e-300}
    goals = limiter.cap(np.stack([request, current]), share)
    np.testing.assert_allclose(limiter.cap(request, share), goals[0], **close)
    start = limiter.cap(current)
    steps = limiter.approach(np.stack([start, start]), goals, DT_S)
    np.testing.assert_allclose(limiter.approach(start, goals[0], DT_S), steps[0], **close)


def test_a_limit_that_is_no_number_lets_no_twist_through() -> None:
    unknown = dataclasses.replace(ROBOT.kinematics(), max_tilt_rad=np.nan)
    limiter = TwistLimiter(unknown, ROBOT.limits)
    wish = np.array([0.3, 0.0, 0.0])
    assert np.isnan(limiter.cap(wish)).all()


def test_what_is_returned_belongs_to_the_caller() -> None:
    limiter, goal = TwistLimiter(ROBOT.kinematics(), ROBOT.limits), np.array([0.1, 0.0, 0.0])
    for current in (np.zeros(3), goal):
        limiter.approach(current, goal, 1.0)[:] = 9.0
    limiter.cap(goal)[:] = 9.0
    np.testing.assert_array_equal(goal, [0.1, 0.0, 0.0])
