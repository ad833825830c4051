"""Navigation: the robot reaches any clicked or drawn goal, and moves only while held."""

from __future__ import annotations

from collections import deque

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test

from tsd_twin import robots
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.codes import Code
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.routes import LONGEST_M, NavigationGoal
from tsd_twin.motion.tracking import (
    FAIR_RAD,
    MAX_TRACKING_ERROR_M,
    STUCK_S,
    TIMEOUT_TOLERANCE_M,
    ExecutionPhase,
    ExecutionStep,
    TrajectoryExecutor,
)
from tsd_twin.motion.trajectory import plan
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

PLANAR = ["tsd", "omni4", "kiwi", "mecanum"]
HELD = 2
"""Periods for which a command is held; the page sends a hold message every 20 ms."""
ASIDE_M = 0.08

coordinates = st.floats(-2.0, 2.0)
places = st.tuples(coordinates, coordinates)
headings = st.none() | st.floats(-3.1, 3.1)


@st.composite
def drawings(draw: st.DrawFn) -> Array:
    """A hand-drawn line with drift and jitter of a few millimetres."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    direction = draw(st.floats(-3.0, 3.0)) + np.cumsum(rng.normal(0.0, 0.12, 60))
    steps = draw(st.floats(0.01, 0.05)) * np.stack([np.cos(direction), np.sin(direction)], -1)
    return np.cumsum(steps, axis=0) + rng.normal(0.0, 0.004, (60, 2))


def follower_of(
    robot: RobotDescription, navigation_goal: NavigationGoal, start: SE2, *, delay_s: float = 0.0
) -> TrajectoryExecutor:
    limits = msgspec.structs.replace(robot.limits, speed_mps=0.8 * robot.limits.speed_mps)
    drive = robot.kinematics()
    trajectory = plan(navigation_goal.route(start), drive, limits, share=0.7, cell_m=0.02)
    cap = TwistLimiter(drive, limits).cap
    return TrajectoryExecutor(trajectory, cap, lag_s=robot.lag_s, delay_s=delay_s)


class Ride:
    """A robot in virtual time, and an operator who holds the button, over any delay."""

    def __init__(self, name: str, delay_s: float = 0.0) -> None:
        self.robot = robots.load_robot(name)
        self.virtual = VirtualRobot(self.robot, SimRobot(self.robot, seed=1))
        late = round(0.5 * delay_s / PERIOD_S)
        self._there = deque([np.zeros(3)] * late, late + 1)
        self._back = deque([self.seen] * late, late + 1)
        self._delay_s = delay_s
        self.way: list[Array] = []

    @property
    def seen(self) -> SE2:
        return SE2(self.virtual.odometry().xy_heading)

    def follow(
        self, navigation_goal: NavigationGoal, *, periods: int = 10_000
    ) -> tuple[TrajectoryExecutor, ExecutionStep]:
        follower = follower_of(self.robot, navigation_goal, self.seen, delay_s=self._delay_s)
        for i in range(periods):
            self._back.append(self.seen)
            if i % HELD == 0:
                step = follower.advance(i * PERIOD_S, self._back[0])
                if step.phase is not ExecutionPhase.GOING:
                    break
            self.drive(step.twist)
        return follower, step

    def drive(self, twist: Array) -> None:
        self._there.append(twist)
        self.virtual.drive(self._there[0])
        self.way.append(self.virtual.truth.xy_heading)

    def rest(self) -> None:
        for _ in range(100):
            self.drive(np.zeros(3))


@pytest.mark.parametrize("name", PLANAR)
@settings(max_examples=3)
@given(goal=places, heading=headings)
def test_a_place_that_is_clicked_on_is_reached(
    name: str, goal: tuple[float, float], heading: float | None
) -> None:
    assume(np.hypot(*goal) > 0.01)
    ride = Ride(name)
    _, step = ride.follow(NavigationGoal(np.array([goal]), heading))
    assert step.phase is ExecutionPhase.ARRIVED, step.reason
    assert not step.twist.any()
    ride.rest()
    x, y, h = ride.seen.xy_heading
    assert np.hypot(x - goal[0], y - goal[1]) < TIMEOUT_TOLERANCE_M
    assert abs(wrap(h - (heading or 0.0))) < FAIR_RAD
    assert np.abs(ride.virtual.true_twist).max() < 0.01
    # On a straight path, the lateral error is limited by the joint resolution.
    along = np.array(goal) / np.hypot(*goal)
    way = np.array(ride.way)[:, :2]
    assert np.abs(way[:, 1] * along[0] - way[:, 0] * along[1]).max() < ASIDE_M


@settings(max_examples=5)
@given(points=drawings())
def test_a_line_that_is_drawn_is_followed_to_its_end(points: Array) -> None:
    ride = Ride("tsd")
    _, step = ride.follow(NavigationGoal(points))
    assert step.phase is ExecutionPhase.ARRIVED, step.reason
    ride.rest()
    way = np.array(ride.way)[:, :2]
    assert np.hypot(*(ride.seen.xy_heading[:2] - points[-1])) < TIMEOUT_TOLERANCE_M
    nearest = [np.hypot(*(way - point).T).min() for point in points]
    assert max(nearest) < ASIDE_M


@pytest.mark.parametrize("delay_s", [0.1, 0.3])
def test_late_poses_and_commands_neither_swing_nor_overshoot(delay_s: float) -> None:
    """A loop tuned without delay would oscillate at 0.3 s; beyond the goal is overshoot."""
    ride = Ride("tsd", delay_s)
    _, step = ride.follow(NavigationGoal(np.array([[1.5, 0.0]])))
    assert step.phase is ExecutionPhase.ARRIVED, step.reason
    ride.rest()
    way = np.array(ride.way)
    assert way[:, 0].max() < 1.5 + 0.01
    assert np.abs(way[:, 1]).max() < 0.05


def test_a_turn_in_place_turns_in_place() -> None:
    ride = Ride("tsd")
    _, step = ride.follow(NavigationGoal(np.zeros((1, 2)), 2.0))
    assert step.phase is ExecutionPhase.ARRIVED, step.reason
    ride.rest()
    assert ride.seen.xy_heading[2] == pytest.approx(2.0, abs=FAIR_RAD)
    assert np.abs(np.array(ride.way)[:, :2]).max() < 0.03


@settings(max_examples=5)
@given(points=drawings(), periods=st.integers(20, 150))
def test_what_is_left_of_an_errand_leads_on_to_its_end(points: Array, periods: int) -> None:
    """Release at any time; the remaining path then starts at the robot's pose at rest."""
    navigation_goal = NavigationGoal(points)
    ride = Ride("tsd")
    follower, step = ride.follow(navigation_goal, periods=periods)
    ride.rest()
    if step.phase is ExecutionPhase.ARRIVED:
        return
    whole_m = follower.trajectory.length_m
    left = navigation_goal.remaining(follower.trajectory.route.path, step.done_m)
    if left.is_done(ride.seen):  # Released within the tolerance of the goal.
        assert np.hypot(*(ride.seen.xy_heading[:2] - points[-1])) < TIMEOUT_TOLERANCE_M
        return
    # The remaining path does not start over, and the robot rolled little while braking.
    assert left.route(ride.seen).length_m < whole_m - step.done_m + 0.2
    _, step = ride.follow(left)
    assert step.phase is ExecutionPhase.ARRIVED, step.reason
    assert np.hypot(*(ride.seen.xy_heading[:2] - points[-1])) < TIMEOUT_TOLERANCE_M
    way = np.array(ride.way)[:, :2]
    nearest = [np.hypot(*(way - point).T).min() for point in points]
    assert max(nearest) < ASIDE_M


