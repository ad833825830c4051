"""Moving parts touch no others, up to the limit of both gimbals at once."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from manifold3d import Manifold, OpType

from tests.models.robot_solids import VARIANTS, solid
from tsd_twin.models import draw_parts
from tsd_twin.robots import RobotDescription, load_robot

ROBOTS = {"tsd": load_robot("tsd"), **VARIANTS}
SHARES = (-1.0, -0.5, 0.0, 0.5, 1.0)
TOUCHING_MM3 = 0.01
"""Smaller overlaps are rounding, because vertices are on a grid of 1 µm."""


class Machine:
    """Solids of a robot in millimetres, posed in the chassis frame."""

    def __init__(self, robot: RobotDescription) -> None:
        self.robot = robot
        self.links = {link: solid(parts) for link, parts in draw_parts(robot).items()}
        self.limit_deg = robot.drive.max_tilt_deg

    def tilted(
        self, link: str, alpha_deg: float, beta_deg: float, spin_deg: float = 0.0
    ) -> Manifold:
        """Return a link in its module frame: turned about -X by alpha, then about Y by beta."""
        posed = self.links[link].rotate((0.0, 0.0, spin_deg))
        return posed.rotate((-alpha_deg, 0.0, 0.0)).rotate((0.0, beta_deg, 0.0))

    def at_module(self, shape: Manifold, index: int) -> Manifold:
        out = shape.translate((0.0, 1e3 * self.robot.drive.pivot_radius_m, 0.0))
        return out.rotate((0.0, 0.0, self.robot.drive.azimuths_deg[index] - 90.0))

    def angles(self) -> list[float]:
        return [share * self.limit_deg for share in SHARES]


@pytest.fixture(scope="module", params=ROBOTS)
def machine(request: pytest.FixtureRequest) -> Machine:
    return Machine(ROBOTS[request.param])


def overlap_mm3(a: Manifold, b: Manifold) -> float:
    return (a ^ b).volume()


def test_the_measure_sees_an_overlap() -> None:
    """A frame tilted far beyond the limit hits the chassis."""
    machine = Machine(ROBOTS["tsd"])
    frame = machine.at_module(machine.tilted("outer", 0.0, 60.0), 0)
    assert overlap_mm3(frame, machine.links["chassis"]) > 100.0 * TOUCHING_MM3


def test_outer_frames_clear_the_chassis_and_each_other(machine: Machine) -> None:
    swept: list[Manifold] = []
    for index in range(machine.robot.drive.modules):
        poses = [
            machine.at_module(machine.tilted("outer", 0.0, beta), index)
            for beta in machine.angles()
        ]
        swept.append(Manifold.batch_boolean(poses, OpType.Add))
        assert overlap_mm3(swept[-1], machine.links["chassis"]) < TOUCHING_MM3
    for a, b in itertools.combinations(swept, 2):
        assert overlap_mm3(a, b) < TOUCHING_MM3


def test_inner_frames_and_wheels_clear_the_outer_frame_and_the_chassis(machine: Machine) -> None:
    for alpha in machine.angles():
        for link in ("inner", "wheel"):
            inside = machine.tilted(link, alpha, 0.0)
            assert overlap_mm3(inside, machine.links["outer"]) < TOUCHING_MM3
            for beta in machine.angles():
                tilted = machine.at_module(machine.tilted(link, alpha, beta), 0)
                assert overlap_mm3(tilted, machine.links["chassis"]) < TOUCHING_MM3


def test_wheels_spin_freely_in_their_frames(machine: Machine) -> None:
    for spin in np.linspace(0.0, 60.0, 9, endpoint=False):
        wheel = machine.tilted("wheel", 0.0, 0.0, float(spin))
        assert overlap_mm3(wheel, machine.links["inner"]) < TOUCHING_MM3


def test_only_wheels_reach_the_floor(machine: Machine) -> None:
    floor = -1e3 * machine.robot.drive.wheel_radius_m
    angles = machine.angles()
    outer = [machine.tilted("outer", 0.0, beta) for beta in angles]
    inner = [machine.tilted("inner", alpha, beta) for alpha in angles for beta in angles]
    lowest = min(pose.bounding_box()[2] for pose in (*outer, *inner))
    assert lowest > 0.95 * floor
    assert machine.links["chassis"].bounding_box()[2] > floor
