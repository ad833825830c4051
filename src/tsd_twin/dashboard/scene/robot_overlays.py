"""Overlays of a robot: predicted motion, setpoint rings, wireframes of other poses, and their
combination with all other overlays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import viser
from manifold3d import CrossSection

from tsd_twin.client.connection import SentCommand
from tsd_twin.client.monitor import RoundTrips, Snapshot
from tsd_twin.dashboard.scene.appearance import (
    ALTERNATIVE_POSES,
    AXLES,
    FAULT,
    HEADING,
    ROUTES,
    STALE,
    TRAILS,
    TRUE_POSES,
    Palette,
    Rgb,
    overlay_node,
    robot_node,
)
from tsd_twin.dashboard.scene.drive_marks import PushArrows, add_axles, add_setpoint_rings
from tsd_twin.dashboard.scene.overlays import FaultRing, PoseRegion, StopEnvelope
from tsd_twin.dashboard.scene.paths import RouteLine, Trail
from tsd_twin.dashboard.scene.picking import OnClick, add_click_target
from tsd_twin.dashboard.scene.robot_geometry import JointReader, RobotShape, Surface
from tsd_twin.dashboard.scene.stage import contact_shadow
from tsd_twin.dashboard.scene.themed import add_lines, closed, dashes, fan, raised, set_all, themed
from tsd_twin.dashboard.scene.unlit import coloured, unlit_glb
from tsd_twin.dashboard.wire.view import Layer
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.cdr import ODOM, Odometry
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import RobotStatus
from tsd_twin.motion.prediction import PendingCommand, Predictor
from tsd_twin.robots import RobotDescription

MIN_DELAY_S = 0.05
"""Minimum delay for showing a predicted pose."""
TIMEOUT_MARGIN_S = 0.03
"""Commands arrive every 20 ms and are evaluated every 10 ms."""
_COARSE_STEP_S = 0.02
_SENDER_TIMEOUT_S = 0.5
"""Time without commands, plus a round trip, after which the operator is not driving."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Prediction in the robot's frame at its latest state."""

    arrival_pose: Array | None
    """(3,): pose when a command sent now arrives, or None without a noticeable delay."""
    path: Array | None
    """(n, 3): path to rest without further messages, or None at rest."""


NO_PREDICTION = Prediction(None, None)


class MotionPredictor:
    """Predicts the motion of a planar robot by simulation."""

    def __init__(self, kinematics: Kinematics[SE2], robot: RobotDescription) -> None:
        self._kinematics = kinematics
        self._limits = robot.limits
        self._fine = Predictor(kinematics, robot.limits, robot.lag_s)
        self._coarse = Predictor(kinematics, robot.limits, robot.lag_s, _COARSE_STEP_S)

    def predict(
        self, snapshot: Snapshot, setpoint: Array, sent: Sequence[SentCommand], trips: RoundTrips
    ) -> Prediction:
        """Return the prediction for joint setpoints `setpoint` (n,)."""
        status, odom = snapshot.status, snapshot.odom
        if status is None or odom is None or status.mode not in (Mode.DRIVING, Mode.STOPPING):
            return NO_PREDICTION
        twist = self._kinematics.forward(setpoint).twist
        measured = odom.twist if np.isfinite(odom.twist).all() else twist
        heading = float(odom.xy_heading[2])
        share = status.limits.speed_mps / self._limits.speed_mps
        if not share > 0.0:
            return NO_PREDICTION  # Anyone may publish a status on a bus without access rules.
        trip_s = trips.median_s()
        arrival_pose = None
        if trip_s is not None and trip_s >= MIN_DELAY_S and status.mode == Mode.DRIVING:
            commands = _commands_in_flight(sent, snapshot.received_s, trip_s, heading)
            if commands:
                arrival_pose = self._fine.after(
                    trip_s, SE2.identity(), twist, commands, share, measured
                ).xy_heading
        late_s = trips.p95_s()
        path = self._path(status, twist, measured, sent, snapshot.received_s, late_s, heading)
        return Prediction(arrival_pose, path)

    def _path(
        self,
        status: RobotStatus,
        twist: Array,
        measured: Array,
        sent: Sequence[SentCommand],
        now_s: float,
        late_s: float | None,
        heading: float,
    ) -> Array:
        # A command moves the robot until `max_age_s` after the status that it echoes was sent. This
        # dashboard has received that status by now; another one may receive it up to `max_age_s`
        # later.
        max_age_s = status.limits.max_command_age_s
        silence_s = 2.0 * max_age_s
        commands: list[PendingCommand] = []
        if late_s is not None and (own := _commands_in_flight(sent, now_s, late_s, heading)):
            commands = [due for due in own if due.after_s <= min(late_s, max_age_s)]
            timeout_s = self._limits.command_timeout_s + max_age_s - self._limits.max_command_age_s
            silence_s = min(late_s + timeout_s, max_age_s)
        silence_s += TIMEOUT_MARGIN_S
        if status.mode == Mode.STOPPING:
            commands, silence_s = [], 0.0
        share = status.limits.speed_mps / self._limits.speed_mps
        commands.append(PendingCommand(silence_s, np.zeros(3)))
        poses = self._coarse.until_rest(SE2.identity(), twist, commands, share, measured)
        return np.array([pose.xy_heading for pose in poses])


