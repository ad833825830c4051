"""From joints to twists in the Student tab, against independent rigid bodies that roll."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.dashboard.sessions.student_answer import answer
from tests.support.link_sockets import eventually
from tests.support.page_client import site
from tests.support.scene_doubles import EmptyScene
from tsd_twin.dashboard.scene.client_nodes import StudentPose
from tsd_twin.dashboard.sessions import student
from tsd_twin.dashboard.sessions.student_equations import math_tokens
from tsd_twin.dashboard.wire.from_page import StudentRequest
from tsd_twin.dashboard.wire.student import MathToken, StudentFigures
from tsd_twin.dashboard.wire.to_page import encode_message
from tsd_twin.lie import Array
from tsd_twin.robots import load_robot, robot_names

calm = settings(max_examples=15)
RPM = math.pi / 30.0
UP = np.array([0.0, 0.0, 1.0])


def solved(base: str, joints: Sequence[Sequence[float]]) -> StudentFigures:
    rows = [list(one) for one in joints]
    reply = answer(StudentRequest(number=1, base=base, knobs={}, joints=rows))
    assert reply.figures is not None, reply.problem
    return reply.figures


def turned(angle_rad: float, axis: int) -> Array:
    """Rotation matrix about X, Y or Z."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[j, i], matrix[i, j] = s, -s
    return matrix


def rolling_module(azimuth_deg: float, joints: Sequence[float]) -> Array:
    """Velocity (2,) of a sphere that rolls about its tilted axle, along the robot's axes."""
    alpha, beta = np.radians(joints[:2])
    axle = turned(beta, 1) @ turned(-alpha, 0) @ UP
    velocity = np.cross(0.04 * joints[2] * RPM * axle, UP)
    return (turned(math.radians(azimuth_deg) - math.pi / 2.0, 2) @ velocity)[:2]


def best_twist(at_m: Array, towards: Array, speeds_mps: Array) -> tuple[Array, Array]:
    """Least-squares twist of a rigid body whose points (n, 2) move at speeds along unit vectors."""
    turning = np.stack([-at_m[:, 1], at_m[:, 0]], axis=-1)
    rows = np.column_stack([towards, np.sum(turning * towards, axis=-1)])
    twist = np.linalg.lstsq(rows, speeds_mps)[0]
    return twist, speeds_mps - rows @ twist


gimbals = st.tuples(st.floats(-25.0, 25.0), st.floats(-25.0, 25.0), st.floats(2000.0, 12000.0))


@calm
@given(joints=st.tuples(gimbals, gimbals, gimbals))
def test_gimbals_move_the_body_that_fits_their_rolling_best(joints: Any) -> None:
    azimuths_deg = np.array([90.0, 210.0, 330.0])
    angles = np.radians(azimuths_deg)
    at_m = 0.15 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    velocities = np.array(
        [rolling_module(*each) for each in zip(azimuths_deg, joints, strict=True)]
    )
    along = np.tile(np.eye(2), (3, 1))
    twist, left = best_twist(np.repeat(at_m, 2, axis=0), along, velocities.ravel())
    found = solved("tsd", joints)
    assert found.twist == pytest.approx(twist, rel=1e-4, abs=1e-4)
    assert found.residual_mps == pytest.approx(math.sqrt(np.mean(left**2)), rel=1e-4, abs=1e-6)
    assert found.redundancy == 3
    for wheel, velocity in zip(found.wheels, velocities, strict=True):
        assert wheel.push == pytest.approx(velocity, rel=1e-4, abs=1e-5)
    # The cosine of the tilt is cos(a) cos(b); its arccosine would be inexact for small tilts.
    sines = [
        math.hypot(math.sin(math.radians(a)), math.cos(math.radians(a)) * math.sin(math.radians(b)))
        for a, b, _ in joints
    ]
    assert found.utilization == pytest.approx(max(sines) / 0.5, rel=1e-4)


