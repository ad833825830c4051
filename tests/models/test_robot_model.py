"""Drawn parts are closed solids, match the description, and are reproducible."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.models.robot_solids import VARIANTS, solid, spaced, variant
from tsd_twin.errors import RobotFileError
from tsd_twin.models import draw_parts, kinematic_tree
from tsd_twin.models.solids import Parts
from tsd_twin.robots import RobotDescription, load_robot

TSD = load_robot("tsd")


def corners(parts: Parts, link: str) -> np.ndarray:
    return np.concatenate([part.mesh.vertices for part in parts[link]])


def by_name(parts: Parts, link: str, name: str) -> np.ndarray:
    return next(part.mesh.vertices for part in parts[link] if part.name == name)


@pytest.mark.parametrize("robot", [TSD, *VARIANTS.values()], ids=["tsd", *VARIANTS])
def test_every_part_is_a_closed_solid(robot: RobotDescription) -> None:
    parts = draw_parts(robot)
    assert tuple(parts) == kinematic_tree(robot).kinds
    names = [part.file for link in parts for part in parts[link]]
    assert len(set(names)) == len(names)
    for part in (part for link in parts for part in parts[link]):
        edges = np.sort(part.mesh.edges, axis=1)
        _, uses = np.unique(edges, axis=0, return_counts=True)
        assert set(uses) == {2}, part.file
        assert part.mesh.volume > 0.0, part.file


@settings(max_examples=12)
@given(
    count=st.integers(2, 8),
    wheel_m=st.floats(0.02, 0.2),
    spread=st.floats(2.3, 12.0),
    turn_deg=st.floats(-400.0, 400.0),
)
def test_any_number_of_modules_of_any_size_can_be_drawn(
    count: int, wheel_m: float, spread: float, turn_deg: float
) -> None:
    azimuths = [azimuth + turn_deg for azimuth in spaced(count)]
    robot = variant(azimuths, spread * wheel_m + 0.01, wheel_m)
    parts = draw_parts(robot)
    # Every wheel is a hemisphere about the gimbal centre, open side up, its pole on the floor.
    shell = by_name(parts, "wheel", "shell")
    assert np.linalg.norm(shell, axis=1).max() == pytest.approx(wheel_m, rel=1e-3)
    assert shell[:, 2].min() == pytest.approx(-wheel_m, abs=2e-6)
    assert shell[:, 2].max() == pytest.approx(0.0, abs=2e-6)
    # One servo behind each pivot, with cases that do not overlap.
    (servos,) = (part for part in parts["chassis"] if part.name == "servos")
    middles = [
        np.mean(case.to_mesh().vert_properties, axis=0) for case in solid([servos]).decompose()
    ]
    assert len(middles) == count
    directions = np.array([np.arctan2(y, x) for x, y, _ in middles])
    apart = np.abs(np.angle(np.exp(1j * (directions[:, None] - np.radians(azimuths)))))
    assert set(apart.argmin(axis=1)) == set(range(count))
    # Only wheels touch the floor.
    assert min(corners(parts, link)[:, 2].min() for link in ("chassis", "outer")) > -wheel_m


def test_modules_are_where_the_description_puts_them() -> None:
    """The bearings of the outer frames lie on the lines from the centre through the pivots."""
    for robot in (TSD, VARIANTS["uneven"]):
        bearings = by_name(draw_parts(robot), "chassis", "bearings")
        angles = np.arctan2(bearings[:, 1], bearings[:, 0])
        for azimuth in np.radians(robot.drive.azimuths_deg):
            own = bearings[np.abs(np.angle(np.exp(1j * (angles - azimuth)))) < 0.2]
            middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
            radial = middle[:2] @ [np.cos(azimuth), np.sin(azimuth)]
            across = middle[:2] @ [-np.sin(azimuth), np.cos(azimuth)]
            assert radial > robot.drive.pivot_radius_m + robot.drive.wheel_radius_m
            assert across == pytest.approx(0.0, abs=1e-3)
            assert middle[2] == pytest.approx(0.0, abs=1e-5)


def test_the_arrow_points_forward() -> None:
    arrow = by_name(draw_parts(TSD), "chassis", "arrow")
    tip = arrow[arrow[:, 0] > arrow[:, 0].max() - 1e-3]
    assert arrow[:, 0].min() > 0.0
    np.testing.assert_allclose(tip[:, 1], 0.0, atol=3e-3)
    assert np.ptp(arrow[:, 1]) > 0.03


def test_sheets_are_as_thick_and_as_high_as_described() -> None:
    body = msgspec.structs.replace(TSD.body, plate_thickness_m=0.004, ground_clearance_m=0.01)
    heights = np.unique(
        by_name(draw_parts(msgspec.structs.replace(TSD, body=body)), "chassis", "decks")[:, 2]
    )
    low, deck, roof, top = heights
    assert low == pytest.approx(-TSD.drive.wheel_radius_m + 0.01, abs=1e-6)
    assert deck - low == pytest.approx(0.004, abs=1e-6)
    assert top - roof == pytest.approx(0.004, abs=1e-6)


def test_colours_come_from_the_description() -> None:
    body = msgspec.structs.replace(
        TSD.body,
        acrylic_rgba=(0.1, 0.2, 0.3, 0.4),
        frame_rgba=(0.2, 0.3, 0.4, 1.0),
        wheel_rgba=(0.3, 0.4, 0.5, 1.0),
        front_rgba=(0.4, 0.5, 0.6, 1.0),
    )
    parts = draw_parts(msgspec.structs.replace(TSD, body=body))
    rgba = {part.file: part.material.rgba for link in parts for part in parts[link]}
    assert rgba["chassis_decks.stl"] == rgba["chassis_ribs.stl"] == body.acrylic_rgba
    assert rgba["outer_frame.stl"] == rgba["inner_frame.stl"] == body.frame_rgba
    assert rgba["wheel_shell.stl"] == body.wheel_rgba
    assert rgba["chassis_arrow.stl"] == body.front_rgba


def test_drawing_twice_gives_the_same_triangles() -> None:
    first, second = draw_parts(TSD), draw_parts(TSD)
    for link in first:
        for a, b in zip(first[link], second[link], strict=True):
            assert a.name == b.name
            np.testing.assert_array_equal(a.mesh.vertices, b.mesh.vertices)
            np.testing.assert_array_equal(a.mesh.faces, b.mesh.faces)


def test_wheels_without_room_are_refused_with_the_least_radius() -> None:
    with pytest.raises(
        RobotFileError, match=r"pivot_radius_m is 0\.05.*at least (0\.\d+)"
    ) as error:
        draw_parts(variant(spaced(3), 0.05, 0.04))
    least = float(str(error.value).rsplit(" ", 1)[1].rstrip(")"))
    assert draw_parts(variant(spaced(3), least + 0.001, 0.04))


def test_sheet_thicker_than_the_wheels_allow_is_refused() -> None:
    with pytest.raises(RobotFileError, match=r"plate_thickness_m is 0\.006, too much"):
        draw_parts(variant(spaced(3), 0.15, 0.01))
