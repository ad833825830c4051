"""Marks of the drive: contacts, axles, commanded axles and the push of each wheel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard.scene.appearance import Palette, Rgb
from tsd_twin.dashboard.scene.robot_geometry import LinkPoses, RobotShape, Surface
from tsd_twin.dashboard.scene.themed import CASING_M, RateLimiter, add_lines, set_all, themed
from tsd_twin.dashboard.scene.unlit import coloured, unlit_glb
from tsd_twin.lie import SE2, SO3, Array

LEAST_ARROW_M = 0.035
"""Length of the arrow of the slowest wheel."""
ARROW_LENGTH_PER_SPEED_S = 0.17
"""Additional arrow length in metres per m/s."""
MIN_ARROW_SPEED_MPS = 0.02
_ARROW_WIDTH_M = 0.008
_HEAD_M, _HEAD_HALF_M = 0.028, 0.014
"""Length and half-width of the head between the middles of its strokes."""
_ABOVE_WHEEL_M = 0.03
_BALL_GAP_M = 0.006
_CASING_BELOW_M = 0.005


def arrow_lines(starts: Array, velocities: Array, speeds: Array) -> npt.NDArray[np.float32]:
    """Return the strokes (6n, 2, 3) of arrows from `starts` (n, 3) along horizontal velocities.

    Each has a shaft and a head that strokes fill.
    """
    ahead = velocities / speeds[:, None]
    level = np.cross(np.array([0.0, 0.0, 1.0]), ahead)
    size = np.linalg.norm(level, axis=-1, keepdims=True)
    left = np.where(size > 1e-6, level / np.where(size > 1e-6, size, 1.0), (0.0, 1.0, 0.0))
    tips = starts + ahead * (LEAST_ARROW_M + ARROW_LENGTH_PER_SPEED_S * speeds)[:, None]
    necks = tips - _HEAD_M * ahead
    one, other = necks + _HEAD_HALF_M * left, necks - _HEAD_HALF_M * left
    inner = necks + 0.5 * _HEAD_HALF_M * left, necks - 0.5 * _HEAD_HALF_M * left
    sides = [(corner, tips) for corner in (one, other, *inner)]
    strokes = [(starts, tips), *sides, (one, other)]
    return np.concatenate([np.stack(ends, axis=1) for ends in strokes]).astype(np.float32)


def push_strokes(shape: RobotShape, places: Array, velocities: Array) -> npt.NDArray[np.float32]:
    """Return the arrows of turning wheels, from contacts and rolling velocities (k, 3)."""
    speeds = np.linalg.norm(velocities, axis=-1)
    fast = speeds >= MIN_ARROW_SPEED_MPS
    lifted = places[fast] + np.array([0.0, 0.0, push_height_m(shape)])
    return arrow_lines(lifted, velocities[fast], speeds[fast])


class PushArrows:
    """Flat arrows for the velocity contributed by each wheel, from the joint vector."""

    def __init__(self, scene: viser.SceneApi, name: str, shape: RobotShape) -> None:
        self._shape = shape
        self._rate = RateLimiter(12.0)
        wheels = sum(group.count for group in shape.skeleton.wheels)
        self._drawn = np.zeros((wheels, 3))
        self._lines = [
            PushLines(scene, f"{node}/v", palette.command, palette.casing)
            for node, palette in themed(scene, name)
        ]

    def update(self, joints: Array, now_s: float) -> None:
        """Draw the arrows for a joint vector (n,)."""
        if not len(self._drawn) or not self._rate.is_due(now_s):
            return
        places, velocities = self._shape.skeleton.contacts(joints)
        velocities[np.linalg.norm(velocities, axis=-1) < MIN_ARROW_SPEED_MPS] = 0.0
        if np.abs(velocities - self._drawn).max() < 0.5 * MIN_ARROW_SPEED_MPS:
            return
        self._drawn = velocities
        strokes = push_strokes(self._shape, places, velocities)
        for lines in self._lines:
            lines.update(strokes)


def push_height_m(shape: RobotShape) -> float:
    """Return the height of the arrows above the contacts: above the wheels, or just off a ball."""
    if shape.skeleton.has_ball:
        return _BALL_GAP_M
    radii = [group.collision.radius_m for group in shape.skeleton.wheels if group.collision]
    return 2.0 * max(radii, default=0.0) + _ABOVE_WHEEL_M


class PushLines:
    """Single-coloured arrows with a casing below them."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, casing: Rgb) -> None:
        nothing = np.zeros((1, 2, 3), np.float32)
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        self._core = add_lines(scene, f"{name}/p", nothing, colour, _ARROW_WIDTH_M)
        self._casing = add_lines(
            scene, f"{name}/c", nothing, casing, _ARROW_WIDTH_M + 2.0 * CASING_M
        )

    def update(self, strokes: npt.NDArray[np.float32]) -> None:
        """Draw strokes (n, 2, 3); none hide the arrows."""
        self._frame.visible = len(strokes) > 0
        if len(strokes):
            self._core.points = strokes
            self._casing.points = strokes - np.array([0.0, 0.0, _CASING_BELOW_M], np.float32)

    def remove(self) -> None:
        """Remove the arrows."""
        self._frame.remove()