def test_a_robot_that_is_held_gets_no_more_than_a_pull_and_then_none() -> None:
    """Its wheels turn on ice, so the reference waits and gives up after a while."""
    robot = robots.load_robot("tsd")
    follower = follower_of(robot, NavigationGoal(np.array([[5.0, 0.0]])), SE2.identity())
    steps = [follower.advance(i * 0.02, SE2.identity()) for i in range(500)]
    assert steps[-1].phase is ExecutionPhase.LOST
    assert not steps[-1].twist.any()
    going = [step for step in steps if step.phase is ExecutionPhase.GOING]
    assert len(going) * 0.02 < 2.0 * STUCK_S
    assert max(step.cross_track_m for step in going) < MAX_TRACKING_ERROR_M


@pytest.mark.parametrize("moved", [(0.4, 0.0, 0.0), (0.0, -0.4, 0.0), (0.0, 0.0, 1.0)])
def test_a_pose_that_jumps_ends_it(moved: tuple[float, float, float]) -> None:
    follower = follower_of(
        robots.load_robot("tsd"), NavigationGoal(np.array([[2.0, 0.0]])), SE2.identity()
    )
    assert follower.advance(0.0, SE2.identity()).phase is ExecutionPhase.GOING
    step = follower.advance(0.02, SE2(np.array(moved)))
    assert step.phase is ExecutionPhase.LOST
    assert not step.twist.any()


