"""All that is drawn about one robot beside its solid parts."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.arrows import ThrustArrows
from tsd_twin.dashboard.ellipse import CovarianceEllipse
from tsd_twin.dashboard.envelope import StopEnvelope
from tsd_twin.dashboard.foresight import Outlook
from tsd_twin.dashboard.ghosts import PoseGhost, PredictedGhost, SetpointGhost, place
from tsd_twin.dashboard.layers import OTHERS, ROUTES, TRAILS, TRUTHS, Layer, mark_node, robot_node
from tsd_twin.dashboard.link import Snapshot
from tsd_twin.dashboard.pointing import OnClick, add_target
from tsd_twin.dashboard.poses import JointReader
from tsd_twin.dashboard.route_line import RouteLine
from tsd_twin.dashboard.shape import Shape
from tsd_twin.dashboard.suspect import SuspectMark
from tsd_twin.dashboard.trail import Trail
from tsd_twin.lie import Array


class RobotMarks:
    """Ghosts, trail, arrows, ellipse, envelope, heading and cover of one robot.

    What belongs to the robot hangs on one node that moves with it, so that it costs nothing while
    it only moves along.
    """

    def __init__(
        self, scene: viser.SceneApi, robot_id: str, shape: Shape, on_click: OnClick
    ) -> None:
        node, self._reader = robot_node(robot_id), JointReader(shape.drive)
        self._base = scene.add_frame(node, show_axes=False)
        self.setpoint = (
            SetpointGhost(scene, mark_node(Layer.SETPOINT, robot_id), shape)
            if shape.tilts
            else None
        )
        self.truth = PoseGhost(scene, f"{TRUTHS}/{robot_id}", shape, palette.TRUTH)
        self.other = PoseGhost(scene, f"{OTHERS}/{robot_id}", shape, palette.OTHER)
        self.trail = Trail(scene, f"{TRAILS}/{robot_id}")
        self.route = RouteLine(scene, f"{ROUTES}/{robot_id}", shape.reach_m)
        self.arrows = ThrustArrows(scene, mark_node(Layer.ARROWS, robot_id), shape.skeleton)
        self.ellipse = CovarianceEllipse(scene, mark_node(Layer.ELLIPSE, robot_id))
        self.predicted = PredictedGhost(scene, mark_node(Layer.PREDICTED, robot_id), shape)
        self.envelope = StopEnvelope(scene, mark_node(Layer.ENVELOPE, robot_id), shape.reach_m)
        if not shape.skeleton.has_ball:  # It stays where it is, whatever it does.
            _add_heading(scene, f"{node}/h", shape.reach_m)
        add_target(scene, f"{node}/x", shape, robot_id, on_click)
        self._suspect = SuspectMark(scene, f"{node}/j", shape)
        self._cover = _add_cover(scene, f"{node}/c", shape)
        self.label = scene.add_label(
            mark_node(Layer.LABELS, robot_id),
            robot_id,
            position=(0.0, 0.0, shape.height_m + 0.15),
            anchor="bottom-center",
            visible=False,
        )

    def set_stale(self, stale: bool) -> None:
        """Cover the robot in grey while nothing is known of it.

        The envelope stays: it is within it, if the link has died.
        """
        self._cover.visible = stale
        if stale:
            self.predicted.update(None)

    def foresee(self, outlook: Outlook) -> None:
        """Show what lies ahead."""
        self.predicted.update(outlook.ghost)
        self.envelope.update(outlook.path)

    def update(self, new: Snapshot, old: Snapshot, joints: Array) -> None:
        """Show what is in `new` and was not in `old`; `joints` (n,) are the newest measured."""
        moved = new.odom is not None and new.odom is not old.odom
        if new.odom is not None and moved and new.odom.wxyz is None:
            pose = new.odom.xy_heading
            place(self._base, pose)
            self.trail.update(pose[:2], new.received_s)
            self.ellipse.update(new.odom.pose_covariance, float(pose[2]), new.received_s)
        if new.joints is not old.joints:
            self.arrows.update(joints, new.received_s)
        if self.setpoint and new.setpoint is not None and new.setpoint is not old.setpoint:
            setpoint = self._reader.vector(new.setpoint)
            if setpoint is not None:
                self.setpoint.update(setpoint)
        if new.status is not None and new.status is not old.status:
            self._suspect.update(new.status)
        for ghost, said, before in (
            (self.truth, new.truth, old.truth),
            (self.other, new.other, old.other),
        ):
            if said is not None and new.odom is not None and said is not before:
                ghost.update(said, new.odom)

    def remove(self) -> None:
        """Draw nothing of it any more."""
        self.trail.clear()
        self.route.update(None)
        self.truth.remove()
        self.other.remove()
        self._base.remove()


def _add_cover(scene: viser.SceneApi, name: str, shape: Shape) -> viser.MeshHandle:
    """Add the hull of the robot in grey, a little larger than what it covers."""
    vertices, faces = shape.hull
    return scene.add_mesh_simple(
        name,
        1.04 * vertices,
        faces,
        color=palette.STALE,
        opacity=0.8,
        flat_shading=True,
        cast_shadow=False,
        receive_shadow=False,
        visible=False,
    )


def _add_heading(scene: viser.SceneApi, name: str, reach_m: float) -> None:
    """Add a flat arrow head on the floor, ahead of the robot."""
    near, far, half = reach_m + 0.02, reach_m + 0.07, 0.03
    vertices = np.array([[near, half, 0.004], [near, -half, 0.004], [far, 0.0, 0.004]])
    scene.add_mesh_simple(
        name,
        vertices,
        np.array([[0, 1, 2]], np.uint32),
        color=palette.ESTIMATE,
        side="double",
        cast_shadow=False,
        receive_shadow=False,
    )