def _commands_in_flight(
    sent: Sequence[SentCommand], now_s: float, trip_s: float, heading: float
) -> list[PendingCommand]:
    """Return the commands not included, or just included, in a state received now.

    A command sent now arrives one round trip after the state received now was sent; this requires
    no synchronized clocks.
    """
    recent = [one for one in sent if one.sent_s > now_s - trip_s - _SENDER_TIMEOUT_S]
    return [
        PendingCommand(
            one.sent_s - now_s + trip_s, one.twist, heading if one.frame == ODOM else None
        )
        for one in recent
    ]


VISIBLE_DIFFERENCE_M = 0.005
VISIBLE_DIFFERENCE_RAD = math.radians(0.5)
"""Other poses are shown if they differ from the estimate by more than this distance or angle."""


class PoseWireframe:
    """Wireframe at another pose of the robot: true, alternative or predicted.

    For spheres, it consists of great circles with the other orientation.
    """

    def __init__(
        self, scene: viser.SceneApi, name: str, shape: RobotShape, hue: Callable[[Palette], Rgb]
    ) -> None:
        """`hue` returns the colour in a theme."""
        self._frame = scene.add_frame(name, show_axes=False)
        self._height_m = shape.skeleton.tree.height_m
        self._wireframes = [
            add_wireframe(scene, f"{node}/c", shape, hue(palette), visible=False)
            for node, palette in themed(scene, name)
        ]

    def update(self, reported: Odometry, estimate: Odometry) -> None:
        """Show a reported pose, unless it is close to the estimate."""
        set_all(self._wireframes, visible=_differs_visibly(reported, estimate))
        # Also update it while hidden, because a client may show the wireframe anyway.
        if reported.wxyz is None:
            set_planar_pose(self._frame, reported.xy_heading)
        else:
            self._frame.position = (0.0, 0.0, self._height_m)
            self._frame.wxyz = reported.wxyz

    def place(self, pose: Array | None) -> None:
        """Show a pose (3,) in the frame of the parent, to a millimetre; None hides it."""
        set_all(self._wireframes, visible=pose is not None)
        if pose is not None:
            set_planar_pose(self._frame, np.round(pose, 3))

    def remove(self) -> None:
        """Remove the wireframe."""
        self._frame.remove()


def _differs_visibly(reported: Odometry, estimate: Odometry) -> bool:
    """Return whether two poses differ visibly."""
    if reported.wxyz is not None and estimate.wxyz is not None:
        between = SO3(estimate.wxyz).inverse() @ SO3(reported.wxyz)
        return bool(np.linalg.norm(between.log()) > VISIBLE_DIFFERENCE_RAD)
    difference = reported.xy_heading - estimate.xy_heading
    return bool(
        math.hypot(difference[0], difference[1]) > VISIBLE_DIFFERENCE_M
        or abs(wrap(difference[2])) > VISIBLE_DIFFERENCE_RAD
    )


