"""MuJoCo simulation of a singularity drive: rigid bodies, torques and friction on a floor.

Assumes no rolling constraint. MuJoCo is an optional extra, imported only in this module.
"""

from __future__ import annotations

import importlib
from typing import Any, TypeAlias, Unpack

import numpy as np
import numpy.typing as npt

from tsd_twin.errors import needs_extra
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import RPM, SingularityDescription
from tsd_twin.robots.description import GRAVITY_MPS2, BuildErrors, Floor
from tsd_twin.simulation.actuators import SimulationOptions
from tsd_twin.simulation.gimbal_actuation import Actuation, BuiltLayout


def load_mujoco() -> Any:
    """Import and return `mujoco`.

    Raises:
        MissingExtraError: If MuJoCo is not installed.
    """
    with needs_extra("The plant `mujoco`", "mujoco"):
        return importlib.import_module("mujoco")


_SPIN_IN_SLIP = 8.0 / (3.0 * np.pi)
"""Weight of the rim speed relative to the slip, in the friction force."""
_SLIP_IN_SPIN = 15.0 * np.pi / 16.0
"""Weight of the slip relative to the rim speed, in the friction torque."""
_MEAN_LEVER = 3.0 * np.pi / 16.0
"""Friction lever of a purely spinning patch, in radii, under Hertzian pressure."""
_STANDSTILL_MPS = 0.01
"""Regularization speed below which the patch sticks, modelled as viscous sliding."""


def patch_friction(floor: Floor, load: Array, slip: Array, spin: Array) -> tuple[Array, Array]:
    """Return the Coulomb friction on small round patches that slide and spin simultaneously.

    A wheel with an upright axle spins its contact patch on the floor like a drill. Friction opposes
    the velocity of each point of the patch, so spinning absorbs most of it, and the remaining force
    is viscous: proportional to a small slip. Sources: Contensou (1963) for the effect; Zhuravlev,
    "The model of dry friction in the problem of the rolling of rigid bodies" (1998) for the
    coefficients under Hertzian pressure. Changed: the two speeds are added in quadrature, which
    approximates the integral over the patch better than their sum.

    Args:
        floor: Friction coefficient and patch radius.
        load: (k,) normal forces.
        slip: (k, 2) velocities of the wheel surfaces over the floor, m/s.
        spin: (k,) angular velocities about the normal, rad/s.

    Returns:
        Force (k, 2), newtons, and torque about the normal (k,), newton metres.
    """
    rim = floor.patch_radius_m * spin
    slip2 = slip[:, 0] ** 2 + slip[:, 1] ** 2 + _STANDSTILL_MPS**2
    most = floor.friction * load
    force = -(most / np.sqrt(slip2 + (_SPIN_IN_SLIP * rim) ** 2))[:, None] * slip
    lever_m = _MEAN_LEVER * floor.patch_radius_m
    return force, -most * lever_m * rim / np.sqrt(rim**2 + _SLIP_IN_SPIN**2 * slip2)


TIMESTEP_S = 0.001
"""Steps of 1/2 and 1/10 of this yield the same motion to four digits."""
FLOOR = "floor"
_CONTACT_S = 0.005
"""Time constant of the compliant floor contact."""
_PLATE_HEIGHT_M = 0.05
"""Height of the disc that models the chassis, centred at gimbal height."""
_ROD_M = 0.006
"""Radius of the rods that model the gimbal frames."""
_GEAR_INERTIA_KG_M2 = 0.01
"""Output-side inertia of a gimbal servo; estimated for the MX-64, for which none is published."""
_FREE = {"contype": 0, "conaffinity": 0}


def wheel_name(i: int) -> str:
    """Return the body and geom name of wheel `i`, counted from 0."""
    return f"wheel{i + 1}"