class Storm(RuleBasedStateMachine):
    """A ride with any sequence of disturbances, in which the robot never jumps."""

    def __init__(self) -> None:
        super().__init__()
        self.ride = Ride("tsd")
        self.share = 1.0
        self.lie = np.zeros(3)
        self.now_s = 0.0
        robot = self.ride.robot
        self.limits = robot.limits
        self.limiter = TwistLimiter(robot.kinematics(), self.limits)
        navigation_goal = NavigationGoal(np.array([[0.5, 0.1], [0.8, 0.6], [1.5, 0.3]]), 1.0)
        way = plan(
            navigation_goal.route(self.ride.seen), robot.kinematics(), self.limits, cell_m=0.02
        )
        self.follower = TrajectoryExecutor(way, self.cap, lag_s=robot.lag_s)
        self.phase = ExecutionPhase.GOING

    def cap(self, twist: Array) -> Array:
        return self.limiter.cap(twist, self.share)

    def say(self) -> Array:
        """Process a hold message of the page; check and return the resulting twist."""
        step = self.follower.advance(self.now_s, SE2(self.ride.seen.xy_heading + self.lie))
        if (
            self.phase is not ExecutionPhase.GOING
        ):  # The path is over, and further hold messages are answered.
            assert np.isfinite(step.twist).all()
            return np.zeros(3)
        self.phase = step.phase
        assert step.phase is ExecutionPhase.GOING or not step.twist.any()
        assert np.isfinite(step.twist).all()
        assert np.hypot(*step.twist[:2]) <= self.share * self.limits.speed_mps + 1e-9
        assert abs(step.twist[2]) <= self.share * self.limits.turn_rate_rad_per_s + 1e-9
        return step.twist

    def drive(self, twist: Array, periods: int) -> None:
        for _ in range(periods):
            before = self.ride.virtual.controller.twist.copy()
            self.ride.drive(twist)
            self.now_s += PERIOD_S
            change = self.ride.virtual.controller.twist - before
            most = max(self.limits.acceleration_mps2, self.limits.deceleration_mps2)
            assert np.hypot(*change[:2]) <= most * PERIOD_S * (1 + 1e-9)

    @rule(times=st.integers(1, 30), late=st.sampled_from([1, 2, 2, 2, 5, 15]))
    def hold(self, times: int, late: int) -> None:
        for _ in range(times):
            self.drive(self.say(), late)

    @rule(times=st.integers(2, 10))
    def say_it_again_at_once(self, times: int) -> None:
        for _ in range(times):
            self.drive(self.say(), 0)

    @rule(periods=st.integers(1, 40))
    def let_go(self, periods: int) -> None:
        """Release and hold again without a new path, which no page does; the motion resumes."""
        self.drive(np.zeros(3), periods)

    @rule(level=st.sampled_from([0.01, 0.2, 0.5, 1.0]))
    def choose_a_level(self, level: float) -> None:
        self.share = level

    @rule(x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), turn=st.floats(-1.0, 1.0))
    def be_seen_elsewhere(self, x: float, y: float, turn: float) -> None:
        self.lie = np.array([x, y, turn])

    @rule(jump_s=st.floats(-1e6, 1e6))
    def set_the_clock(self, jump_s: float) -> None:
        self.now_s += jump_s

    def teardown(self) -> None:
        self.ride.rest()
        assert np.abs(self.ride.virtual.true_twist).max() < 0.01