def set_planar_pose(frame: viser.FrameHandle, pose: Array) -> None:
    """Move a node to a planar pose (3,)."""
    half = 0.5 * float(pose[2])
    frame.position = (float(pose[0]), float(pose[1]), 0.0)
    frame.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))


def add_wireframe(
    scene: viser.SceneApi, name: str, shape: RobotShape, colour: Rgb, *, visible: bool
) -> viser.LineSegmentsHandle:
    """Add a dashed outline of a robot on the floor, or great circles of its sphere."""
    radius_m = shape.ball_radius_m
    if radius_m is None:
        outline = dashes(closed(shape.footprint), _OUTLINE_DASH_M, _OUTLINE_GAP_M)
        lines = raised(outline, _OUTLINE_HEIGHT_M)
    else:
        lines = _great_circles(radius_m)
    return add_lines(scene, name, lines, colour, _OUTLINE_WIDTH_M, visible=visible)


_OUTLINE_WIDTH_M, _OUTLINE_HEIGHT_M = 0.004, 0.004
_OUTLINE_DASH_M, _OUTLINE_GAP_M = 0.012, 0.010


def _great_circles(radius_m: float) -> Array:
    """Return great circles (n, 2, 3) just outside a sphere, and pointers along its X and Z."""
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    flat = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    lines = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in (flat, flat[:, [0, 2, 1]])]
    pointers = [np.array([[axis, 1.25 * axis]]) for axis in np.eye(3)[[0, 2]]]
    return 1.01 * radius_m * np.concatenate([*lines, *pointers])


