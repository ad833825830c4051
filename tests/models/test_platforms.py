"""Geometry, suspension and mass of wheeled platforms match their description."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Manifold
from scipy.spatial.transform import Rotation

from tests.models.robot_solids import solid
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import SO3, Array
from tsd_twin.models import (
    KinematicTree,
    draw_parts,
    kinematic_tree,
    shipped_model,
    write_model,
)
from tsd_twin.models.solids import Part, Parts
from tsd_twin.robots import (
    OmniDescription,
    RobotDescription,
    SphereDescription,
    load_robot,
    robot_names,
)
from tsd_twin.robots.omni import OmniGeometry, OmniWheel, SphereGeometry, SphereWheel


def omni(name: str) -> OmniDescription:
    robot = load_robot(name)
    assert isinstance(robot, OmniDescription)
    return robot


def sphere(name: str) -> SphereDescription:
    robot = load_robot(name)
    assert isinstance(robot, SphereDescription)
    return robot


def ring(count: int, reach_m: float, radius_m: float, roller_deg: float = 0.0) -> OmniDescription:
    """Return a platform on wheels in a circle, which drive along it."""
    wheels = [
        OmniWheel(
            reach_m * math.cos(2.0 * math.pi * i / count),
            reach_m * math.sin(2.0 * math.pi * i / count),
            360.0 * i / count - 90.0,
            roller_deg,
        )
        for i in range(count)
    ]
    base = omni("kiwi")
    return msgspec.structs.replace(
        base,
        drive=OmniGeometry(wheel_radius_m=radius_m, wheels=wheels),
        mass=msgspec.structs.replace(base.mass, total_kg=1.0 * count),
    )


def mounted(below_equator_deg: float, turns_deg: Sequence[float]) -> SphereDescription:
    """Return a sphere on wheels in another mounting."""
    base = sphere("atlas")
    count = len(turns_deg)
    wheels = [
        SphereWheel(360.0 * i / count + 17.0, below_equator_deg, turn)
        for i, turn in enumerate(turns_deg)
    ]
    geometry: SphereGeometry = msgspec.structs.replace(base.drive, wheels=wheels)
    return msgspec.structs.replace(base, drive=geometry)


PLATFORMS = {
    "omni4": omni("omni4"),
    "kiwi": omni("kiwi"),
    "mecanum": omni("mecanum"),
    "six wheels": ring(6, 0.4, 0.06),
    "slanting": ring(4, 0.25, 0.05, 30.0),
}
SPHERES = {
    "atlas": sphere("atlas"),
    "orthogonal": mounted(math.degrees(math.asin(math.sqrt(1.0 / 3.0))), [0.0, 0.0, 0.0]),
    "four wheels": mounted(35.0, [0.0, 20.0, 0.0, 20.0]),
}


def pieces(parts: Sequence[Part], name: str) -> list[Manifold]:
    """Return the solids that a part consists of, in millimetres."""
    (part,) = (part for part in parts if part.name == name)
    return list(solid([part]).decompose())


def lowest_roller_axis(parts: Sequence[Part]) -> Array:
    """Return the unit vector (3,) along the roller at the contact, by the shape of it alone."""
    rollers = pieces(parts, "rollers")
    roller = min(rollers, key=lambda piece: float(np.mean(_corners(piece)[:, 2])))
    corners = _corners(roller)
    _, _, axes = np.linalg.svd(corners - corners.mean(axis=0))
    return axes[0]


def _corners(piece: Manifold) -> Array:
    return np.asarray(piece.to_mesh().vert_properties, np.float64)[:, :3]


ALL: dict[str, RobotDescription] = {**PLATFORMS, **SPHERES}
ATLAS = yourdfpy.URDF.load(str(shipped_model("atlas") / "atlas.urdf"), load_meshes=False)
TOUCHING_MM3 = 0.5
"""Rollers and sphere are polyhedra, so contacts may overlap slightly."""


class Machine:
    """A robot in MuJoCo, from its generated files, and as solids."""

    def __init__(self, robot: RobotDescription, folder: Path) -> None:
        self.robot: Any = robot
        self.drive: Any = robot.kinematics()
        self.tree: KinematicTree = kinematic_tree(robot)
        self.parts: Parts = draw_parts(robot)
        write_model(robot, folder)
        self.file = folder / f"{robot.name}.urdf"
        self.mujoco = mujoco.MjModel.from_xml_path(str(self.file))
        self.data = mujoco.MjData(self.mujoco)

    def turning(self, speeds: Array) -> None:
        """Turn the wheels."""
        mujoco.mj_resetData(self.mujoco, self.data)
        for joint, speed in zip(self.drive.joints, speeds, strict=True):
            self.data.qvel[self.mujoco.joint(joint.name).dofadr[0]] = speed
        mujoco.mj_forward(self.mujoco, self.data)

    def wheels(self) -> list[tuple[str, str]]:
        """Return kind and name of each wheel link, in joint order."""
        found = {
            joint: (group.kind, name)
            for group in self.tree.link_groups
            for joint, name in zip(group.joints, group.names, strict=True)
        }
        return [found[joint.name] for joint in self.drive.joints]

    def posed(self, kind: str, name: str, spin: float = 0.0) -> Manifold:
        """Return a link as a solid in millimetres, at its pose in MuJoCo, above the floor."""
        body = self.data.body(name)
        turn = SO3.exp(spin * np.array([0.0, 1.0, 0.0])).as_matrix()
        shape = solid(self.parts[kind]).transform(np.hstack([turn, np.zeros((3, 1))]))
        pose = np.hstack([body.xmat.reshape(3, 3), 1e3 * body.xpos[:, None]])
        return shape.transform(pose)


@pytest.fixture(scope="module", params=ALL)
def machine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Machine:
    found = Machine(ALL[request.param], tmp_path_factory.mktemp("platform"))
    found.turning(np.zeros(len(found.drive.joints)))
    return found


def rim_velocity(machine: Machine, name: str, down: Array) -> Array:
    """Return the rim velocity (3,) at a wheel's contact, from the joint alone, m/s."""
    spatial = np.zeros(6)
    body = machine.mujoco.body(name).id
    mujoco.mj_objectVelocity(
        machine.mujoco, machine.data, mujoco.mjtObj.mjOBJ_BODY, body, spatial, 0
    )
    return np.cross(spatial[:3], machine.robot.drive.wheel_radius_m * down)


