"""Time-optimal profiles: closed forms, a linear program, dense sampling, random competitors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse import coo_array

from tests.motion.random_paths import SQUARE, by_hand, waypoints
from tsd_twin import robots
from tsd_twin.errors import PathError
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array, wrap
from tsd_twin.motion.paths import CompositePath, arc, line, parabola, polyline
from tsd_twin.motion.routes import FixedHeading, Route, SampledHeading, TangentHeading
from tsd_twin.motion.trajectory import SpeedProfile, Trajectory, plan
from tsd_twin.robots.description import Limits

ROBOT = robots.load_robot("tsd")
DRIVE, LIMITS = ROBOT.kinematics(), ROBOT.limits
PATHS = by_hand()
H_S = 1e-4
GIVE = 1.01
"""Relative tolerance of the limits between cell ends."""


def routes() -> dict[str, Route]:
    made = {f"{name}, fixed": Route(path, FixedHeading(0.3)) for name, path in PATHS.items()}
    smooth = {name: path for name, path in PATHS.items() if not path.corners_m}
    del smooth["arc"], smooth["parabola"], smooth["closed"]  # Nothing that the others have not.
    made |= {f"{name}, tangent": Route(path, TangentHeading()) for name, path in smooth.items()}
    for name in ("line", "rounded", "spline", "chain"):
        path = PATHS[name]
        turning = SampledHeading([0.0, 0.5 * path.length_m, path.length_m], [0.0, 2.0, -1.0])
        made[f"{name}, turning"] = Route(path, turning)
    return made


ROUTES = routes()
each = pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES.keys())


# Usage of the limits, computed from poses alone.


def usage(trajectory: Trajectory, drive: SingularityKinematics, limits: Limits) -> dict[str, Array]:
    """Fraction of each limit at many times, by differences of poses and gimbal angles."""
    t = np.linspace(0.0, trajectory.duration_s, 3001)[1:-1]
    # Corners and curvature jumps are passed at rest or instantly, so exclude them.
    breaks = np.array([0.0, *trajectory.route.breaks_m, trajectory.length_m])
    t = t[np.abs(trajectory.at(t).s_m[:, None] - breaks).min(axis=1) > 1e-3]
    pose = trajectory.at(t + np.array([[-H_S], [0.0], [H_S]])).pose
    velocity = np.diff(pose, axis=0) / H_S
    acceleration = np.diff(velocity, axis=0)[0] / H_S
    heading = 0.5 * (pose[1:, :, 2] + pose[:-1, :, 2])
    c, s = np.cos(heading), np.sin(heading)
    body = np.stack(
        [
            c * velocity[..., 0] + s * velocity[..., 1],
            c * velocity[..., 1] - s * velocity[..., 0],
            velocity[..., 2],
        ],
        axis=-1,
    )
    joints = drive.inverse(body)
    rates = np.delete(np.diff(joints, axis=0)[0] / H_S, [2, 5, 8], axis=-1)
    change = np.diff(body, axis=0)[0] / H_S
    speeds = np.hypot(velocity[..., 0], velocity[..., 1])
    slower = speeds[1] < speeds[0]
    linear = np.where(slower, limits.deceleration_mps2, limits.acceleration_mps2)

    def across(of: Array, along: Array) -> Array:
        return np.abs(of[:, 0] * along[:, 1] - of[:, 1] * along[:, 0]) / speeds[1]

    return {
        "speed": speeds[1] / limits.speed_mps,
        "turn rate": np.abs(body[1, :, 2]) / limits.turn_rate_rad_per_s,
        "acceleration": np.hypot(acceleration[:, 0], acceleration[:, 1]) / linear,
        "change in the body": np.hypot(change[:, 0], change[:, 1]) / linear,
        "across": across(acceleration, velocity[1]) / limits.acceleration_mps2,
        "across in the body": across(change, body[1]) / limits.acceleration_mps2,
        "angular": np.abs(acceleration[:, 2]) / limits.angular_acceleration_rad_per_s2,
        "tilt": np.sin(drive.tilt(joints[1])).max(axis=-1) / np.sin(drive.max_tilt_rad),
        "tilt rate": np.abs(rates).max(axis=-1) / drive.max_tilt_rate_rad_per_s,
    }


@each
def test_no_limit_is_exceeded_and_one_is_always_used(route: Route) -> None:
    used = usage(plan(route, DRIVE, LIMITS), DRIVE, LIMITS)
    for name, values in used.items():
        assert values.max() <= GIVE, name
    most = np.maximum.reduce(list(used.values()))
    assert np.quantile(most, 0.03) > 0.98, "time is lost"


@pytest.mark.parametrize("name", ["rounded", "spline", "chain"])
def test_slow_gimbals_and_small_tilts_are_what_limits_then(name: str) -> None:
    drive = dataclasses.replace(DRIVE, max_tilt_rate_rad_per_s=0.15, max_tilt_rad=0.06)
    trajectory = plan(Route(PATHS[name]), drive, LIMITS)
    used = usage(trajectory, drive, LIMITS)
    assert max(values.max() for values in used.values()) <= GIVE
    assert used["tilt"].max() > 0.99
    assert used["tilt rate"].max() > 0.95
    assert used["acceleration"].max() < 0.6
    assert trajectory.duration_s > plan(Route(PATHS[name]), DRIVE, LIMITS).duration_s


# Closed forms.


@given(
    length=st.floats(0.02, 1.0),
    speed=st.floats(0.1, 1.0),
    up=st.floats(0.5, 10.0),
    down=st.floats(0.5, 10.0),
)
@settings(max_examples=12)
def test_a_line_takes_as_long_as_its_triangle_or_trapezoid(
    length: float, speed: float, up: float, down: float
) -> None:
    limits = Limits(speed, 3.0, up, down, 20.0)
    trajectory = plan(Route(line([1.0, 2.0], [1.0, 2.0 + length])), DRIVE, limits)
    to_top = 0.5 * speed**2 * (1 / up + 1 / down)
    if to_top <= length:
        shortest = speed / up + speed / down + (length - to_top) / speed
    else:
        shortest = np.sqrt(2 * length * (1 / up + 1 / down))
    assert shortest * (1 - 1e-9) <= trajectory.duration_s <= shortest * 1.006
    np.testing.assert_allclose(
        trajectory.at(np.array([-1.0, 0.0, trajectory.duration_s, 99.0])).pose[:, :2],
        [[1, 2], [1, 2], [1, 2 + length], [1, 2 + length]],
        atol=1e-9,
    )
    assert not trajectory.at(np.array([-1.0, 99.0])).twist.any()
    assert not trajectory.at(np.array([-1.0, 99.0])).twist_rate.any()


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.2])
def test_a_long_circle_is_driven_at_the_speed_its_acceleration_allows(radius: float) -> None:
    route = Route(arc([0, 0], 0.0, radius, 12.0))
    trajectory = plan(route, DRIVE, LIMITS)
    middle = trajectory.at(0.5 * trajectory.duration_s).twist
    fastest = np.sqrt(LIMITS.acceleration_mps2 * radius)
    assert np.hypot(*middle[:2]) == pytest.approx(min(1.0, fastest), rel=1e-3)


def test_with_the_tangent_as_heading_a_tight_circle_is_driven_at_the_turn_rate() -> None:
    trajectory = plan(Route(arc([0, 0], 0.0, 0.2, -12.0), TangentHeading()), DRIVE, LIMITS)
    middle = trajectory.at(0.5 * trajectory.duration_s).twist
    np.testing.assert_allclose(middle, [0.6, 0.0, -3.0], atol=1e-9)


def test_the_square_is_four_lines_with_a_stop_after_each() -> None:
    whole, side = (plan(Route(p), DRIVE, LIMITS) for p in (polyline(SQUARE), line([0, 0], [1, 0])))
    assert whole.duration_s == pytest.approx(4 * side.duration_s, rel=1e-9)
    for i in range(5):
        corner = whole.at(i * side.duration_s)
        np.testing.assert_allclose(corner.pose[:2], SQUARE[i], atol=1e-9)
        assert np.hypot(*corner.twist[:2]) < 1e-4
    rounded = plan(Route(polyline(SQUARE, 0.2)), DRIVE, LIMITS)
    assert rounded.duration_s < whole.duration_s - 0.6


def test_a_jump_of_the_curvature_is_a_stop_for_a_tangent_heading_only() -> None:
    path = CompositePath([line([0, 0], [1, 0]), arc([1, 0], 0.0, 0.5, 2.0)])
    assert Route(path).stops_m == ()
    assert Route(path, TangentHeading()).stops_m == (1.0,)
    with pytest.raises(PathError, match=r"sharp corner at 1\.000 m"):
        plan(Route(polyline(SQUARE), TangentHeading()), DRIVE, LIMITS)


@pytest.mark.parametrize("share", [0.0, -1.0, 1.1, np.nan])
def test_a_share_beyond_all_or_nothing_is_refused(share: float) -> None:
    with pytest.raises(PathError, match="share"):
        plan(Route(line([0, 0], [1, 0])), DRIVE, LIMITS, share=share)


def test_a_share_of_the_limits_is_as_if_they_were_lower() -> None:
    route = Route(polyline(SQUARE, 0.1))
    half = dataclasses.replace(DRIVE, max_tilt_rate_rad_per_s=DRIVE.max_tilt_rate_rad_per_s / 2)
    lower = Limits(1.0, 3.0, 2.0, 3.0, 10.0)
    some, other = plan(route, DRIVE, LIMITS, share=0.5), plan(route, half, lower)
    assert some.duration_s == pytest.approx(other.duration_s, rel=1e-6)
    slow = plan(route, DRIVE, LIMITS, speed_mps=0.3)
    assert np.hypot(*slow.at(np.linspace(0, slow.duration_s, 500)).twist[:, :2].T).max() <= 0.3001


# No faster profile exists.


def by_linear_program(route: Route, limits: Limits, cells: int) -> tuple[Array, Array]:
    """Largest squared speeds at each end, with acceleration circles replaced by 64-gons."""
    s = np.linspace(0.0, route.length_m, cells + 1)
    ds = s[1]
    angles = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    rows, columns, values, bounds = [], [], [], []
    for i in range(cells):
        for end, at in ((0, s[i] + 1e-9), (1, s[i + 1] - 1e-9)):
            nudge = 1e-6
            heading = [float(route.at(np.array(at + d)).pose[2]) for d in (-nudge, 0.0, nudge)]
            turn = (heading[2] - heading[0]) / (2 * nudge)
            curvature = float(route.at(np.array(at)).curvature)
            # Over the ground (a, k u); in the body's axes, which turn, (a, (k - turn) u).
            for bend in (curvature, curvature - turn):
                for angle in angles:
                    # a = (u[i + 1] - u[i]) / (2 ds), u at this end.
                    row = np.zeros(2)
                    row += np.cos(angle) * np.array([-0.5, 0.5]) / ds
                    row[end] += np.sin(angle) * bend
                    rows += [len(bounds)] * 2
                    columns += [i, i + 1]
                    values += row.tolist()
                    bounds.append(limits.acceleration_mps2)
    matrix = coo_array((values, (rows, columns)), shape=(len(bounds), cells + 1))
    top = [(0.0, 0.0), *[(0.0, limits.speed_mps**2)] * (cells - 1), (0.0, 0.0)]
    found = linprog(-np.ones(cells + 1), A_ub=matrix.tocsr(), b_ub=bounds, bounds=top)
    assert found.status == 0
    return s, found.x


@pytest.mark.parametrize(
    "route",
    [
        Route(parabola(3.0, 0.0, 0.0, -0.5, 0.6)),
        Route(PATHS["spline"]),
        Route(line([0, 0], [2, 0]), SampledHeading([0, 1, 2], [0, 1.2, 0])),
    ],
    ids=["parabola", "spline", "turning"],
)
def test_a_linear_program_finds_the_same_profile(route: Route) -> None:
    """With equal limits for acceleration and braking, the problem is nearly linear."""
    limits = Limits(2.0, 100.0, 4.0, 4.0, 1e4)
    s, squared = by_linear_program(route, limits, cells=120)
    trajectory = plan(route, DRIVE, limits, cell_m=float(s[1]) / 4)
    speed = np.interp(s, trajectory.profile.s_m, trajectory.profile.speed_mps)
    np.testing.assert_allclose(speed[1:-1], np.sqrt(squared[1:-1]), rtol=0.02)


@given(
    points=waypoints(),
    cut=st.floats(0.05, 0.3),
    turn=st.floats(-2.0, 2.0),
    at=st.floats(0.05, 0.95),
    width=st.floats(0.02, 0.2),
)
@settings(max_examples=10)
def test_whoever_is_faster_anywhere_breaks_a_limit(
    points: Array, cut: float, turn: float, at: float, width: float
) -> None:
    path = polyline(points, cut)
    route = Route(path, SampledHeading([0.0, path.length_m], [0.0, turn]))
    best = plan(route, DRIVE, LIMITS)
    profile = best.profile
    bump = 1.0 + 0.05 * np.exp(-(((profile.s_m / path.length_m - at) / width) ** 2))
    speed = profile.speed_mps * bump
    ds = np.diff(profile.s_m)
    times = np.concatenate([[0.0], np.cumsum(2 * ds / (speed[1:] + speed[:-1]))])
    faster = Trajectory(
        route, SpeedProfile(profile.s_m, speed, np.diff(speed**2) / (2 * ds), times)
    )
    assert faster.duration_s < best.duration_s
    assert max(values.max() for values in usage(best, DRIVE, LIMITS).values()) <= GIVE
    assert max(values.max() for values in usage(faster, DRIVE, LIMITS).values()) > 1.025


@each
def test_twists_are_the_slopes_of_the_poses_and_rates_those_of_the_twists(route: Route) -> None:
    trajectory = plan(route, DRIVE, LIMITS)
    profile = trajectory.profile
    # Within cells, away from their ends, all quantities are smooth.
    t = 0.5 * (profile.at_s[1:] + profile.at_s[:-1])
    h = 0.01 * np.diff(profile.at_s)
    before, here, after = (trajectory.at(t + d) for d in (-h, 0.0 * h, h))
    slope = (after.pose - before.pose) / (2 * h)[:, None]
    c, s = np.cos(here.pose[:, 2]), np.sin(here.pose[:, 2])
    vx, vy = c * slope[:, 0] + s * slope[:, 1], c * slope[:, 1] - s * slope[:, 0]
    np.testing.assert_allclose(here.twist, np.stack([vx, vy, slope[:, 2]], -1), atol=1e-5)
    rates = (after.twist - before.twist) / (2 * h)[:, None]
    np.testing.assert_allclose(here.twist_rate, rates, rtol=1e-3, atol=2e-2)
    way = np.arctan2(slope[:, 1], slope[:, 0])
    np.testing.assert_allclose(wrap(here.direction - way), 0.0, atol=1e-5)
