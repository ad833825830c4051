"""Exaggeration of the tilt in one client's scene: its gimbals are drawn with a multiple of it.

At 2,500 rpm a robot drives with tilts of 2 to 6 degrees, which a picture of it hardly shows. The
links of the shown robot are hidden for this client, and drawn again with the larger tilt.
"""

from __future__ import annotations

import math

import numpy as np
import viser

from tsd_twin.dashboard.scene.appearance import Layer, overlay_node, robot_node
from tsd_twin.dashboard.scene.robot_overlays import SetpointRings
from tsd_twin.dashboard.scene.robot_visual import RobotVisual
from tsd_twin.dashboard.scene.view_settings import TiltFactor
from tsd_twin.dashboard.viser_compat.viser_server import scale_instances
from tsd_twin.lie import SE2, Array
from tsd_twin.models import Link

MOST_TILT_RAD = math.radians(75.0)
"""No axle is drawn with more tilt than this, unless it has more."""
_LABEL_HEIGHT_M = 0.05


def exaggerate_tilt(joints: Array, factor: float) -> Array:
    """Joints (3k,) whose axles lean in the same directions, `factor` times as far.

    For each module alpha, beta and a number that stays, as in the joint vector of the drive.
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


def hide_links(client: viser.ClientHandle, body: RobotVisual, robot_id: str | None) -> None:
    """Hide the moving links of one robot for a client; None shows those of all."""
    for kind in body.meshes.shape.moving:
        scales = body.meshes.scales_without(robot_id, kind)
        scale_instances(client, body.meshes.node(kind), scales)


class ExaggeratedTilt:
    """Gimbals and set-point rings of one robot in one client's scene, with more tilt."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.factor = TiltFactor.TRUE
        self._client = client
        self._links: dict[Link, viser.BatchedGlbHandle] = {}
        self._rings: SetpointRings | None = None

    def is_on(self, body: RobotVisual | None) -> bool:
        """Return whether this robot is drawn with another tilt than it has."""
        return (
            self.factor is not TiltFactor.TRUE
            and body is not None
            and bool(body.meshes.shape.tilts)
        )

    def applied(self, joints: Array) -> Array:
        """Return a joint vector (n,) of a robot with gimbals as it is drawn."""
        return exaggerate_tilt(joints, self.factor.number)

    def start(self, body: RobotVisual, *, rings: bool) -> None:
        """Create the nodes of this client, once its other ones have been reset."""
        self._links.clear()
        scene, node = self._client.scene, robot_node(body.id)
        shape = body.meshes.shape
        scene.add_label(
            f"{node}/ql",
            f"tilt drawn {self.factor}",
            position=(0.0, 0.0, shape.height_m + _LABEL_HEIGHT_M),
            anchor="bottom-center",
        )
        if rings:  # Otherwise the shared ones, which show the true tilt, are hidden already.
            scene.add_frame(overlay_node(Layer.SETPOINT, body.id), show_axes=False, visible=False)
            self._rings = SetpointRings(scene, f"{node}/qs", shape)
        self.update(body)
        hide_links(self._client, body, body.id)

    def update(self, body: RobotVisual) -> None:
        """Draw the joints of a robot anew."""
        shape = body.meshes.shape
        poses = shape.skeleton.poses(SE2.identity(), body.ball, self.applied(body.angles))
        for kind in shape.moving:
            if kind in self._links:
                self._links[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
                self._links[kind].batched_positions = poses[kind].position.astype(np.float32)
            else:
                self._links[kind] = self._client.scene.add_batched_glb(
                    f"{robot_node(body.id)}/q{kind}", shape.glbs[kind], *poses[kind], lod="off"
                )
        if self._rings is not None and body.overlays.setpoint is not None:
            self._rings.update(self.applied(body.overlays.setpoint.shown))

    def set_visible(self, visible: bool) -> None:
        """Show or hide the gimbals; a preview takes their place."""
        for handle in self._links.values():
            handle.visible = visible

    def clear(self) -> None:
        """Forget the nodes of this client."""
        self._links.clear()
        self._rings = None
