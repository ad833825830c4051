"""A singularity drive whose motion comes from MuJoCo: mass, torque, load and slip."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim.actuation import Actuation
from tsd_twin.sim.contact_model import contact_model, wheel_name
from tsd_twin.sim.contact_patch import ContactPatch
from tsd_twin.sim.engine import engine

Indices: TypeAlias = npt.NDArray[np.intp]


class ContactSimulation:
    """One robot of rigid bodies in contact with the floor, instead of wheels that only roll.

    Gimbal servos are proportional controllers of gear motors with the stall torque and no-load
    speed of the description, so without load they obey the law of `Servos`; under load they give
    way. Motors have the time constants of the description and what torque these take. Load on each
    wheel, gyroscopic torques and everything that moves are MuJoCo's. Its own friction is not used:
    for wheels that spin on the spot its contact model lifts the robot off the floor.
    """

    def __init__(
        self,
        robot: SingularityRobot,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SE2 | None = None,
        patch: ContactPatch | None = None,
    ) -> None:
        if batch:
            raise ValueError(f"rigid bodies are simulated one robot at a time, not {batch}")
        self.actuation = Actuation(robot, batch, seed, noise, battery_v)
        self.drive = self.actuation.drive
        floor = robot.floor
        self._patch = patch or ContactPatch(floor.friction, floor.patch_radius_m)
        servos = self.actuation.servos
        share = float(self.actuation.battery_v.mean()) / robot.battery.nominal_v
        self._stall_nm = robot.servo.stall_torque_nm * share
        # Near the goal, full voltage times the gain times the error settles at the servo's speed.
        self._gain_per_rad = servos.approach_rate_per_s / servos.speed_limit_rad_per_s
        self._mujoco = engine()
        self._model: Any = contact_model(robot)
        self._data: Any = self._mujoco.MjData(self._model)
        self._angles_q, self._angles_v = self._addresses(self.actuation.angles)
        _, self._wheels_v = self._addresses(self.actuation.wheels)
        names = [wheel_name(i) for i in range(robot.drive.modules)]
        # What friction leaves of the voltage at the edge of the dead band: nothing.
        self._model.dof_frictionloss[self._angles_v] = (
            self._stall_nm * self._gain_per_rad * servos.dead_band_rad
        )
        self._bodies = np.array([self._model.body(name).id for name in names])
        self._wheel_of_geom = np.zeros(self._model.ngeom, dtype=int)
        self._wheel_of_geom[[self._model.geom(name).id for name in names]] = range(len(names))
        self._spin_inertia = self._model.body_inertia[self._bodies, 2]
        self._radius_m = robot.drive.wheel_radius_m
        self._left_s = 0.0
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
        joints = np.empty(len(self.drive.joints))
        joints[self.actuation.angles] = self._data.qpos[self._angles_q]
        joints[self.actuation.wheels] = self._data.qvel[self._wheels_v]
        return joints

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, as `Actuation.command` takes them."""
        self.actuation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass, in steps of MuJoCo; what is less than one is left for later."""
        timestep_s = self._model.opt.timestep
        self._left_s += dt_s
        # Sums of hundredths are a little less than they should be.
        steps = int(self._left_s / timestep_s + 1e-6)
        self._left_s -= steps * timestep_s
        for _ in range(steps):
            self._step(timestep_s)

    def measure(self) -> Array:
        """Return the joint vector (n,) as `Actuation.measure` has it."""
        return self.actuation.measure(self.joints)

    def twist(self) -> Array:
        """Return the true twist (3,) in the body frame."""
        velocity = self.pose.inverse().rotate(self._data.qvel[:2].copy())
        return np.array([*velocity, self._data.qvel[5]])

    def facts(self) -> dict[str, object]:
        """Return what the actuators say, and what the floor is like."""
        return self.actuation.facts() | {"plant": "mujoco", "friction": self._patch.friction}

    def _addresses(self, joints: Indices) -> tuple[Indices, Indices]:
        """Return where MuJoCo keeps positions and velocities of some of the drive's joints."""
        names = [self.actuation.drive.joints[int(i)].name for i in joints]
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
        voltage = np.clip(self._gain_per_rad * error, -1.0, 1.0)
        data.qfrc_applied[self._angles_v] = self._stall_nm * self._through_play(voltage, dt_s)
        speeds = data.qvel[self._wheels_v]
        wanted = actuation.motors.after(speeds, actuation.speed_goals, np.array(dt_s)) - speeds
        data.qfrc_applied[self._wheels_v] = self._spin_inertia * wanted / dt_s
        self._rub()
        self._mujoco.mj_step(self._model, data)

    def _through_play(self, voltage: Array, dt_s: float) -> Array:
        """Return what is left of the voltages of servos whose motors may be crossing their play.

        A motor that touches nothing turns at the speed its voltage gives, at once.
        """
        actuation, edge_rad = self.actuation, 0.5 * self.actuation.servos.backlash_rad
        ahead = actuation.servos.speed_limit_rad_per_s * voltage - self._data.qvel[self._angles_v]
        actuation.play_rad = np.clip(actuation.play_rad + ahead * dt_s, -edge_rad, edge_rad)
        return voltage * (np.copysign(edge_rad, voltage) == actuation.play_rad)

    def _rub(self) -> None:
        """Apply the friction of the floor to the wheels, under the load of the last step."""
        data, bodies = self._data, self._bodies
        velocity, turning = data.cvel[bodies, 3:], data.cvel[bodies, :3]
        contact = data.xpos[bodies].copy()
        contact[:, 2] -= self._radius_m + self.actuation.surface.outside_m(self.joints)
        lever = contact - data.subtree_com[self._model.body_rootid[bodies]]
        slip = (velocity + np.cross(turning, lever))[:, :2]
        force, torque = self._patch.force(self._loads(), slip, turning[:, 2])
        forces = np.column_stack([force, np.zeros(len(force))])
        arm = contact - data.xipos[bodies]
        data.xfrc_applied[bodies, :3] = forces
        data.xfrc_applied[bodies, 3:] = np.cross(arm, forces)
        data.xfrc_applied[bodies, 5] += torque

    def _loads(self) -> Array:
        """Return the normal force on each wheel (k,), newtons; 0 in the air."""
        contact, loads = self._data.contact, np.zeros(len(self._bodies))
        bears = contact.efc_address >= 0
        wheels = self._wheel_of_geom[contact.geom2[bears]]
        loads[wheels] = self._data.efc_force[contact.efc_address[bears]]
        return loads