def build_mujoco_model(robot: SingularityDescription, layout: BuiltLayout | None = None) -> Any:
    """Build solid bodies of `robot`, with the modules at a `layout`, by default as described.

    The chassis is a disc that extends to the farthest pivot, each gimbal frame a rod between its
    bearings, each wheel half a hollow sphere. Joint names match the kinematics. Servos have the
    damping of gear motors, and their driving torques are applied externally. The floor supports
    only the wheels, without friction; patch friction is also applied externally, see
    `patch_friction`.
    """
    mujoco = load_mujoco()
    if layout is None:
        layout = BuiltLayout.of(robot.kinematics(), BuildErrors(), (), 0)
    spec = mujoco.MjSpec()
    slope_rad = np.radians(robot.errors.slope_deg)
    downhill = float(layout.downhill_rad)
    along, down = GRAVITY_MPS2 * np.sin(slope_rad), GRAVITY_MPS2 * np.cos(slope_rad)
    spec.option.gravity = [along * np.cos(downhill), along * np.sin(downhill), -down]
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    geometry, mass = robot.drive, robot.mass
    floor = spec.worldbody.add_geom(name=FLOOR, size=[100.0, 100.0, 1.0], **_FREE)
    floor.type = mujoco.mjtGeom.mjGEOM_PLANE
    base = spec.worldbody.add_body(name="base", pos=[0.0, 0.0, geometry.wheel_radius_m])
    base.add_freejoint()
    plate = base.add_geom(
        size=[float(np.max(geometry.pivot_radii_m)), _PLATE_HEIGHT_M / 2.0, 0.0], **_FREE
    )
    plate.type = mujoco.mjtGeom.mjGEOM_CYLINDER
    plate.mass = mass.total_kg - geometry.modules * (mass.wheel_kg + 2.0 * mass.gimbal_kg)
    for i in range(geometry.modules):
        _add_module(base, i, robot, layout)
        pair = spec.add_pair(geomname1=FLOOR, geomname2=wheel_name(i), condim=1)
        pair.solref = [_CONTACT_S, 1.0]
    return spec.compile()


def _add_module(base: Any, i: int, robot: SingularityDescription, layout: BuiltLayout) -> None:
    """Add a wheel on two gimbal frames; Y of a module is radially outward."""
    geometry, mass = robot.drive, robot.mass
    radius = geometry.wheel_radius_m
    azimuth = float(np.radians(geometry.directions_deg[i]) + layout.turned_rad[i])
    half_turn = (azimuth - np.pi / 2.0) / 2.0
    outer = base.add_body(
        pos=[*(geometry.pivots_m[i] + layout.displaced_m[i]), 0.0],
        quat=[np.cos(half_turn), 0.0, 0.0, np.sin(half_turn)],
    )
    _add_servo(outer, f"module{i + 1}_beta", [0.0, 1.0, 0.0], robot)
    _add_frame(outer, [0.0, 1.2 * radius, 0.0], mass.gimbal_kg)
    inner = outer.add_body()
    _add_servo(inner, f"module{i + 1}_alpha", [-1.0, 0.0, 0.0], robot)
    _add_frame(inner, [radius, 0.0, 0.0], mass.gimbal_kg)
    wheel = inner.add_body(name=wheel_name(i))
    wheel.add_joint(name=f"module{i + 1}_wheel", axis=[0.0, 0.0, 1.0])
    # Half a hollow sphere has its centre of mass half a radius below the gimbal centre.
    across = mass.wheel_kg * radius**2 * (2.0 / 3.0 - 1.0 / 4.0)
    wheel.mass = mass.wheel_kg
    wheel.ipos = [0.0, 0.0, -radius / 2.0]
    wheel.inertia = [across, across, mass.wheel_kg * radius**2 * 2.0 / 3.0]
    wheel.explicitinertial = True
    wheel.add_geom(name=wheel_name(i), size=[radius, 0.0, 0.0], **_FREE)