def test_whatever_comes_between_the_robot_neither_leaps_nor_gets_faster_than_was_chosen() -> None:
    run_state_machine_as_test(Storm, settings=settings(max_examples=8, stateful_step_count=20))


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_pose_that_is_no_number_ends_it(broken: float) -> None:
    follower = follower_of(
        robots.load_robot("tsd"), NavigationGoal(np.array([[2.0, 0.0]])), SE2.identity()
    )
    step = follower.advance(0.0, SE2(np.array([0.0, broken, 0.0])))
    assert step.phase is ExecutionPhase.LOST
    assert not step.twist.any()


@settings(max_examples=20)
@given(delays_s=st.lists(st.floats() | st.none(), min_size=1, max_size=20))
def test_whatever_delay_is_measured_a_twist_is_finite_and_within_the_limits(
    delays_s: list[float | None],
) -> None:
    """The delay comes from the network: not a number, negative, an hour."""
    robot = robots.load_robot("tsd")
    follower = follower_of(robot, NavigationGoal(np.array([[2.0, 1.0]]), 1.0), SE2.identity())
    for i, delay_s in enumerate(delays_s):
        step = follower.advance(0.02 * i, SE2.identity(), delay_s)
        assert np.isfinite(step.twist).all()
        assert np.hypot(*step.twist[:2]) <= 0.8 * robot.limits.speed_mps + 1e-9


@settings(max_examples=50)
@given(
    at_s=st.lists(st.floats(0.0, 1e6), min_size=2, max_size=20),
    off=st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3),
)
def test_whenever_it_is_called_a_twist_is_finite_and_within_the_limits(
    at_s: list[float], off: list[float]
) -> None:
    """Also with a clock that jumps or runs backwards."""
    robot = robots.load_robot("tsd")
    follower = follower_of(robot, NavigationGoal(np.array([[2.0, 1.0]]), 1.0), SE2.identity())
    for now_s in at_s:
        step = follower.advance(now_s, SE2(np.array(off)))
        assert np.isfinite(step.twist).all()
        assert np.hypot(*step.twist[:2]) <= 0.8 * robot.limits.speed_mps + 1e-9


@pytest.mark.parametrize(
    ("navigation_goal", "code"),
    [
        (NavigationGoal(np.array([[0.001, 0.0]])), Code.ALREADY_THERE),
        (NavigationGoal(np.array([[0.001, 0.0]]), 0.001), Code.ALREADY_THERE),
        (NavigationGoal(np.array([[LONGEST_M + 1.0, 0.0]])), Code.PATH_TOO_LONG),
        (NavigationGoal(np.array([[1.0, np.nan]])), Code.PATH_TOO_LONG),
        (NavigationGoal(np.array([[1.0, 0.0], [1.0, 1e300]])), Code.PATH_TOO_LONG),
    ],
)
def test_errands_that_lead_nowhere_are_refused(navigation_goal: NavigationGoal, code: Code) -> None:
    with pytest.raises(PathError) as refused:
        navigation_goal.route(SE2.identity())
    assert refused.value.why is not None
    assert refused.value.why.code == code


@settings(max_examples=20)
@given(points=drawings(), jump=places)
def test_a_smooth_line_begins_where_the_robot_is_ends_where_it_was_drawn_and_stays_near(
    points: Array, jump: tuple[float, float]
) -> None:
    start = SE2(np.array([*jump, 0.3]))
    path = NavigationGoal(points).route(start).path
    ends = path.at(np.array([0.0, path.length_m])).xy
    np.testing.assert_allclose(ends, [jump, points[-1]], atol=1e-4)
    drawn = np.concatenate([[jump], points])
    along = np.linspace(0.0, 1.0, 50)[:, None, None]
    legs = (drawn[:-1] + along * (drawn[1:] - drawn[:-1])).reshape(-1, 2)
    smooth = path.at(np.linspace(0.0, path.length_m, 400)).xy
    apart = np.sqrt(((smooth[:, None] - legs) ** 2).sum(-1))
    assert apart.min(axis=1).max() < ASIDE_M
    assert apart.min(axis=0).max() < ASIDE_M
