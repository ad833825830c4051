"""The solid robots: one batched node for each kind of link, for all robots of a description."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard.layers import robot_node
from tsd_twin.dashboard.shape import Shape
from tsd_twin.description import Link
from tsd_twin.lie import SE2, SO3, Array


class FleetMeshes:
    """Robots of one description; their poses are computed and sent together.

    Twenty robots cost as many messages as one, and as many draw calls. The nodes hang on the first
    robot: browsers apply poses of nodes in the frame they come in, and poses of instances later, so
    a robot that is alone does not lag behind its own arrows and rings.
    """

    def __init__(self, scene: viser.SceneApi, shape: Shape) -> None:
        self.shape = shape
        self._scene = scene
        self._ids: list[str] = []
        self._handles: dict[Link, viser.BatchedGlbHandle] = {}
        self._shown: dict[tuple[Link, str], bytes] = {}
        self._bases = np.zeros((0, 3))
        self._balls = np.zeros((0, 4))
        self._angles = np.zeros((0, len(shape.drive.joints)))
        self._moved = False

    @property
    def ids(self) -> tuple[str, ...]:
        """The robots, in the order of their instances."""
        return tuple(self._ids)

    def node(self, kind: Link) -> str:
        """Return the name of the node that has all links of a kind."""
        return f"{robot_node(self._ids[0])}/m{kind}"

    def add(self, robot_id: str) -> None:
        """Show another robot: at the origin, upright, until it is placed."""
        self._ids.append(robot_id)
        self._bases = np.vstack([self._bases, np.zeros(3)])
        self._balls = np.vstack([self._balls, SO3.identity().wxyz])
        self._angles = np.vstack([self._angles, np.zeros(len(self.shape.drive.joints))])
        self._moved = True
        self.send()

    def remove(self, robot_id: str) -> None:
        """Show a robot no longer."""
        row = self._ids.index(robot_id)
        self._ids.pop(row)
        if row == 0:
            self._clear()
        self._bases, self._balls, self._angles = (
            np.delete(rows, row, axis=0) for rows in (self._bases, self._balls, self._angles)
        )
        self._moved = True
        self.send()

    def place(self, robot_id: str, base: Array, ball: SO3, angles_rad: Array) -> None:
        """Note where a robot is: pose (3,), turn of its ball if any, angles of its joints (n,)."""
        row = self._ids.index(robot_id)
        self._bases[row], self._balls[row] = base, ball.wxyz
        self._angles[row] = angles_rad
        self._moved = True

    def send(self) -> None:
        """Send what has been noted; what has not changed is not sent."""
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
                # viser would find out as well, and take much longer over it.
                if self._is_new(kind, "wxyz", wxyz):
                    self._handles[kind].batched_wxyzs = wxyz
                if self._is_new(kind, "position", position):
                    self._handles[kind].batched_positions = position
            else:
                self._handles[kind] = self._scene.add_batched_glb(
                    self.node(kind), data, wxyz, position, lod="off"
                )

    def _is_new(self, kind: Link, what: str, values: npt.NDArray[np.float32]) -> bool:
        said = values.tobytes()
        new = self._shown.get((kind, what)) != said
        self._shown[kind, what] = said
        return new

    def _clear(self) -> None:
        for handle in self._handles.values():
            handle.remove()
        self._handles.clear()
        self._shown.clear()

    def scales_without(self, robot_id: str | None, kind: Link) -> Array:
        """Return scales (instances of `kind`,) that hide one robot, or none: 0 for it, else 1."""
        shown = np.array([0.0 if other == robot_id else 1.0 for other in self._ids])
        return np.repeat(shown, self.shape.count(kind))