@pytest.mark.parametrize("seed", range(3))
def test_no_roller_slips_along_its_axle(machine: Machine, seed: int) -> None:
    """The axle is measured on the drawn roller; along it, rim and floor or sphere move alike."""
    twist = 0.3 * np.random.default_rng(seed).normal(size=3)
    machine.turning(machine.drive.inverse(twist))
    for kind, name in machine.wheels():
        body = machine.data.body(name)
        turn = body.xmat.reshape(3, 3)
        down = -turn[:, 2]
        contact = body.xpos + machine.robot.drive.wheel_radius_m * down
        rim = rim_velocity(machine, name, down)
        if isinstance(machine.robot, SphereDescription):
            centre = machine.data.body("sphere").xpos
            other = np.cross(twist, contact - centre)
        else:
            vx, vy, omega = twist
            # The floor is at rest.
            rim += np.array([vx, vy, 0.0]) + np.cross([0.0, 0.0, omega], contact)
            other = np.zeros(3)
        axle = turn @ lowest_roller_axis(machine.parts[kind])
        assert rim @ axle == pytest.approx(other @ axle, abs=2e-3)


def test_wheels_touch_floor_or_sphere_and_nothing_else_does(machine: Machine) -> None:
    radius = machine.robot.drive.wheel_radius_m
    for _, name in machine.wheels():
        body = machine.data.body(name)
        contact = body.xpos - radius * body.xmat.reshape(3, 3)[:, 2]
        if isinstance(machine.robot, SphereDescription):
            arm = contact - machine.data.body("sphere").xpos
            assert np.linalg.norm(arm) == pytest.approx(machine.robot.drive.sphere_radius_m)
        else:
            assert contact[2] == pytest.approx(0.0, abs=1e-9)
    low = machine.posed("chassis", "base_link").bounding_box()[2]
    # The feet of a stand are on the floor, as are tracking wheels.
    assert low > -0.01


def test_every_wheel_is_round_to_the_last_roller(machine: Machine) -> None:
    """Seen along the axle, the rollers reach the rim at every angle, and not beyond."""
    radius_mm = 1e3 * machine.robot.drive.wheel_radius_m
    for kind in {kind for kind, _ in machine.wheels()}:
        seen = solid(part for part in machine.parts[kind] if part.name == "rollers")
        outline = seen.rotate((90.0, 0.0, 0.0)).project()
        corners = np.concatenate([np.asarray(loop) for loop in outline.to_polygons()])
        assert np.hypot(*corners.T).max() < 1.001 * radius_mm
        reaching = corners[np.hypot(*corners.T) > 0.97 * radius_mm]
        angles = np.sort(np.arctan2(reaching[:, 1], reaching[:, 0]))
        gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
        # Between two corners a straight edge is inside by at most its sagitta.
        assert 1.0 - np.cos(0.5 * gaps.max()) < 0.03


def test_wheels_spin_freely(machine: Machine) -> None:
    chassis = machine.posed("chassis", "base_link")
    for spin in (0.0, 0.11, 0.37):
        wheels = [machine.posed(kind, name, spin) for kind, name in machine.wheels()]
        for wheel in wheels:
            assert (wheel ^ chassis).volume() < TOUCHING_MM3
        for a, b in itertools.combinations(wheels, 2):
            assert (a ^ b).volume() < TOUCHING_MM3