class RobotOverlays:
    """Overlays of a robot: wireframes, trail, arrows, pose region, envelope, heading, stale hull.

    Parts fixed to the robot are children of a single moving node, which makes motion cheap.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        robot_id: str,
        shape: RobotShape,
        on_click: OnClick,
        colour: Rgb,
    ) -> None:
        """`colour` identifies the robot."""
        node, self._reader = robot_node(robot_id), JointReader(shape.kinematics.joints)
        self._base = scene.add_frame(node, show_axes=False)
        self.setpoint = (
            add_setpoint_rings(scene, themed(scene, overlay_node(Layer.SETPOINT, robot_id)), shape)
            if shape.tilts
            else None
        )
        truth, alternative = f"{TRUE_POSES}/{robot_id}", f"{ALTERNATIVE_POSES}/{robot_id}"
        self.truth = PoseWireframe(scene, truth, shape, attrgetter("ink"))
        self.alternative = PoseWireframe(scene, alternative, shape, attrgetter("estimate"))
        self.trail = Trail(scene, f"{TRAILS}/{robot_id}")
        self.route = RouteLine(scene, f"{ROUTES}/{robot_id}", shape.footprint)
        scene.add_glb(
            f"{node}/f", contact_shadow(shape.footprint), cast_shadow=False, receive_shadow=False
        )
        self.arrows = PushArrows(scene, overlay_node(Layer.ARROWS, robot_id), shape)
        self.axles = add_axles(scene, themed(scene, f"{node}/{AXLES}"), shape)
        self.region = PoseRegion(scene, overlay_node(Layer.REGION, robot_id), shape.reach_m)
        # A child of the robot, so it sends nothing while delay and speed are constant.
        predicted = overlay_node(Layer.PREDICTED, robot_id)
        self.predicted = PoseWireframe(scene, predicted, shape, attrgetter("command"))
        self.envelope = StopEnvelope(scene, overlay_node(Layer.ENVELOPE, robot_id), shape.reach_m)
        if not shape.skeleton.has_ball:  # A sphere does not move.
            _add_heading_mark(scene, f"{node}/{HEADING}", shape)
        add_click_target(scene, f"{node}/x", shape, robot_id, on_click)
        self._suspect = FaultRing(scene, f"{node}/{FAULT}", shape)
        self._cover = _add_stale_hull(scene, f"{node}/c", shape)
        above = (0.0, 0.0, shape.height_m + 0.15)
        name = overlay_node(Layer.LABELS, robot_id)
        self.label = scene.add_label(
            name, robot_id, position=above, anchor="bottom-center", visible=False
        )
        self._name_ring = _add_name_ring(scene, f"{node}/q", shape, colour)

    def set_named(self, on: bool) -> None:
        """Show name and colour of the robot, if there are several robots."""
        self.label.visible = on
        self._name_ring.visible = on

    def set_stale(self, stale: bool) -> None:
        """Cover the robot in grey while its state is stale.

        The envelope remains, because it contains the robot if the link is lost.
        """
        self._cover.visible = stale
        if stale:
            self.predicted.place(None)

    def show_prediction(self, prediction: Prediction) -> None:
        """Show a prediction."""
        self.predicted.place(prediction.arrival_pose)
        self.envelope.update(prediction.path)

    def update(
        self, new: Snapshot, old: Snapshot, joints: Array, drawn: Callable[[Array], Array]
    ) -> None:
        """Show the changes from `old` to `new`.

        Args:
            new: Latest snapshot.
            old: Snapshot drawn before.
            joints: (n,): latest measured joints.
            drawn: Returns joints (n,) with their drawn tilt.
        """
        moved = new.odom is not None and new.odom is not old.odom
        if new.odom is not None and moved and new.odom.wxyz is None:
            pose = new.odom.xy_heading
            set_planar_pose(self._base, pose)
            self.trail.update(pose[:2], new.received_s)
            self.region.update(new.odom.pose_covariance, float(pose[2]), new.received_s)
        if new.joints is not old.joints:
            self.arrows.update(joints, new.received_s)
            if self.axles is not None:
                self.axles.update(drawn(joints), new.received_s)
        if self.setpoint and new.setpoint is not None and new.setpoint is not old.setpoint:
            setpoint = self._reader.vector(new.setpoint)
            if setpoint is not None:
                self.setpoint.update(drawn(setpoint), new.received_s)
        if new.status is not None and new.status is not old.status:
            self._suspect.update(new.status)
        for wireframe, reported, before in (
            (self.truth, new.truth, old.truth),
            (self.alternative, new.alternative, old.alternative),
        ):
            if reported is not None and new.odom is not None and reported is not before:
                wireframe.update(reported, new.odom)

    def remove(self) -> None:
        """Remove all overlays."""
        self.trail.clear()
        self.route.remove()
        self.truth.remove()
        self.alternative.remove()
        self._base.remove()


def _add_stale_hull(scene: viser.SceneApi, name: str, shape: RobotShape) -> viser.MeshHandle:
    """Add a grey hull, slightly larger than the robot."""
    vertices, faces = shape.collision
    return scene.add_mesh_simple(
        name,
        1.04 * vertices,
        faces,
        color=STALE,
        opacity=0.8,
        flat_shading=True,
        cast_shadow=False,
        receive_shadow=False,
        visible=False,
    )


def _add_name_ring(
    scene: viser.SceneApi, name: str, shape: RobotShape, colour: Rgb
) -> viser.MeshHandle:
    """Add a ring in the robot's colour on the floor around it."""
    inner_m = shape.reach_m + 0.015
    ring = CrossSection.circle(inner_m + 0.012, 96) - CrossSection.circle(inner_m, 96)
    return scene.add_mesh_simple(
        name,
        *Surface.of(ring.extrude(0.002)),
        color=colour,
        cast_shadow=False,
        receive_shadow=False,
        visible=False,
    )


def _add_heading_mark(scene: viser.SceneApi, name: str, shape: RobotShape) -> None:
    """Add a flat chevron on the floor in front of the robot."""
    near = float(shape.footprint[:, 0].max()) + 0.03
    chevron = np.array([[0.008, 0.0], [0.0, -0.022], [0.034, 0.0], [0.0, 0.022]])
    corners = chevron + np.array([near, 0.0])
    for node, palette in themed(scene, name):
        scene.add_glb(
            f"{node}/h",
            unlit_glb(raised(corners, 0.004), fan(4), coloured(4, palette.ink)),
            cast_shadow=False,
            receive_shadow=False,
        )
