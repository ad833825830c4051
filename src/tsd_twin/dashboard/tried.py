"""What one client tries out: joints as they would be, in its own picture alone."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.arrows import HEAD_M, SLOWEST_MPS, arrows
from tsd_twin.dashboard.body import Body
from tsd_twin.dashboard.layers import robot_node
from tsd_twin.dashboard.viser_private import scale_instances
from tsd_twin.description import Link
from tsd_twin.drives import JointKind
from tsd_twin.lie import SE2, Array


class Tried:
    """Gimbals that are posed; of wheels that only roll, arrows tell which way and how fast."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._links: dict[Link, viser.BatchedGlbHandle] = {}
        self._arrows: viser.ArrowsHandle | None = None

    def draw(self, body: Body, joints: Array | None) -> None:
        """Show what a joint vector (n,) would do; None: what is."""
        if not body.meshes.shape.tilts:
            self._point(body, joints)
        elif joints is not None:
            self._pose(body, joints)
        elif self._links:
            for handle in self._links.values():
                handle.visible = False
            self._hide(body, None)

    def forget(self, body: Body) -> None:
        """The nodes of this client are gone: show the links of a robot again."""
        if self._links:
            self._hide(body, None)

    def clear(self) -> None:
        """The nodes of this client are gone."""
        self._links.clear()
        self._arrows = None

    def _point(self, body: Body, joints: Array | None) -> None:
        if self._arrows is not None:
            self._arrows.remove()
            self._arrows = None
        if joints is None:
            return
        places, velocities = body.meshes.shape.skeleton.contacts(joints)
        speeds = np.linalg.norm(velocities, axis=-1)
        fast = speeds >= SLOWEST_MPS
        if fast.any():
            self._arrows = self._client.scene.add_arrows(
                f"{robot_node(body.id)}/pa",
                arrows(places[fast], velocities[fast], speeds[fast]),
                palette.PREVIEW,
                shaft_radius=0.005,
                head_radius=0.013,
                head_length=HEAD_M,
            )

    def _pose(self, body: Body, joints: Array) -> None:
        shape = body.meshes.shape
        wheels = np.array([joint.kind is JointKind.VELOCITY for joint in shape.drive.joints])
        angles = np.where(wheels, body.angles, joints)
        poses = shape.skeleton.poses(SE2.identity(), body.ball, angles)
        for kind in shape.moving:
            if kind not in self._links:
                self._links[kind] = self._client.scene.add_batched_glb(
                    f"{robot_node(body.id)}/p{kind}",
                    shape.tinted(kind, palette.PREVIEW),
                    *poses[kind],
                    lod="off",
                )
            self._links[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
            self._links[kind].visible = True
        self._hide(body, body.id)

    def _hide(self, body: Body, robot_id: str | None) -> None:
        """Let this client not see the moving links of one robot, or see those of all."""
        for kind in body.meshes.shape.moving:
            scales = body.meshes.scales_without(robot_id, kind)
            scale_instances(self._client, body.meshes.node(kind), scales)
