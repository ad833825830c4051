"""Numbers of the Student tab match the robot's, and are sent without a robot."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.dashboard.sessions.student_answer import answer
from tests.support.page_client import Site
from tsd_twin.bus import Bus, node_config
from tsd_twin.dashboard.sessions.variants import variant
from tsd_twin.dashboard.wire.from_page import StudentRequest, decode_page_message
from tsd_twin.dashboard.wire.student import StudentFigures
from tsd_twin.dashboard.wire.to_page import encode_message
from tsd_twin.errors import RobotFileError
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.messages.errors import MessageError
from tsd_twin.models import load_parts
from tsd_twin.robots import load_robot, parse_description, robot_names

calm = settings(max_examples=40)
RPM = math.pi / 30.0


@contextmanager
def nothing_on_the_bus() -> Generator[Site]:
    with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
        made = Site(bus, 1, None)
        try:
            yield made
        finally:
            made.close()


def figures(base: str, twist: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> StudentFigures:
    reply = answer(StudentRequest(number=1, base=base, knobs={}, twist=twist))
    assert reply.figures is not None, reply.problem
    return reply.figures


def named(base: str) -> dict[str, float]:
    return {one.name: one.value for one in figures(base).figures}


def test_the_figures_of_the_thesis_robot_are_those_of_its_page() -> None:
    """Compares with docs/kinematics.md."""
    found = named("tsd")
    assert found["Top speed forward"] == pytest.approx(5.236, abs=1e-3)
    assert found["Slowest direction"] == found["Fastest direction"] == found["Top speed forward"]
    assert found["Top turn rate"] == pytest.approx(5.23599 / 0.15, rel=1e-4)
    assert found["Speed for one servo step"] == pytest.approx(16.06, abs=0.01)
    module = figures("tsd", (1.0, 0.0, 0.0)).wheels[0]
    assert module.gimbal is not None
    assert module.gimbal[2] == pytest.approx(5.48, abs=0.01)


def test_omni_wheels_at_the_corners_are_fastest_along_the_axes() -> None:
    """Wheels at 45 degrees: a factor of root two between diagonal and axes."""
    found = named("omni4")
    assert found["Fastest direction"] == pytest.approx(
        math.sqrt(2.0) * found["Slowest direction"], rel=1e-4
    )
    assert found["Top speed forward"] == found["Fastest direction"]


@pytest.mark.parametrize("base", robot_names())
def test_every_shipped_robot_has_figures_that_a_page_can_show(base: str) -> None:
    shown = json.loads(
        encode_message(answer(StudentRequest(number=7, base=base, knobs={}, toml=True)))
    )
    assert shown["number"] == 7
    assert [robot["id"] for robot in shown["bases"]] == robot_names()
    assert shown["problem"] == ""
    assert all(math.isfinite(one["value"]) for one in shown["figures"]["figures"])
    assert [outline["axes"] for outline in shown["figures"]["outlines"]] == [[0, 1], [0, 2], [1, 2]]
    assert len(shown["figures"]["wheels"]) >= 3
    assert parse_description(shown["toml"], "my.toml").drive == load_robot(base).drive  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]


@calm
@given(
    twist=st.tuples(*[st.floats(-20.0, 20.0)] * 3),
    tilt=st.floats(2.0, 60.0),
    radius=st.floats(0.05, 0.6),
)
def test_gimbals_of_a_twist_roll_the_pivots_at_the_twist_that_is_told(
    twist: tuple[float, float, float], tilt: float, radius: float
) -> None:
    """Each sphere rolls about its axle: v = r spin l x z, in the module frame."""
    knobs = {"drive.max_tilt_deg": tilt, "drive.pivot_radius_m": radius}
    reply = answer(StudentRequest(number=1, base="tsd", knobs=knobs, twist=twist))
    found = reply.figures
    assert found is not None
    vx, vy, omega = found.twist
    for wheel, azimuth_deg in zip(found.wheels, (90.0, 210.0, 330.0), strict=True):
        assert wheel.gimbal is not None
        assert wheel.axle is not None
        alpha, beta, tilted = np.radians(wheel.gimbal)
        assert math.degrees(tilted) <= tilt * (1.0 + 1e-5)
        turn = math.radians(azimuth_deg) - math.pi / 2.0
        lx, ly = math.cos(alpha) * math.sin(beta), math.sin(alpha)
        c, s = math.cos(turn), math.sin(turn)
        axle = np.array([c * lx - s * ly, s * lx + c * ly])
        assert wheel.axle == pytest.approx(axle, abs=1e-5)
        rim_mps = 0.04 * wheel.rpm * RPM
        push = rim_mps * np.array([axle[1], -axle[0]])
        x, y = (
            radius * math.cos(math.radians(azimuth_deg)),
            radius * math.sin(math.radians(azimuth_deg)),
        )
        pivot = np.array([vx - omega * y, vy + omega * x])
        assert push == pytest.approx(pivot, abs=1e-4 * rim_mps)
        assert wheel.push == pytest.approx(pivot, abs=1e-4 * rim_mps)


@calm
@given(twist=st.tuples(*[st.floats()] * 3), base=st.sampled_from(robot_names()))
def test_any_twist_has_an_answer_with_finite_numbers(
    twist: tuple[float, float, float], base: str
) -> None:
    text = encode_message(answer(StudentRequest(number=1, base=base, knobs={}, twist=twist)))
    found = json.loads(text)["figures"]
    assert all(math.isfinite(part) for part in found["twist"])
    assert all(math.isfinite(wheel["rpm"]) for wheel in found["wheels"])


def test_what_is_impossible_is_told_in_the_words_of_the_loader() -> None:
    knobs = {"drive.cruise_speed_rpm": 900.0}
    reply = answer(StudentRequest(number=1, base="tsd", knobs=knobs, toml=True))
    assert reply.figures is None
    assert reply.toml is None
    assert reply.problem.startswith("drive.cruise_speed_rpm is 900, motor 1 turns from 2000")
    turned = next(knob for knob in reply.knobs if knob.key == "drive.cruise_speed_rpm")
    assert (turned.value, turned.usual) == (900.0, 2500.0)
    unknown = answer(StudentRequest(number=2, base="../tsd", knobs={}))
    assert unknown.problem.startswith("no such robot")
    assert unknown.knobs == []
    assert len(unknown.bases) == len(robot_names())


def test_a_drive_without_room_for_its_body_has_figures_and_no_file() -> None:
    """`--robot` would refuse it, because its wheels collide."""
    knobs = {"drive.wheel_radius_m": 0.1, "drive.pivot_radius_m": 0.12}
    reply = answer(StudentRequest(number=1, base="tsd", knobs=knobs, toml=True))
    assert reply.figures is not None
    assert reply.toml is None
    assert "too little for a body" in reply.problem
    with pytest.raises(RobotFileError):
        load_parts(variant("tsd", knobs))


def test_a_request_has_bounds() -> None:
    long = {"t": "student", "number": 1, "base": "tsd", "knobs": {"x" * 65: 1.0}}
    many = long | {"knobs": {f"drive.{i}": 1.0 for i in range(65)}}
    for message in (long, many, long | {"knobs": {}, "base": "x" * 33}):
        with pytest.raises(MessageError):
            decode_page_message(json.dumps(message))


def test_a_page_without_a_robot_gets_its_figures_and_only_the_newest_of_many() -> None:
    with nothing_on_the_bus() as served, served.page() as page:
        for number in range(1, 31):
            page.send(
                t="student",
                number=number,
                base="tsd",
                knobs={"drive.wheel_radius_m": 0.05},
                twist=[0.0, 0.0, 0.0],
                toml=False,
            )
        page.until(lambda: page.last("student")["number"] == 30)
        replies = page.all("student")
        numbers = [reply["number"] for reply in replies]
        assert numbers == sorted(numbers)
        top = {one["name"]: one["value"] for one in replies[-1]["figures"]["figures"]}
        usual = answer(StudentRequest(number=1, base="tsd", knobs={})).figures
        assert usual is not None
        own = usual.tops[0]
        assert top["Top speed forward"] == pytest.approx(own * 0.05 / 0.04, rel=1e-5)
        assert not page.all("robot")


def test_the_computation_takes_less_processor_than_a_frame_of_the_page() -> None:
    """A dragged slider sends 12 requests per second, and paths are planned on the same thread."""
    request = StudentRequest(number=1, base="omni4", knobs={"drive.wheel_radius_m": 0.05})
    took_s: list[float] = []
    for _ in range(6):
        before_s = time.thread_time()
        answer(request)
        took_s.append(time.thread_time() - before_s)
    assert min(took_s) < 0.02


def test_the_kinematics_of_a_variant_are_those_of_its_description() -> None:
    drive = load_robot("tsd").kinematics()
    assert isinstance(drive, SingularityKinematics)
    tops = figures("tsd").tops
    assert drive.joint_utilization(np.diag(tops)) == pytest.approx([1.0, 1.0, 1.0], rel=1e-5)
