"""Visual of a robot: batched link meshes, joint angles and pose from the latest state.

The tilt of the gimbals can be exaggerated for individual clients.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.client.monitor import RobotMonitor, Snapshot
from tsd_twin.client.motions import kinematics_in_force
from tsd_twin.dashboard.scene.appearance import robot_node
from tsd_twin.dashboard.scene.robot_geometry import JointReader, RobotShape, commanded_joints
from tsd_twin.dashboard.scene.robot_overlays import (
    NO_PREDICTION,
    MotionPredictor,
    Prediction,
    RobotOverlays,
)
from tsd_twin.dashboard.scene.themed import RateLimiter
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.modes import Mode
from tsd_twin.models import Link
from tsd_twin.recording.player import RecordedRobot


class BatchedRobotMeshes:
    """Batched meshes of all robots of a description; poses are computed and sent together.

    The number of messages and draw calls does not depend on the number of robots. The nodes are
    children of the first robot, because browsers apply node poses in the same frame but instance
    poses later; this way a single robot does not lag behind its arrows and rings.
    """

    def __init__(self, scene: viser.SceneApi, shape: RobotShape) -> None:
        self.shape = shape
        self._scene = scene
        self._ids: list[str] = []
        self._handles: dict[Link, viser.BatchedGlbHandle] = {}
        self._shown: dict[tuple[Link, str], bytes] = {}
        self._bases = np.zeros((0, 3))
        self._balls = np.zeros((0, 4))
        self._angles = np.zeros((0, len(shape.joints)))
        self._moved = False

    def node(self, kind: Link) -> str:
        """Return the name of the node with all links of a kind."""
        return f"{robot_node(self._ids[0])}/m{kind}"

    def add(self, robot_id: str) -> None:
        """Add a robot, at the origin and upright until it is placed."""
        self._ids.append(robot_id)
        self._bases = np.vstack([self._bases, np.zeros(3)])
        self._balls = np.vstack([self._balls, SO3.identity().wxyz])
        self._angles = np.vstack([self._angles, np.zeros(len(self.shape.joints))])
        self._moved = True
        self.send()

    def remove(self, robot_id: str) -> None:
        """Remove a robot."""
        row = self._ids.index(robot_id)
        self._ids.pop(row)
        if row == 0:
            for handle in self._handles.values():
                handle.remove()
            self._handles.clear()
            self._shown.clear()
        self._bases, self._balls, self._angles = (
            np.delete(rows, row, axis=0) for rows in (self._bases, self._balls, self._angles)
        )
        self._moved = True
        self.send()

    def place(self, robot_id: str, base: Array, ball: SO3, angles_rad: Array) -> None:
        """Set a robot's pose (3,), orientation of its sphere if any, and joint angles (n,)."""
        row = self._ids.index(robot_id)
        self._bases[row], self._balls[row] = base, ball.wxyz
        self._angles[row] = angles_rad
        self._moved = True

    def send(self) -> None:
        """Send the poses that have changed."""
        if not self._moved:
            return
        self._moved = False
        if not self._ids:
            return
        bases = SE2(self._bases[0]).inverse() @ SE2(self._bases)
        every = self.shape.skeleton.poses(bases, SO3(self._balls), self._angles)
        for kind, data in self.shape.glbs.items():
            wxyz = every[kind].wxyz.reshape(-1, 4).astype(np.float32)
            position = every[kind].position.reshape(-1, 3).astype(np.float32)
            if kind in self._handles:
                # viser also detects this, but takes much longer.
                if self._is_new(kind, "wxyz", wxyz):
                    self._handles[kind].batched_wxyzs = wxyz
                if self._is_new(kind, "position", position):
                    self._handles[kind].batched_positions = position
            else:
                self._handles[kind] = self._scene.add_batched_glb(
                    self.node(kind), data, wxyz, position, lod="off"
                )

    def _is_new(self, kind: Link, what: str, values: npt.NDArray[np.float32]) -> bool:
        data = values.tobytes()
        new = self._shown.get((kind, what)) != data
        self._shown[kind, what] = data
        return new

    def scales_without(self, robot_id: str | None, kind: Link) -> Array:
        """Return scales (instances of `kind`,) that hide a robot: 0 for the robot, else 1."""
        shown = np.array([0.0 if other == robot_id else 1.0 for other in self._ids])
        return np.repeat(shown, self.shape.count(kind))


SPIN_SLOWDOWN = 50
"""Wheels on gimbals are drawn this much slower: 2500 rpm as 50 rpm, 5 degrees per frame. At true
speed, a display at 60 Hz would show them creep, stop or turn backwards. Rolling wheels are drawn at
true speed.
"""
PREDICTION_HZ = 10.0
"""Rate of predictions, which take 1 to 2 ms each."""
_MAX_STATE_GAP_S = 0.1
"""After a longer gap between states, the wheels are not turned."""


VisualSource: TypeAlias = RobotMonitor | RecordedRobot
"""Source of a robot's description and latest state."""


