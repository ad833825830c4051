"""Masses and inertias, against handbook formulas."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.errors import RobotFileError
from tsd_twin.models import masses_kg
from tsd_twin.models.files import inertia
from tsd_twin.models.solids import Material, Part
from tsd_twin.robots import load_robot

sides = st.floats(0.01, 1.0)
places = st.floats(-1.0, 1.0)


def brick(size: tuple[float, float, float], at: tuple[float, float, float], density: float) -> Part:
    mesh = trimesh.creation.box(size, transform=trimesh.transformations.translation_matrix(at))
    return Part("brick", "chassis", mesh, Material((1.0, 1.0, 1.0, 1.0), 0.0, 1.0, density))


def of_brick(size: tuple[float, float, float], mass: float) -> np.ndarray:
    x, y, z = np.square(size)
    return mass / 12.0 * np.diag([y + z, x + z, x + y])


@given(size=st.tuples(sides, sides, sides), at=st.tuples(places, places, places))
def test_a_brick_has_the_inertia_of_a_brick(
    size: tuple[float, float, float], at: tuple[float, float, float]
) -> None:
    """For any density, because the mass is given."""
    centre, tensor = inertia([brick(size, at, 123.0)], 2.5)
    np.testing.assert_allclose(centre, at, atol=1e-7)
    np.testing.assert_allclose(tensor, of_brick(size, 2.5), rtol=1e-3, atol=1e-9)


@given(height=sides, density=st.floats(100.0, 10_000.0))
def test_a_tower_of_two_bricks_is_one_brick_if_they_are_alike(
    height: float, density: float
) -> None:
    low = brick((0.3, 0.2, height), (0.0, 0.0, 0.5 * height), density)
    high = brick((0.3, 0.2, height), (0.0, 0.0, 1.5 * height), density)
    centre, tensor = inertia([low, high], 1.0)
    np.testing.assert_allclose(centre, [0.0, 0.0, height], atol=1e-9)
    np.testing.assert_allclose(
        tensor, of_brick((0.3, 0.2, 2.0 * height), 1.0), rtol=1e-6, atol=1e-12
    )


def test_the_denser_part_draws_the_centre_to_it() -> None:
    light = brick((0.1, 0.1, 0.1), (1.0, 0.0, 0.0), 1000.0)
    heavy = brick((0.1, 0.1, 0.1), (-1.0, 0.0, 0.0), 3000.0)
    assert inertia([light, heavy], 4.0)[0][0] == pytest.approx(-0.5)


def test_the_chassis_weighs_what_the_modules_leave() -> None:
    robot = load_robot("tsd")
    masses = masses_kg(robot)
    modules = masses["outer"] + masses["inner"] + masses["wheel"]
    assert masses["chassis"] + robot.drive.modules * modules == pytest.approx(robot.mass.total_kg)


def test_a_robot_lighter_than_its_modules_is_refused() -> None:
    robot = load_robot("tsd")
    mass = msgspec.structs.replace(robot.mass, total_kg=1.0)
    with pytest.raises(RobotFileError, match=r"mass\.total_kg is 1, the modules alone weigh 1\.14"):
        masses_kg(msgspec.structs.replace(robot, mass=mass))