@pytest.mark.parametrize(("base", "redundancy"), [("kiwi", 0), ("omni4", 1), ("mecanum", 1)])
@calm
@given(data=st.data())
def test_rollers_move_the_body_that_fits_their_grip_best(
    base: str, redundancy: int, data: st.DataObject
) -> None:
    """A roller grips along its axle, with the cosine of its angle to the rim velocity."""
    drive: Any = load_robot(base).drive  # pyright: ignore[reportAttributeAccessIssue]
    rpm = [[data.draw(st.floats(-300.0, 300.0))] for _ in drive.wheels]
    at_m = np.array([[wheel.x_m, wheel.y_m] for wheel in drive.wheels])
    axles = np.radians([wheel.direction_deg + wheel.roller_deg for wheel in drive.wheels])
    towards = np.stack([np.cos(axles), np.sin(axles)], axis=-1)
    cosine = np.cos(np.radians([wheel.roller_deg for wheel in drive.wheels]))
    speeds = drive.wheel_radius_m * RPM * np.array(rpm)[:, 0]
    twist, left = best_twist(at_m, towards, cosine * speeds)
    found = solved(base, rpm)
    assert found.twist == pytest.approx(twist, rel=1e-4, abs=1e-5)
    assert found.redundancy == redundancy
    rest = math.sqrt(np.mean((left / cosine) ** 2))
    assert found.residual_mps == pytest.approx(rest, rel=1e-4, abs=1e-6)
    if redundancy == 0:
        assert found.residual_mps < 1e-9