class RobotVisual:
    """Visual of a robot: meshes, overlays and motion prediction."""

    def __init__(
        self,
        link: VisualSource,
        meshes: BatchedRobotMeshes,
        overlays: RobotOverlays,
        tilt: TiltFactor = TiltFactor.TRUE,
    ) -> None:
        """`tilt` is the exaggeration for clients that do not choose another."""
        self.id = link.id
        self.tilt = tilt
        self.link = link
        self.meshes = meshes
        self.overlays = overlays
        self.drawn = Snapshot()
        self.joints = link.kinematics.inverse(np.zeros(3))
        """Joint vector (n,)."""
        self.angles = np.zeros(len(meshes.shape.joints))
        """All drawn joints: angles of gimbals, and rotation of wheels."""
        self.pose = np.zeros(3)
        """Pose of the base (3,); the origin, if it does not move."""
        self.ball = SO3.identity()
        """Orientation of the sphere, if any."""
        self._turned_s = -np.inf
        self._values: tuple[Any, ...] = ()
        self._changed_s = np.inf
        self._settled = False
        # Spheres do not move, and some robots do not guarantee their braking.
        predictable = link.kinematics.pose_type is SE2 and not link.robot.not_promised
        self._predictor = MotionPredictor(link.kinematics, link.robot) if predictable else None
        self._prediction_rate = RateLimiter(PREDICTION_HZ)
        self._reader = JointReader(meshes.shape.joints)
        self._setpoint_reader = JointReader(link.kinematics.joints)
        self._slowdown = SPIN_SLOWDOWN if meshes.shape.tilts else 1

    @property
    def is_outdated(self) -> bool:
        """Whether the latest data is not drawn yet."""
        return self.link.snapshot is not self.drawn

    @property
    def _rests(self) -> bool:
        """Whether the robot does not drive and no joint turns, as far as it is measured."""
        joints, status = self.drawn.joints, self.drawn.status
        if status is not None and status.mode in (Mode.DRIVING, Mode.STOPPING):
            return False
        return joints is None or not np.nan_to_num(joints.velocity_rad_per_s).any()

    @property
    def setpoint(self) -> Array | None:
        """Commanded joints (n,) of the drawn snapshot, if it has any."""
        said = self.drawn.setpoint
        return None if said is None else self._setpoint_reader.vector(said)

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics at the reported wheel speed."""
        link = self.link
        return kinematics_in_force(link.robot, link.kinematics, link.snapshot.status)

    def tilted(self, joints: Array, tilt: TiltFactor) -> Array:
        """Return drive joints, or all drawn ones, with the tilt of gimbals exaggerated."""
        if not self.meshes.shape.tilts or tilt is TiltFactor.TRUE:
            return joints
        drive = len(self.joints)
        return np.concatenate([exaggerate_tilt(joints[:drive], tilt.number), joints[drive:]])

    def update(self) -> None:
        """Update with the latest snapshot."""
        new, old = self.link.snapshot, self.drawn
        self.drawn = new
        values = _values(new)
        if values != self._values:
            self._values, self._changed_s, self._settled = values, new.received_s, False
        elif self._settled:
            return
        else:  # This update draws everything.
            self._settled = self._rests and new.received_s - self._changed_s > _SETTLED_S
        if new.odom is not None:
            if new.odom.wxyz is None:
                self.pose = new.odom.xy_heading
            else:
                self.ball = SO3(new.odom.wxyz)
        if new.joints is not None and new.joints is not old.joints:
            # Joints that are no longer measured keep their values.
            before = np.where(self.meshes.shape.rolls, 0.0, self.angles)
            joints = self._reader.vector(new.joints, before)
            if joints is not None:
                self._turn_wheels(joints, new.received_s)
        self.meshes.place(self.id, self.pose, self.ball, self.tilted(self.angles, self.tilt))
        self.overlays.update(new, old, self.joints, lambda joints: self.tilted(joints, self.tilt))
        if self._predictor is not None and self._prediction_rate.is_due(new.received_s):
            self.overlays.show_prediction(self._predict(self._predictor, new))

    def _predict(self, predictor: MotionPredictor, new: Snapshot) -> Prediction:
        setpoint = self._setpoint_reader.vector(new.setpoint) if new.setpoint else None
        if setpoint is None:
            return NO_PREDICTION
        setpoint = commanded_joints(self.link.kinematics, setpoint, self.joints)
        return predictor.predict(new, setpoint, self.link.sent_commands, self.link.round_trips)

    def _turn_wheels(self, joints: Array, now_s: float) -> None:
        dt_s, self._turned_s = now_s - self._turned_s, now_s
        self.joints = joints[: len(self.joints)]
        seen_s = dt_s / self._slowdown if dt_s < _MAX_STATE_GAP_S else 0.0
        turned = np.remainder(self.angles + joints * seen_s, 2.0 * np.pi)
        self.angles = np.where(self.meshes.shape.rolls, turned, joints)


_SETTLED_S = 0.5
"""Time without changes after which all overlays are drawn, whose rates are limited."""


def _values(snapshot: Snapshot) -> tuple[Any, ...]:
    """Return the drawn values of a snapshot, to detect changes; most robots of a fleet rest."""
    status = snapshot.status
    shown = None if status is None else (status.mode, status.consistency.suspect)
    return shown, snapshot.motion_key()


MOST_TILT_RAD = math.radians(75.0)
"""Maximum displayed tilt of an axle, unless its true tilt is larger."""


def exaggerate_tilt(joints: Array, factor: float) -> Array:
    """Return joints (3k,) with axles tilted in the same directions, `factor` times as far.

    Each module has alpha, beta and an unchanged value, as in the drive's joint vector.
    """
    modules = joints.reshape(-1, 3).copy()
    alpha, beta = modules[:, 0], modules[:, 1]
    across, outward = np.cos(alpha) * np.sin(beta), np.sin(alpha)
    sine = np.hypot(across, outward)
    tilt = np.arctan2(sine, np.cos(alpha) * np.cos(beta))
    larger = np.maximum(tilt, np.minimum(factor * tilt, MOST_TILT_RAD))
    scale = np.sin(larger) / np.where(sine > 0.0, sine, 1.0)
    modules[:, 0] = np.arcsin(np.clip(scale * outward, -1.0, 1.0))
    modules[:, 1] = np.arctan2(scale * across, np.cos(larger))
    return modules.ravel()
