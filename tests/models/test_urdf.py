"""The URDF loads in third-party programs, and matches the kinematics."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.models.robot_solids import VARIANTS
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import Array
from tsd_twin.models import draw_parts, shipped_model, urdf, write_model
from tsd_twin.robots import RPM, RobotDescription, load_robot

ROBOTS = {
    "tsd": load_robot("tsd"),
    "four modules": VARIANTS["four modules"],
    "uneven": VARIANTS["uneven"],
}
unhurried = settings(max_examples=30)


class Model:
    """A robot in two independent programs."""

    def __init__(self, robot: RobotDescription, folder: Path) -> None:
        path = folder / f"{robot.name}.urdf"
        self.robot, self.drive = robot, robot.kinematics()
        self.names = [joint.name for joint in self.drive.joints]
        self.urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
        self.mujoco = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.mujoco)

    def joints(self, tilts: list[float], spin: float) -> Array:
        """Return a joint vector with the gimbals at fractions `tilts` of the limit."""
        limit = self.drive.max_tilt_rad
        flat = np.resize(np.array(tilts), 3 * self.drive.modules) * limit
        flat[2::3] = spin
        return flat

    def in_yourdfpy(self, position: Array, link: str) -> Array:
        """Return the pose (4, 4) of a link in `base_link`."""
        self.urdf.update_cfg(dict(zip(self.names, position, strict=True)))
        return self.urdf.get_transform(link, "base_link")

    def in_mujoco(self, position: Array, velocity: Array) -> None:
        for name, angle, speed in zip(self.names, position, velocity, strict=True):
            joint = self.mujoco.joint(name)
            self.data.qpos[joint.qposadr[0]] = angle
            self.data.qvel[joint.dofadr[0]] = speed
        mujoco.mj_forward(self.mujoco, self.data)

    def module_turn(self, index: int) -> Array:
        """Return the axes (3, 3) of the module frame: the robot's, turned by azimuth - pi/2."""
        turn = self.drive.azimuths_rad[index] - 0.5 * np.pi
        c, s = np.cos(turn), np.sin(turn)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module", params=ROBOTS)
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Model:
    folder = tmp_path_factory.mktemp("meshes")
    write_model(ROBOTS[request.param], folder)
    return Model(ROBOTS[request.param], folder)


shares = st.one_of(st.floats(-1.0, 1.0), st.floats(-1e-9, 1e-9))
tilts = st.lists(shares, min_size=12, max_size=12)


@unhurried
@given(tilts=tilts, spin=st.floats(-500.0, 500.0))
def test_axles_posed_by_joint_angles_roll_as_the_kinematics_say(
    model: Model, tilts: list[float], spin: float
) -> None:
    """v = r_w spin l x z, with the axle l from the posed URDF, equals `contacts`."""
    joints = model.joints(tilts, spin)
    expected = model.drive.contacts(joints)
    model.in_mujoco(joints, np.zeros_like(joints))
    for index in range(model.drive.modules):
        turn = model.module_turn(index)
        wheel = f"module{index + 1}_wheel"
        for axle in (
            model.in_yourdfpy(joints, wheel)[:3, 2],
            model.data.body(wheel).xmat.reshape(3, 3)[:, 2],
        ):
            in_module = turn.T @ axle
            v = model.drive.wheel_radius_m * spin * np.cross(in_module, [0.0, 0.0, 1.0])
            np.testing.assert_allclose(v[:2], expected[index], rtol=0, atol=1e-7 * (1 + abs(spin)))


@unhurried
@given(tilts=tilts, rates=st.lists(st.floats(-10.0, 10.0), min_size=12, max_size=12))
def test_turning_gimbals_roll_as_the_kinematics_say(
    model: Model, tilts: list[float], rates: list[float]
) -> None:
    """Angular velocities in MuJoCo move the pivots like `contacts` with gimbal rates."""
    joints = model.joints(tilts, 200.0)
    change = np.resize(np.array(rates), joints.shape)
    expected = model.drive.contacts(joints, change)
    velocity = change.copy()
    velocity[2::3] = joints[2::3]
    model.in_mujoco(joints, velocity)
    for index in range(model.drive.modules):
        spatial = np.zeros(6)
        body = model.mujoco.body(f"module{index + 1}_wheel").id
        mujoco.mj_objectVelocity(
            model.mujoco, model.data, mujoco.mjtObj.mjOBJ_BODY, body, spatial, 0
        )
        omega = model.module_turn(index).T @ spatial[:3]
        v = model.drive.wheel_radius_m * np.cross(omega, [0.0, 0.0, 1.0])
        np.testing.assert_allclose(v[:2], expected[index], rtol=0, atol=1e-6)


@unhurried
@given(direction=st.tuples(shares, shares, shares))
def test_axles_of_a_commanded_twist_are_those_of_the_kinematics(
    model: Model, direction: tuple[float, float, float]
) -> None:
    twist = model.drive.limit(np.array(direction))
    joints = model.drive.inverse(twist)
    for index, axle in enumerate(model.drive.axles(twist)):
        posed = model.in_yourdfpy(joints, f"module{index + 1}_wheel")[:3, 2]
        np.testing.assert_allclose((model.module_turn(index).T @ posed)[:2], axle, atol=1e-7)


