"""The kinematics against MuJoCo: spheres with friction on a plane, without project equations."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import load_robot

DRIVE = load_robot("tsd").kinematics()
RAMP_S, LONG_ENOUGH_S = 0.5, 2.0
CONTACT_S = 0.005
"""Time constant of MuJoCo's soft friction; in a curve the motion lags by it."""


def world(drive: SingularityKinematics) -> str:
    """A plate on gimbals and spheres with friction, driven by stiff servos and motors."""
    modules, actuators = "", ""
    for i, (pivot, azimuth) in enumerate(zip(drive.pivots_m, drive.azimuths_rad, strict=True)):
        # Y of a module is radially outward; alpha turns about -X, beta about Y, the wheel about Z.
        modules += f"""
          <body pos="{pivot[0]} {pivot[1]} 0" euler="0 0 {azimuth - np.pi / 2}">
            <joint name="beta{i}" axis="0 1 0" damping="0.5" armature="0.01"/>
            <geom size="0.01" mass="0.1" contype="0" conaffinity="0"/>
            <body>
              <joint name="alpha{i}" axis="-1 0 0" damping="0.5" armature="0.01"/>
              <geom size="0.01" mass="0.1" contype="0" conaffinity="0"/>
              <body>
                <joint name="wheel{i}" axis="0 0 1"/>
                <geom size="{drive.wheel_radius_m}" mass="0.08"/>
              </body>
            </body>
          </body>"""
        actuators += f"""
          <position joint="alpha{i}" kp="200"/>
          <position joint="beta{i}" kp="200"/>
          <velocity joint="wheel{i}" kv="0.1"/>"""
    return f"""
      <mujoco>
        <compiler angle="radian"/>
        <option timestep="0.0005" integrator="implicitfast" cone="elliptic" impratio="10"/>
        <default><geom solref="{CONTACT_S} 1"/></default>
        <worldbody>
          <geom type="plane" size="20 20 1"/>
          <body pos="0 0 {drive.wheel_radius_m}">
            <freejoint/>
            <geom type="box" size="0.15 0.15 0.02" mass="2.4" contype="0" conaffinity="0"/>
            {modules}
          </body>
        </worldbody>
        <actuator>{actuators}</actuator>
      </mujoco>"""


def rolled(joints: Array) -> Array:
    """Mean twist (3,) of a robot in its own frame, after its gimbals have reached `joints`."""
    model = mujoco.MjModel.from_xml_string(world(DRIVE))
    data = mujoco.MjData(model)
    for i in range(DRIVE.modules):
        data.joint(f"wheel{i}").qvel = DRIVE.spin_rad_per_s
    upright = DRIVE.inverse(np.zeros(3))
    twists = []
    while data.time < LONG_ENOUGH_S:
        data.ctrl[:] = upright + min(1.0, data.time / RAMP_S) * (joints - upright)
        mujoco.mj_step(model, data)
        if data.time > LONG_ENOUGH_S / 2.0:
            heading = 2.0 * np.arctan2(data.qpos[6], data.qpos[3])
            c, s = np.cos(heading), np.sin(heading)
            vx, vy = data.qvel[:2]
            twists.append([c * vx + s * vy, -s * vx + c * vy, data.qvel[5]])
    return np.mean(twists, axis=0)


@pytest.mark.parametrize(
    "twist", [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0], [0.3, -0.2, 1.0]]
)
def test_a_robot_of_solid_bodies_does_what_it_is_told(twist: list[float]) -> None:
    np.testing.assert_allclose(rolled(DRIVE.inverse(np.array(twist))), twist, rtol=0, atol=0.005)


@pytest.mark.parametrize("twist", [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])
def test_as_printed_it_leaves_diagonally(twist: list[float]) -> None:
    """With Eq. 4 and 7 as printed, forward and left give the same motion, which is neither."""
    joints = []
    for azimuth in DRIVE.azimuths_rad:
        c, s = np.cos(azimuth), np.sin(azimuth)
        turn = np.array([[c, s], [-s, c]])
        vx, vy = turn @ np.array([[1.0, 1.0], [1.0, 1.0]]) @ twist[:2]
        lx, ly = np.array([-vy, vx]) / (DRIVE.wheel_radius_m * DRIVE.spin_rad_per_s)
        beta = np.arctan2(lx, np.sqrt(1.0 - lx * lx - ly * ly))
        joints += [np.arcsin(ly), beta, DRIVE.spin_rad_per_s]
    gone = rolled(np.array(joints))
    np.testing.assert_allclose(gone, [0.5, -0.5, 0.0], rtol=0, atol=0.005)