AXLE_M = 0.135
"""Length of the rods along the axles."""
_ROD_M, _END_M = 0.0022, 0.0062
_UPRIGHT_M = 0.0011
_RING_M = (0.0075, 0.0125)
_SETPOINT_M = (0.0105, 0.0135)
_SETPOINT_DASHES = 8
_RING_LIFT_M = 0.004
_HIDDEN_OPACITY = 0.7
"""Opacity of the ring above a contact that the robot hides."""
_SIDES = 40
AXLE_HZ = 20.0
"""Maximum rate of the poses of rods and rings; the gimbals themselves move at full rate."""


_LEAST_TURN = 1e-3
"""Smallest change of a quaternion component that is sent."""
_Themes: TypeAlias = Sequence[tuple[str, Palette]]
"""Nodes and their colours, see `themed`."""


class AxleMarks:
    """Marks that turn with the axles of wheels on gimbals, in all themes."""

    def __init__(
        self, scene: viser.SceneApi, marks: Sequence[tuple[str, bytes]], shape: RobotShape
    ) -> None:
        """`marks` are names of nodes with their binary glTF; all are upright at first."""
        self._skeleton, self._kind = shape.skeleton, shape.skeleton.wheels[0].kind
        self._rate = RateLimiter(AXLE_HZ)
        self.joints = shape.kinematics.inverse(np.zeros(3))
        """Displayed joint vector (n,)."""
        poses = self._poses(self.joints)
        self._handles = [_add_unlit(scene, name, data, *poses) for name, data in marks]
        self._shown = poses.wxyz.astype(np.float32)
        self.pivots = poses.position
        """(k, 3): places of the marks."""

    def update(self, joints: Array, now_s: float) -> None:
        """Show the axles of a drawn joint vector (n,)."""
        if np.array_equal(joints, self.joints) or not self._rate.is_due(now_s):
            return
        self.joints = joints
        wxyz = self._poses(joints).wxyz.astype(np.float32)
        if np.abs(wxyz - self._shown).max() > _LEAST_TURN:
            self._shown = wxyz
            set_all(self._handles, batched_wxyzs=wxyz)

    def _poses(self, joints: Array) -> LinkPoses:
        at_rest = self._skeleton.at_rest(joints)
        return self._skeleton.poses(SE2.identity(), SO3.identity(), at_rest)[self._kind]


def add_axles(scene: viser.SceneApi, themes: _Themes, shape: RobotShape) -> AxleMarks | None:
    """Add contact rings and, for wheels on gimbals, thin uprights and rods along the axles."""
    contacts = shape.skeleton.contacts(shape.kinematics.inverse(np.zeros(3)))[0]
    for node, palette in themes:
        _add_contacts(scene, f"{node}/k", shape, contacts, palette)
    if not shape.tilts:
        return None
    rods = AxleMarks(scene, [(f"{node}/r", _rod(palette)) for node, palette in themes], shape)
    ends = np.stack([rods.pivots, rods.pivots + np.array([0.0, 0.0, AXLE_M])], axis=1)
    for node, palette in themes:
        add_lines(scene, f"{node}/u", ends, palette.ink, 2.0 * _UPRIGHT_M)
    return rods


