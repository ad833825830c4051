"""Paths around discs, compared with geometry that knows no graph."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from tsd_twin import robots
from tsd_twin.client.motions import PlanLimits, plan
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.motion.obstacles import Disc, detour, first_entered
from tsd_twin.motion.routes import NavigationGoal, check_free

START, GOAL = np.zeros(2), np.array([4.0, 0.0])
discs = st.lists(
    st.builds(
        Disc,
        st.sampled_from("abc"),
        st.tuples(st.floats(0.8, 3.2), st.floats(-1.0, 1.0)),
        st.floats(0.05, 0.6),
    ),
    max_size=6,
)


def sampled(corners: Array) -> Array:
    """Return points (n, 2) on the path from the start over corners, 5 mm apart or less."""
    whole = np.concatenate([START[None], corners])
    legs = itertools.pairwise(whole)
    points: list[Array] = [
        np.linspace(a, b, max(2, math.ceil(math.dist(a, b) / 0.005))) for a, b in legs
    ]
    return np.concatenate(points)


def length_m(corners: Array) -> float:
    return float(np.hypot(*np.diff(np.concatenate([START[None], corners]), axis=0).T).sum())


def gap_m(points: Array, around: Sequence[Disc]) -> float:
    """Return the smallest distance of points from discs."""
    if not around:
        return math.inf
    distances = cdist(points, np.array([disc.xy for disc in around]))
    return float((distances - [disc.radius_m for disc in around]).min())


@given(discs)
def test_a_detour_ends_at_the_goal_and_enters_no_disc(around: list[Disc]) -> None:
    corners = detour(START, GOAL, around)
    assert corners[-1] == pytest.approx(GOAL)
    assert gap_m(sampled(corners), around) > -1e-6
    smaller = [Disc(disc.robot, disc.xy, disc.radius_m - 1e-6) for disc in around]
    assert first_entered(np.concatenate([START[None], corners]), smaller) is None


aside = st.tuples(
    st.floats(-1.0, 5.0), st.sampled_from([-1.0, 1.0]), st.floats(0.05, 0.6), st.floats(0.01, 1.0)
)


@given(st.lists(aside, max_size=6))
def test_without_a_disc_on_the_straight_line_the_path_is_that_line(
    places: list[tuple[float, float, float, float]],
) -> None:
    around = [
        Disc("a", (x, side * (radius_m + gap)), radius_m) for x, side, radius_m, gap in places
    ]
    assert detour(START, GOAL, around) == pytest.approx(GOAL[None])


@given(st.floats(0.8, 3.2), st.floats(-0.3, 0.3), st.floats(0.35, 0.6))
def test_around_one_disc_it_is_at_most_1_percent_longer_than_two_tangents_and_an_arc(
    x: float, y: float, radius_m: float
) -> None:
    def tangent(point: Array) -> tuple[float, float]:
        away = math.dist(point, (x, y))
        return math.sqrt(away**2 - radius_m**2), math.acos(radius_m / away)

    (first_m, first_rad), (second_m, second_rad) = tangent(START), tangent(GOAL)
    between = math.atan2(-y, -x) - math.atan2(GOAL[1] - y, GOAL[0] - x)
    angle = min(abs(between) % math.tau, -abs(between) % math.tau)
    shortest_m = first_m + second_m + radius_m * max(0.0, angle - first_rad - second_rad)
    found_m = length_m(detour(START, GOAL, [Disc("a", (x, y), radius_m)]))
    assert shortest_m - 1e-9 <= found_m <= 1.01 * shortest_m


def test_a_goal_in_a_disc_and_a_ring_of_discs_are_refused_by_name() -> None:
    with pytest.raises(PathError) as refused:
        detour(START, GOAL, [Disc("kiwi", (4.1, 0.0), 0.2)])
    assert refused.value.why == because(Code.PATH_BLOCKED, robot="kiwi")
    angles = np.arange(8) * math.pi / 4.0
    ring = [Disc("tsd", (math.cos(angle), math.sin(angle)), 0.5) for angle in angles]
    with pytest.raises(PathError) as refused:
        detour(START, GOAL, ring)
    assert refused.value.why == because(Code.PATH_BLOCKED, robot="tsd")


@given(st.floats(0.0, math.tau))
def test_a_robot_that_stands_in_a_disc_can_leave_it(angle: float) -> None:
    disc = Disc("a", (0.3 * math.cos(angle), 0.3 * math.sin(angle)), 0.4)
    corners = detour(START, GOAL, [disc])
    assert gap_m(sampled(corners), [Disc("a", disc.xy, 0.299)]) > 0.0


@pytest.mark.parametrize("name", ["tsd", "omni4", "kiwi", "mecanum"])
def test_every_robot_plans_a_smooth_path_around_and_never_through(name: str) -> None:
    robot = robots.load_robot(name)
    limits = PlanLimits.in_force(robot, robot.kinematics(), None)
    around = [Disc("a", (1.5, 0.1), 0.5), Disc("b", (2.5, -0.4), 0.4)]
    trajectory = plan(NavigationGoal(GOAL[None]), SE2(np.zeros(3)), limits, around)
    path = trajectory.route.path
    at_m = np.linspace(0.0, path.length_m, 1000)
    assert gap_m(path.at(at_m).xy, around) >= -1e-6
    assert path.corners_m == ()
    assert path.length_m < 1.15 * 4.0
    drawn = NavigationGoal(np.array([[1.0, 0.0], [2.0, 0.0], [4.0, 0.0]]))
    with pytest.raises(PathError) as refused:
        plan(drawn, SE2(np.zeros(3)), limits, around)
    assert refused.value.why == because(Code.PATH_BLOCKED, robot="a")


def test_only_the_part_of_a_path_that_is_asked_about_has_to_be_free() -> None:
    path = NavigationGoal(GOAL[None]).route(SE2(np.zeros(3))).path
    disc = Disc("a", (2.0, 0.2), 0.4)
    check_free(path, [disc], 0.0, 1.5)
    check_free(path, [disc], 2.5)
    with pytest.raises(PathError):
        check_free(path, [disc], 0.0, 1.8)


@given(st.floats(-math.pi, math.pi), st.floats(0.1, 0.35))
def test_a_path_in_a_disc_is_free_only_if_it_leads_out(angle: float, apart_m: float) -> None:
    """The other robot is so close that its disc contains this one."""
    path = NavigationGoal(GOAL[None]).route(SE2(np.zeros(3))).path
    disc = Disc("a", (apart_m * math.cos(angle), apart_m * math.sin(angle)), 0.4)
    nearest_m = apart_m * abs(math.sin(angle)) if math.cos(angle) > 0.0 else apart_m
    if nearest_m >= apart_m - 0.029:
        check_free(path, [disc])
    elif nearest_m < apart_m - 0.031:
        with pytest.raises(PathError):
            check_free(path, [disc])