@calm
@given(twist=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_wheels_turn_the_sphere_whose_surface_moves_with_them(
    twist: tuple[float, float, float],
) -> None:
    drive: Any = load_robot("atlas").drive  # pyright: ignore[reportAttributeAccessIssue]
    rpm: list[list[float]] = []
    for wheel in drive.wheels:
        place = turned(math.radians(wheel.azimuth_deg), 2) @ turned(
            math.radians(wheel.below_equator_deg), 1
        )
        contact = drive.sphere_radius_m * place[:, 0]
        push = turned(math.radians(wheel.turn_deg), 0)[:, 1]
        surface_mps = np.cross(twist, contact) @ place @ push
        rpm.append([float(surface_mps) / drive.wheel_radius_m / RPM])
    found = solved("atlas", rpm)
    assert found.twist == pytest.approx(twist, rel=1e-4, abs=1e-5)
    assert found.centre is None
    rate = math.hypot(*twist)
    if rate > 1e-3:
        assert found.axis is not None
        assert np.array(found.axis) * rate == pytest.approx(np.array(twist), abs=1e-3)


@pytest.mark.parametrize("base", robot_names())
@calm
@given(twist=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_joints_of_a_twist_give_the_twist_back(
    base: str, twist: tuple[float, float, float]
) -> None:
    reply = answer(StudentRequest(number=1, base=base, knobs={}, twist=twist))
    assert reply.figures is not None
    assert reply.figures.residual_mps < 1e-9
    joints = [
        [wheel.rpm] if wheel.gimbal is None else [*wheel.gimbal[:2], wheel.rpm]
        for wheel in reply.figures.wheels
    ]
    back = solved(base, joints)
    assert back.twist == pytest.approx(reply.figures.twist, rel=1e-4, abs=1e-4)
    assert back.utilization == pytest.approx(min(1.0, reply.figures.utilization), abs=1e-4)


@calm
@given(vx=st.floats(-1.0, 1.0), vy=st.floats(-1.0, 1.0), omega=st.floats(0.2, 3.0))
def test_the_centre_of_rotation_stays_where_it_is(vx: float, vy: float, omega: float) -> None:
    """The body moves briefly in small steps; its point at the centre does not."""
    reply = answer(StudentRequest(number=1, base="omni4", knobs={}, twist=(vx, vy, omega)))
    assert reply.figures is not None
    assert reply.figures.centre is not None
    vx, vy, omega = reply.figures.twist
    x, y, heading, steps = 0.0, 0.0, 0.0, 1000
    for _ in range(steps):
        middle = heading + 0.5 * omega / steps
        x += (vx * math.cos(middle) - vy * math.sin(middle)) / steps
        y += (vx * math.sin(middle) + vy * math.cos(middle)) / steps
        heading += omega / steps
    cx, cy = reply.figures.centre
    carried = (
        x + cx * math.cos(heading) - cy * math.sin(heading),
        y + cx * math.sin(heading) + cy * math.cos(heading),
    )
    assert carried == pytest.approx((cx, cy), abs=1e-4)


def test_a_translation_has_no_centre_and_its_equation_no_values() -> None:
    reply = answer(StudentRequest(number=1, base="tsd", knobs={}, twist=(0.3, -0.2, 0.0)))
    assert reply.figures is not None
    assert reply.figures.centre is None
    (centre,) = (one for one in reply.figures.equations if one.name == "centre")
    assert list(centre.values) == [None, None]


def test_a_gimbal_that_leans_alone_contradicts_the_others() -> None:
    upright = [[0.0, 0.0, 2500.0]] * 3
    assert solved("tsd", upright).residual_mps == 0.0
    leaning = solved("tsd", [[5.0, 0.0, 2500.0], *upright[1:]])
    assert leaning.residual_mps > 0.1


def test_equations_have_the_numbers_of_the_joints() -> None:
    """Each from alpha, beta and rpm by hand, for a module with a 40 mm wheel."""
    joints = [[4.0, -3.0, 2500.0], [1.0, 2.0, 3000.0], [0.0, 5.0, 2800.0]]
    found = {one.name: one for one in solved("tsd", joints).equations}
    alpha, beta, rpm = np.array(joints).T
    alpha, beta, rim = np.radians(alpha), np.radians(beta), 0.04 * rpm * RPM
    sine = np.sqrt(1.0 - (np.cos(alpha) * np.cos(beta)) ** 2)
    expected = {
        "rim_speed": rim,
        "tilt": np.degrees(np.arcsin(sine)),
        "contact_x": rim * np.sin(alpha),
        "contact_y": -rim * np.cos(alpha) * np.sin(beta),
        "contact_speed": rim * sine,
        "alpha": [4.0, 1.0, 0.0],
        "beta": [-3.0, 2.0, 5.0],
    }
    for name, values in expected.items():
        assert list(found[name].values) == pytest.approx(list(values), rel=1e-5, abs=1e-9), name
        assert len(found[name].units) == 3
    assert (found["twist"].paper, found["twist"].equation) == ("Carothers 2014", "33")
    assert found["twist"].corrected


@pytest.mark.parametrize("base", robot_names())
def test_each_equation_has_a_formula_and_a_unit_for_each_value(base: str) -> None:
    reply = answer(StudentRequest(number=1, base=base, knobs={}, twist=(0.2, 0.1, 0.3)))
    shown = json.loads(encode_message(reply))["figures"]
    names = [one["name"] for one in shown["equations"]]
    assert len(names) == len(set(names)) >= 5
    for one in shown["equations"]:
        assert {"kind": "mo", "text": "="} in one["formula"]
        assert len(one["values"]) == len(one["units"])


def test_a_formula_is_split_into_elements_of_mathml() -> None:
    tokens = math_tokens("γ_i = asin { v_x^2 ; 2 · r_w }")
    assert tokens == [
        MathToken("mi", "γ", "i"),
        MathToken("mo", "="),
        MathToken("mo", "asin"),
        MathToken(
            "mfrac",
            rows=[
                [MathToken("mi", "v", "x", "2")],
                [MathToken("mn", "2"), MathToken("mo", "·"), MathToken("mi", "r", "w")],
            ],
        ),
    ]
    assert msgspec.to_builtins(tokens[1]) == {"kind": "mo", "text": "="}


def test_joints_for_another_number_of_wheels_are_refused() -> None:
    reply = answer(StudentRequest(number=1, base="tsd", knobs={}, joints=[[100.0]] * 3))
    assert reply.figures is None
    assert "joints have 1, 1, 1 numbers" in reply.problem


@pytest.mark.parametrize("base", robot_names())
def test_any_joints_have_an_answer_with_finite_numbers(base: str) -> None:
    width = 3 if base == "tsd" else 1
    count = len(load_robot(base).kinematics().actuators)
    for number in (-1e6, 0.0, 1e6):
        found = solved(base, [[number] * width] * count)
        assert np.isfinite([*found.twist, found.utilization, found.residual_mps]).all()


def test_the_figures_of_the_papers_have_their_numbers() -> None:
    """Table 2 of the thesis, and the peaks of Fig. 7 of the sphere's paper."""
    reply = answer(StudentRequest(number=1, base="tsd", knobs={}, papers=True))
    motors = next(one for one in reply.papers if one.name == "motor_speeds")
    lines = {one.label: np.polyfit(one.x, one.y, 1) for one in motors.curves if not one.points}
    assert lines["motor 1, all rows"] == pytest.approx([77.65, -563.3], abs=0.06)
    assert lines["motor 2, working range"] == pytest.approx([74.13, -22.8], abs=0.06)
    assert next(one for one in motors.curves if one.points).y[4] == 5895
    tilt = next(one for one in reply.papers if one.name == "speed_by_tilt").curves[0]
    assert (tilt.x[-1], tilt.y[-1]) == pytest.approx((30.0, 5.236), abs=1e-3)
    sphere = {
        one.name: one.curves[0].y
        for one in answer(StudentRequest(number=1, base="atlas", knobs={}, papers=True)).papers
    }
    assert max(sphere["row_angle"]) == pytest.approx(3.15, abs=0.02)
    assert max(np.abs(sphere["row_magnitude"])) == pytest.approx(3.79, abs=0.02)
    wheels = answer(StudentRequest(number=1, base="omni4", knobs={}, papers=True)).papers[0]
    assert [len(one.x) for one in wheels.curves] == [len(wheels.curves[0].y)] * 4
    assert not answer(StudentRequest(number=1, base="tsd", knobs={})).papers


class DrawnScene(EmptyScene):
    """A scene that records the robots of the Student tab."""

    def __init__(self) -> None:
        super().__init__()
        self.poses: list[StudentPose | None] = []

    def draw(self, _page: str, kind: str, act: Callable[[Any], None]) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        if kind == "student":
            act(SimpleNamespace(show_student=self.poses.append))


def test_a_page_shows_its_variant_until_it_leaves() -> None:
    scene: Any = DrawnScene()
    knobs = {"drive.wheel_radius_m": 0.04}
    request: dict[str, Any] = {"t": "student", "base": "kiwi", "knobs": knobs, "show": True}
    with site(page_scene=scene) as served, served.page() as page:
        page.until(lambda: page.state)
        page.send(**request | {"number": 1})
        eventually(lambda: len(scene.poses) == 1)
        assert scene.poses[0].robot.drive.wheel_radius_m == pytest.approx(0.04)
        page.send(**request | {"number": 2, "joints": [[10.0], [20.0], [30.0]]})
        eventually(lambda: len(scene.poses) == 2)
        np.testing.assert_allclose(scene.poses[1].joints, np.array([10.0, 20.0, 30.0]) * RPM)
        page.until(lambda: page.last("student")["number"] == 2)
        assert page.last("student")["figures"]["centre"] == list(scene.poses[1].centre)
        page.send(**request | {"number": 3, "knobs": {"drive.wheel_radius_m": -1.0}})
        page.until(lambda: page.last("student")["number"] == 3)
        assert page.last("student")["problem"]
        assert len(scene.poses) == 2  # The last valid robot remains.
        page.send(**request | {"number": 4, "show": False})
        eventually(lambda: scene.poses[-1] is None)
        page.send(**request | {"number": 5})
        eventually(lambda: scene.poses[-1] is not None)
    eventually(lambda: scene.poses[-1] is None)


def test_meshes_wait_until_the_parameters_rest_but_joints_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A dragged slider changes the robot with every request."""
    scene: Any = DrawnScene()
    request: dict[str, Any] = {"t": "student", "base": "kiwi", "knobs": {}, "show": True}
    with site(page_scene=scene) as served, served.page() as page:
        page.until(lambda: page.state)
        page.send(**request | {"number": 1})
        eventually(lambda: len(scene.poses) == 1)
        monkeypatch.setattr(student, "REBUILD_AFTER_S", 3600.0)
        for number in range(2, 6):
            knobs = {"drive.wheel_radius_m": 0.03 + 0.002 * number}
            page.send(**request | {"number": number, "knobs": knobs})
            page.until(lambda number=number: page.last("student")["number"] == number)
        page.send(**request | {"number": 6, "twist": [0.1, 0.2, 0.3]})
        eventually(lambda: len(scene.poses) == 2)
        assert scene.poses[1].robot == scene.poses[0].robot