def _add_servo(body: Any, name: str, axis: list[float], robot: SingularityDescription) -> None:
    """Add a gear motor: at full voltage, stall torque at rest and zero torque at no-load speed."""
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
    rod.type = load_mujoco().mjtGeom.mjGEOM_CAPSULE


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors (k, 3), four times as fast as `np.cross`."""
    (x, y, z), (u, v, w) = a.T, b.T
    out = np.empty(a.shape)
    out[:, 0], out[:, 1], out[:, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return out


Indices: TypeAlias = npt.NDArray[np.intp]


class MujocoSimulation:
    """Rigid-body simulation of a single robot in contact with the floor.

    Gimbal servos are proportionally controlled gear motors with the described stall torque and
    no-load speed: without load they obey the law of `Servos`, under load they deflect. Motors have
    the described time constants and the torques that these require. MuJoCo computes wheel loads,
    gyroscopic torques and all motion. Its own friction is unused, because its contact model lifts
    wheels that spin in place off the floor.
    """

    def __init__(
        self,
        robot: SingularityDescription,
        batch: tuple[int, ...] = (),
        *,
        pose: SE2 | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        if batch:
            raise ValueError(f"rigid bodies are simulated one robot at a time, not {batch}")
        self.actuation = Actuation(robot, batch, **options)
        self.kinematics = self.actuation.kinematics
        servos = self.actuation.servos
        self._robot = robot
        self._set_supply()
        self._mujoco = load_mujoco()
        self._model: Any = build_mujoco_model(robot, self.actuation.layout)
        self._data: Any = self._mujoco.MjData(self._model)
        self._angles_q, self._angles_v = self._addresses(self.actuation.angles)
        _, self._wheels_v = self._addresses(self.actuation.wheels)
        names = [wheel_name(i) for i in range(robot.drive.modules)]
        # Friction balances the motor torque at the edge of the dead band.
        self._model.dof_frictionloss[self._angles_v] = (
            self._stall_nm * self._gain_per_rad * servos.dead_band_rad
        )
        self._bodies = np.array([self._model.body(name).id for name in names])
        self._roots = self._model.body_rootid[self._bodies]
        self._wheel_of_geom = np.zeros(self._model.ngeom, dtype=int)
        self._wheel_of_geom[[self._model.geom(name).id for name in names]] = range(len(names))
        self._spin_inertia = self._model.body_inertia[self._bodies, 2]
        self._radius_m = robot.drive.wheel_radius_m
        self._remainder_s = 0.0
        self._place(SE2(np.zeros(3)) if pose is None else pose)

    @property
    def pose(self) -> SE2:
        """True pose in the world."""
        x, y = self._data.qpos[:2]
        a, b, c, d = self._data.qpos[3:7]
        heading = np.arctan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))
        return SE2(np.array([x, y, heading]))

    @property
    def joints(self) -> Array:
        """(n,): true joint vector."""
        joints = np.empty(len(self.kinematics.joints))
        joints[self.actuation.angles] = self._data.qpos[self._angles_q]
        joints[self.actuation.wheels] = self._data.qvel[self._wheels_v]
        return joints

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of all actuators, as in `Actuation.command`."""
        self.actuation.command(setpoint)

    def degrade(self, shares: Array) -> None:
        """Slow down joints, as in `Actuation.degrade`."""
        self.actuation.degrade(shares)
        self._set_supply()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.actuation.set_battery(battery_v)
        self._set_supply()

    def _set_supply(self) -> None:
        """Compute servo torque and gain from the battery voltage and servo degradation."""
        actuation, robot = self.actuation, self._robot
        share = float(actuation.battery_v.mean()) / robot.battery.nominal_v
        self._stall_nm = robot.servo.stall_torque_nm * share * actuation.servo_shares
        # Near the goal, full voltage times gain times error yields the servo's speed.
        self._gain_per_rad = (
            actuation.servos.approach_rate_per_s / actuation.servos.speed_limit_rad_per_s
        )

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` in MuJoCo steps; the remainder is kept for the next call."""
        timestep_s = self._model.opt.timestep
        self._remainder_s += dt_s
        # Sums of hundredths are slightly too small.
        steps = int(self._remainder_s / timestep_s + 1e-6)
        self._remainder_s -= steps * timestep_s
        for _ in range(steps):
            self._step(timestep_s)

    def measure(self) -> Array:
        """Return the joint vector (n,) as in `Actuation.measure`."""
        return self.actuation.measure(self.joints)

    def twist(self) -> Array:
        """Return the true twist (3,) in the body frame."""
        velocity = self.pose.inverse().rotate(self._data.qvel[:2].copy())
        return np.array([*velocity, self._data.qvel[5]])

    def hardware_status(self) -> dict[str, object]:
        """Return the actuator status and friction parameters of the floor."""
        return self.actuation.hardware_status() | {
            "plant": "mujoco",
            "friction": self._robot.floor.friction,
        }

    def _addresses(self, joints: Indices) -> tuple[Indices, Indices]:
        """Return MuJoCo's position and velocity addresses of some of the drive's joints."""
        names = [self.actuation.kinematics.joints[int(i)].name for i in joints]
        found = [self._model.joint(name) for name in names]
        q, v = zip(*((int(one.qposadr[0]), int(one.dofadr[0])) for one in found), strict=True)
        return np.array(q), np.array(v)

    def _place(self, pose: SE2) -> None:
        x, y, heading = pose.xy_heading
        self._data.qpos[:2] = x, y
        self._data.qpos[3:7] = np.cos(heading / 2.0), 0.0, 0.0, np.sin(heading / 2.0)
        self._data.qpos[self._angles_q] = self.actuation.zero_rad
        self._mujoco.mj_forward(self._model, self._data)

    def _step(self, dt_s: float) -> None:
        actuation, data = self.actuation, self._data
        actuation.controllers.advance(dt_s)
        error = actuation.goals - data.qpos[self._angles_q]
        voltage = np.minimum(np.maximum(self._gain_per_rad * error, -1.0), 1.0)
        data.qfrc_applied[self._angles_v] = self._stall_nm * self._through_backlash(voltage, dt_s)
        speeds = data.qvel[self._wheels_v]
        wanted = actuation.motors.after(speeds, actuation.speed_goals, np.array(dt_s)) - speeds
        data.qfrc_applied[self._wheels_v] = self._spin_inertia * wanted / dt_s
        self._apply_friction()
        self._mujoco.mj_step(self._model, data)

    def _through_backlash(self, voltage: Array, dt_s: float) -> Array:
        """Return servo voltages, zero for servos whose motor is inside its backlash.

        A motor without contact instantly reaches the speed for its voltage.
        """
        actuation, edge_rad = self.actuation, 0.5 * self.actuation.servos.backlash_rad
        ahead = actuation.servos.speed_limit_rad_per_s * voltage - self._data.qvel[self._angles_v]
        ahead_rad = actuation.backlash_rad + ahead * dt_s
        actuation.backlash_rad = np.minimum(np.maximum(ahead_rad, -edge_rad), edge_rad)
        return voltage * (np.copysign(edge_rad, voltage) == actuation.backlash_rad)

    def _apply_friction(self) -> None:
        """Apply floor friction to the wheels, with the loads of the last step."""
        data, bodies = self._data, self._bodies
        velocity, turning = data.cvel[bodies, 3:], data.cvel[bodies, :3]
        contact = data.xpos[bodies].copy()
        contact[:, 2] -= self._radius_m + self.actuation.surface.outside_m(self.joints)
        lever = contact - data.subtree_com[self._roots]
        slip = (velocity + _cross(turning, lever))[:, :2]
        force, torque = patch_friction(self._robot.floor, self.loads(), slip, turning[:, 2])
        forces = np.zeros(contact.shape)
        forces[:, :2] = force
        arm = contact - data.xipos[bodies]
        data.xfrc_applied[bodies, :3] = forces
        data.xfrc_applied[bodies, 3:] = _cross(arm, forces)
        data.xfrc_applied[bodies, 5] += torque

    def loads(self) -> Array:
        """Return the normal force on each wheel (k,), newtons; 0 in the air."""
        contact, loads = self._data.contact, np.zeros(len(self._bodies))
        bears = contact.efc_address >= 0
        wheels = self._wheel_of_geom[contact.geom2[bears]]
        loads[wheels] = self._data.efc_force[contact.efc_address[bears]]
        return loads