def add_setpoint_rings(scene: viser.SceneApi, themes: _Themes, shape: RobotShape) -> AxleMarks:
    """Add dashed rings around the ends of the rods, at the commanded axles."""
    return AxleMarks(scene, [(f"{node}/s", _setpoint(palette)) for node, palette in themes], shape)


def _add_unlit(
    scene: viser.SceneApi, name: str, data: bytes, wxyz: Array, position: Array
) -> viser.BatchedGlbHandle:
    return scene.add_batched_glb(
        name, data, wxyz, position, lod="off", cast_shadow=False, receive_shadow=False
    )


def _add_contacts(
    scene: viser.SceneApi, name: str, shape: RobotShape, places: Array, palette: Palette
) -> None:
    """Add rings at the contacts (k, 3), which hardly depend on the joints."""
    if not len(places):
        return
    radius_m = shape.ball_radius_m
    up = np.tile((0.0, 0.0, 1.0), (len(places), 1))
    if radius_m is not None:
        up = (places - (0.0, 0.0, shape.skeleton.tree.height_m)) / radius_m
    wxyz = np.column_stack([1.0 + up[:, 2], -up[:, 1], up[:, 0], 0.0 * up[:, 0]])
    wxyz = wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)
    _add_unlit(scene, name, _contact(palette), wxyz, places + _RING_LIFT_M * up)
    if shape.tilts:  # The lower deck hides the contacts; viser draws nothing through it.
        above = places + np.array([0.0, 0.0, push_height_m(shape) - _RING_LIFT_M])
        _add_unlit(scene, f"{name}a", _contact(palette, _HIDDEN_OPACITY), wxyz, above)


def _rod(palette: Palette) -> bytes:
    """Return a rod with a ball at its end along Z, in a shell of which the inside is seen."""

    def grown(by_m: float) -> Surface:
        rod = CrossSection.square((_ROD_M + by_m, AXLE_M))
        end = CrossSection.circle(_END_M + by_m, 24).translate((0.0, AXLE_M))
        profile: Any = rod + end
        return Surface.of(profile.revolve(20))

    core, shell = grown(0.0), grown(0.5 * CASING_M + 0.0006)
    return _joined(
        [
            (core.vertices, core.faces, palette.estimate),
            (shell.vertices, shell.faces[:, ::-1], palette.casing),
        ]
    )


def _contact(palette: Palette, opacity: float = 1.0) -> bytes:
    inner, outer = _RING_M
    casing = (*_band(inner - CASING_M, outer + CASING_M, 0.0), palette.casing)
    ring = (*_band(inner, outer, 0.0008), palette.command)
    return _joined([casing, ring] if opacity == 1.0 else [ring], opacity)


def _setpoint(palette: Palette) -> bytes:
    inner, outer = _SETPOINT_M
    return _joined([(*_band(inner, outer, AXLE_M, _SETPOINT_DASHES), palette.command)])


def _band(
    inner_m: float, outer_m: float, height_m: float, dashes: int = 0
) -> tuple[Array, npt.NDArray[np.uint32]]:
    """Return vertices and two-sided faces of a flat dashed ring."""
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    ring = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    vertices = np.concatenate([inner_m * ring, outer_m * ring])
    vertices[:, 2] = height_m
    first = np.arange(_SIDES)
    if dashes:
        first = first[first * dashes % _SIDES < 0.6 * _SIDES]
    second = first + _SIDES + 1
    above = np.concatenate(
        [
            np.stack([first, second, second + 1], axis=-1),
            np.stack([first, second + 1, first + 1], axis=-1),
        ]
    )
    return vertices, np.concatenate([above, above[:, ::-1]]).astype(np.uint32)


def _joined(
    parts: Sequence[tuple[npt.NDArray[np.floating[Any]], npt.NDArray[np.uint32], Rgb]],
    opacity: float = 1.0,
) -> bytes:
    """Return binary glTF of surfaces in their colours."""
    counts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    return unlit_glb(
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate(
            [faces + start for (_, faces, _), start in zip(parts, counts, strict=False)]
        ),
        np.concatenate([coloured(len(vertices), colour, opacity) for vertices, _, colour in parts]),
    )