def test_pivots_are_where_the_kinematics_have_them(model: Model) -> None:
    joints = model.joints([0.7, -0.4, 0.0], 3.0)
    model.in_mujoco(joints, np.zeros_like(joints))
    for index, pivot in enumerate(model.drive.pivots_m):
        for link in ("outer", "inner", "wheel"):
            name = f"module{index + 1}_{link}"
            at = model.in_yourdfpy(joints, name)[:3, 3]
            np.testing.assert_allclose(at, [*pivot, 0.0], atol=1e-9)
            above = model.data.body(name).xpos - [0.0, 0.0, model.drive.wheel_radius_m]
            np.testing.assert_allclose(above, at, atol=1e-9)


def test_joints_have_the_names_and_limits_of_the_description(model: Model) -> None:
    assert sorted(model.urdf.actuated_joint_names) == sorted(model.names)
    assert model.urdf.validate()
    for name, joint in model.urdf.joint_map.items():
        if joint.type == "revolute":
            assert joint.limit.upper == pytest.approx(model.drive.max_tilt_rad)
            assert joint.limit.lower == pytest.approx(-model.drive.max_tilt_rad)
            assert joint.limit.velocity == pytest.approx(model.robot.servo.no_load_speed_rpm * RPM)
            assert joint.limit.effort == pytest.approx(model.robot.servo.stall_torque_nm)
        else:
            assert joint.type == ("fixed" if name == "base_joint" else "continuous")


def test_masses_add_up_and_inertias_are_possible(model: Model) -> None:
    assert model.mujoco.body_mass.sum() == pytest.approx(model.robot.mass.total_kg)
    wheel = model.mujoco.body("module1_wheel")
    assert wheel.mass[0] == pytest.approx(model.robot.mass.wheel_kg)
    # A spinning wheel is balanced: its centre and a principal axis are on the axle.
    np.testing.assert_allclose(wheel.ipos[:2], 0.0, atol=2e-5)
    for link in model.urdf.robot.links:
        if link.name == "base_footprint":
            continue
        moments = np.linalg.eigvalsh(link.inertial.inertia)
        assert moments[0] > 0.0
        assert moments[2] < moments[0] + moments[1]
        # No link is larger than the robot.
        reach = model.robot.drive.pivot_radius_m + 3.0 * model.robot.drive.wheel_radius_m
        assert moments[2] < link.inertial.mass * reach**2


def test_every_part_is_shown_in_mujoco(model: Model) -> None:
    parts = draw_parts(model.robot)
    modules = model.drive.modules
    expected = len(parts["chassis"]) + modules * sum(
        len(parts[link]) for link in ("outer", "inner", "wheel")
    )
    shown = [i for i in range(model.mujoco.ngeom) if model.mujoco.geom_contype[i] == 0]
    assert len(shown) == expected
    assert model.mujoco.nmesh == sum(len(several) for several in parts.values())


def test_wheels_touch_the_floor_at_every_tilt_and_nothing_collides(model: Model) -> None:
    joints = model.joints([0.9, -0.8, 0.0], 0.0)
    model.in_mujoco(joints, np.zeros_like(joints))
    assert model.data.ncon == 0
    for index in range(model.drive.modules):
        body = model.mujoco.body(f"module{index + 1}_wheel")
        spheres = [
            i
            for i in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
            if model.mujoco.geom_contype[i]
        ]
        assert len(spheres) == 1
        lowest = model.data.geom_xpos[spheres[0], 2] - model.mujoco.geom_size[spheres[0], 0]
        assert lowest == pytest.approx(0.0, abs=1e-9)


def test_committed_urdf_shows_its_meshes_in_yourdfpy() -> None:
    tsd = yourdfpy.URDF.load(str(shipped_model("tsd") / "tsd.urdf"))
    low, high = tsd.scene.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-5)
    assert 0.1 < high[2] < 0.2
    assert np.all(high[:2] - low[:2] > 0.35)


def test_the_text_can_be_parsed_as_it_comes_over_the_bus() -> None:
    """Parsers of text, unlike bytes, refuse an encoding in its first line."""
    text = urdf(ROBOTS["tsd"], draw_parts(ROBOTS["tsd"]))
    assert text.startswith('<?xml version="1.0"?>\n')
    read = yourdfpy.URDF.load(io.StringIO(text), load_meshes=False)
    assert sorted(read.actuated_joint_names) == sorted(
        joint.name for joint in ROBOTS["tsd"].kinematics().joints
    )


def test_meshes_can_live_elsewhere(tmp_path: Path) -> None:
    """MuJoCo strips the folder of a mesh, so that a ROS package address still loads."""
    text = urdf(ROBOTS["tsd"], draw_parts(ROBOTS["tsd"]), "package://tsd_description/meshes/")
    files = re.findall(r'<mesh filename="(.*?)"', text)
    assert files
    assert all(file.startswith("package://tsd_description/meshes/") for file in files)
    for mesh in shipped_model("tsd").glob("*.stl"):
        shutil.copy(mesh, tmp_path)
    (tmp_path / "other.urdf").write_text(text)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "other.urdf")).nmesh == len(set(files))


def test_a_robot_lighter_than_its_modules_is_refused() -> None:
    tsd = ROBOTS["tsd"]
    light = msgspec.structs.replace(tsd, mass=msgspec.structs.replace(tsd.mass, total_kg=1.0))
    with pytest.raises(RobotFileError, match=r"mass\.total_kg is 1, the modules alone weigh 1\.14"):
        urdf(light, draw_parts(light))
