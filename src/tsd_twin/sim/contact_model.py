"""The MuJoCo model of a singularity drive: solid bodies on a floor, no rolling equation."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.robots import RPM, SingularityRobot
from tsd_twin.sim.engine import engine

TIMESTEP_S = 0.001
"""Half and a tenth of it give the same motion to four digits."""
FLOOR = "floor"
_CONTACT_S = 0.005
"""Time in which the floor gives way under the weight of the robot."""
_PLATE_HEIGHT_M = 0.05
"""Of the disc that the chassis is taken for, around the height of the gimbals."""
_ROD_M = 0.006
"""Radius of the rods that gimbal frames are taken for."""
_GEAR_INERTIA_KG_M2 = 0.01
"""Of a gimbal servo behind its gears: of the class of the MX-64, nobody publishes it."""
_FREE = {"contype": 0, "conaffinity": 0}


def wheel_name(i: int) -> str:
    """Return the name of wheel `i`, its body and its shape, counted from 0."""
    return f"wheel{i + 1}"


def contact_model(robot: SingularityRobot) -> Any:
    """Return the solid bodies of `robot` on a level floor.

    The chassis is a disc of the size of the pivot circle, each gimbal frame a rod from bearing to
    bearing, each wheel half a hollow sphere. Joints have the names of the drive's joints; servos
    brake as gear motors do, and what drives them is applied from outside. The floor bears wheels
    and nothing else, without friction: that of a spinning patch is applied from outside as well,
    see `ContactPatch`.
    """
    mujoco = engine()
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    geometry, mass = robot.drive, robot.mass
    floor = spec.worldbody.add_geom(name=FLOOR, size=[100.0, 100.0, 1.0], **_FREE)
    floor.type = mujoco.mjtGeom.mjGEOM_PLANE
    base = spec.worldbody.add_body(name="base", pos=[0.0, 0.0, geometry.wheel_radius_m])
    base.add_freejoint()
    plate = base.add_geom(size=[geometry.pivot_radius_m, _PLATE_HEIGHT_M / 2.0, 0.0], **_FREE)
    plate.type = mujoco.mjtGeom.mjGEOM_CYLINDER
    plate.mass = mass.total_kg - geometry.modules * (mass.wheel_kg + 2.0 * mass.gimbal_kg)
    for i in range(geometry.modules):
        _add_module(base, i, robot)
        pair = spec.add_pair(geomname1=FLOOR, geomname2=wheel_name(i), condim=1)
        pair.solref = [_CONTACT_S, 1.0]
    return spec.compile()


def _add_module(base: Any, i: int, robot: SingularityRobot) -> None:
    """Hang a wheel into two gimbal frames: Y of a module is radially outward."""
    geometry, mass = robot.drive, robot.mass
    radius = geometry.wheel_radius_m
    azimuth = float(np.radians(geometry.azimuths_deg[i]))
    half_turn = (azimuth - np.pi / 2.0) / 2.0
    outer = base.add_body(
        pos=geometry.pivot_radius_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]),
        quat=[np.cos(half_turn), 0.0, 0.0, np.sin(half_turn)],
    )
    _add_servo(outer, f"module{i + 1}_beta", [0.0, 1.0, 0.0], robot)
    _add_frame(outer, [0.0, 1.2 * radius, 0.0], mass.gimbal_kg)
    inner = outer.add_body()
    _add_servo(inner, f"module{i + 1}_alpha", [-1.0, 0.0, 0.0], robot)
    _add_frame(inner, [radius, 0.0, 0.0], mass.gimbal_kg)
    wheel = inner.add_body(name=wheel_name(i))
    wheel.add_joint(name=f"module{i + 1}_wheel", axis=[0.0, 0.0, 1.0])
    # Half a hollow sphere: its centre of mass is half a radius below the gimbal centre.
    across = mass.wheel_kg * radius**2 * (2.0 / 3.0 - 1.0 / 4.0)
    wheel.mass = mass.wheel_kg
    wheel.ipos = [0.0, 0.0, -radius / 2.0]
    wheel.inertia = [across, across, mass.wheel_kg * radius**2 * 2.0 / 3.0]
    wheel.explicitinertial = True
    wheel.add_geom(name=wheel_name(i), size=[radius, 0.0, 0.0], **_FREE)


def _add_servo(body: Any, name: str, axis: list[float], robot: SingularityRobot) -> None:
    """A gear motor at full voltage has its stall torque at rest and none at its no-load speed."""
    no_load_rad_per_s = robot.servo.no_load_speed_rpm * RPM
    body.add_joint(
        name=name,
        axis=axis,
        armature=_GEAR_INERTIA_KG_M2,
        damping=robot.servo.stall_torque_nm / no_load_rad_per_s,
    )


def _add_frame(body: Any, bearing_m: list[float], mass_kg: float) -> None:
    ends = [*(-np.array(bearing_m)), *bearing_m]
    rod = body.add_geom(size=[_ROD_M, 0.0, 0.0], fromto=ends, mass=mass_kg, **_FREE)
    rod.type = engine().mjtGeom.mjGEOM_CAPSULE