@pytest.mark.parametrize("name", SPHERES)
def test_a_sphere_turns_freely(name: str, tmp_path: Path) -> None:
    machine = Machine(SPHERES[name], tmp_path)
    machine.turning(np.zeros(len(machine.drive.joints)))
    ball = machine.posed("sphere", "sphere")
    radius_mm = 1e3 * machine.robot.drive.sphere_radius_m
    round_ = Manifold.sphere(radius_mm, 128).translate(1e3 * machine.data.body("sphere").xpos)
    assert (ball - round_).volume() < 2e-3 * round_.volume()
    assert (round_ ^ machine.posed("chassis", "base_link")).volume() == 0.0
    for kind, wheel in machine.wheels():
        assert (round_ ^ machine.posed(kind, wheel)).volume() < TOUCHING_MM3


def test_masses_add_up_and_inertias_are_possible(machine: Machine) -> None:
    assert machine.mujoco.body_mass.sum() == pytest.approx(machine.robot.mass.total_kg, rel=1e-5)
    for _, name in machine.wheels():
        wheel = machine.mujoco.body(name)
        assert wheel.mass[0] == pytest.approx(machine.robot.mass.wheel_kg)
        # Balanced: the centre is on the axle, Y.
        np.testing.assert_allclose(wheel.ipos[[0, 2]], 0.0, atol=1e-4)
    for link in yourdfpy.URDF.load(str(machine.file), load_meshes=False).robot.links:
        if link.inertial is not None:
            moments = np.linalg.eigvalsh(link.inertial.inertia)
            assert moments[0] > 0.0
            assert moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-6)


def test_joints_are_those_of_the_kinematics(machine: Machine) -> None:
    urdf = yourdfpy.URDF.load(str(machine.file), load_meshes=False)
    assert urdf.validate()
    ours = {joint.name for joint in machine.drive.joints}
    assert ours <= set(urdf.actuated_joint_names)
    others = set(urdf.actuated_joint_names) - ours
    ball = {f"sphere_turn_{axis}" for axis in ("yaw", "pitch", "roll")}
    assert others == (ball if isinstance(machine.robot, SphereDescription) else set())


@given(axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
@settings(max_examples=20)
def test_a_sphere_in_urdf_can_be_turned_to_every_orientation(
    axis: tuple[float, float, float],
) -> None:
    """Yaw, pitch and roll of the intermediate links, by `scipy`, compose the rotation."""
    wanted = Rotation.from_rotvec(axis)
    yaw, pitch, roll = wanted.as_euler("ZYX")
    ATLAS.update_cfg({"sphere_turn_yaw": yaw, "sphere_turn_pitch": pitch, "sphere_turn_roll": roll})
    turned = ATLAS.get_transform("sphere", "base_link")[:3, :3]
    np.testing.assert_allclose(turned, wanted.as_matrix(), atol=1e-7)


@pytest.mark.parametrize("name", robot_names())
def test_committed_urdf_shows_its_meshes_in_yourdfpy(name: str) -> None:
    low, high = yourdfpy.URDF.load(str(shipped_model(name) / f"{name}.urdf")).scene.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-3)
    assert np.all(high - low > 0.08)


@settings(max_examples=6)
@given(
    count=st.integers(3, 8),
    radius_m=st.floats(0.02, 0.15),
    spread=st.floats(3.0, 6.0),
    roller_deg=st.just(0.0) | st.floats(30.0, 50.0),
)
def test_any_number_of_wheels_of_any_slant_can_be_drawn(
    count: int, radius_m: float, spread: float, roller_deg: float
) -> None:
    robot = ring(count, spread * radius_m, radius_m, roller_deg)
    drawn = draw_parts(robot)
    assert tuple(drawn) == kinematic_tree(robot).kinds
    assert len(pieces(drawn["chassis"], "gearboxes")) >= count
    assert min(p.mesh.vertices[:, 2].min() for p in drawn["chassis"]) > -radius_m


def test_marks_tell_the_ends_of_the_axes_of_a_sphere() -> None:
    """The front mark is at +X, the upper one at +Z, and every field has its own octant."""
    marks = {part.name: part.mesh for part in draw_parts(load_robot("atlas"))["sphere"]}
    for name, axis in (("front", 0), ("up", 2)):
        middle = marks[name].vertices.mean(axis=0)
        assert middle[axis] > 0.9 * 0.15 * 0.9
        np.testing.assert_allclose(np.delete(middle, axis), 0.0, atol=2e-3)


@pytest.mark.parametrize("name", ["omni4", "atlas"])
def test_a_robot_lighter_than_its_wheels_is_refused(name: str, tmp_path: Path) -> None:
    robot: Any = load_robot(name)
    light = msgspec.structs.replace(robot.mass, total_kg=0.1)
    with pytest.raises(RobotFileError, match=r"mass\.total_kg is 0\.1"):
        write_model(msgspec.structs.replace(robot, mass=light), tmp_path)
