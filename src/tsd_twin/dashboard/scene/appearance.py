"""Colours, layers with their scene nodes, lights, view settings of a page, and roster of robots.

Colours are distinct for colour-blind people.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Annotated, TypeAlias

import msgspec
import viser
from msgspec import Meta

Rgb: TypeAlias = tuple[int, int, int]

ESTIMATE: Rgb = (36, 132, 227)
"""Colour of the estimate: trail and covariance."""
SETPOINT: Rgb = (0, 200, 215)
"""Colour of set-points."""
TRUTH: Rgb = (60, 190, 90)
"""Colour of ground truth."""
OTHER: Rgb = (232, 86, 120)
"""Colour of the alternative estimate."""
THRUST: Rgb = (240, 150, 10)
"""Colour of wheel velocities over the ground."""
PREVIEW: Rgb = (190, 70, 230)
"""Colour of the pose preview."""
ROUTE: Rgb = (150, 110, 255)
"""Colour of the planned path."""
PREDICTED: Rgb = (235, 80, 160)
"""Colour of the predicted pose."""
ENVELOPE: Rgb = (232, 90, 60)
"""Colour of the stop envelope."""
PAST: Rgb = (245, 189, 74)
"""Colour of the past, as of all that belongs to recordings."""
SUSPECT: Rgb = (225, 40, 40)
"""Colour of a suspected fault."""
STALE: Rgb = (128, 132, 138)
"""Colour of stale data."""
GRID_FINE: Rgb = (128, 134, 142)
GRID_METRE: Rgb = (118, 124, 132)
GRID_LABEL: Rgb = (140, 146, 155)


ROOT = "/w"
"""The world, `odom`: everything hangs on it. It moves so that the robot keeps its place."""


class Layer(StrEnum):
    """Layers that a client can hide; the values are the labels in the panel."""

    SETPOINT = "set-point"
    TRUTH = "true pose"
    OTHER = "other estimate"
    TRAIL = "trail"
    ROUTE = "planned path"
    ARROWS = "thrust arrows"
    REGION = "region of the pose"
    PREDICTED = "predicted pose"
    ENVELOPE = "stop envelope"
    LABELS = "labels"


TRUE_POSES, ALTERNATIVE_POSES, TRAILS, AXIS_LABELS = (
    f"{ROOT}/t",
    f"{ROOT}/o",
    f"{ROOT}/k",
    f"{ROOT}/l",
)
"""Nodes of all robots' true poses, of what else is estimated, of all trails, and of the metres on
the floor."""
ROUTES = f"{ROOT}/p"
"""Node of all planned paths."""
PAST_NODE = f"{ROOT}/h"
"""Node of the robot of a page as it was some seconds ago, in the scene of that page."""
_SHARED_NODES = {
    Layer.TRUTH: TRUE_POSES,
    Layer.OTHER: ALTERNATIVE_POSES,
    Layer.TRAIL: TRAILS,
    Layer.ROUTE: ROUTES,
    Layer.LABELS: AXIS_LABELS,
}
_ROBOT_NODES = {
    Layer.SETPOINT: "s",
    Layer.ARROWS: "a",
    Layer.REGION: "e",
    Layer.PREDICTED: "g",
    Layer.ENVELOPE: "b",
    Layer.LABELS: "n",
}


def robot_node(robot_id: str) -> str:
    """Node at the floor projection of `base_link`."""
    return f"{ROOT}/r/{robot_id}"


def overlay_node(layer: Layer, robot_id: str) -> str:
    """Node that shows a layer of one robot and moves with it."""
    return f"{robot_node(robot_id)}/{_ROBOT_NODES[layer]}"


def layer_nodes(layer: Layer, robot_ids: Iterable[str]) -> set[str]:
    """Return the nodes to hide for a layer; their children are hidden too."""
    shared = {_SHARED_NODES[layer]} if layer in _SHARED_NODES else set[str]()
    return shared | {overlay_node(layer, one) for one in robot_ids if layer in _ROBOT_NODES}


_AMBIENT_NODE = "/ambient"
_AMBIENT_INTENSITY = 1.5
"""As bright as the reflections that it stands for."""


def disable_shadows_and_reflections(own: viser.SceneApi) -> None:
    """Disable shadows and reflections in the scene of one client, most of the rendering time.

    Also after its nodes have been reset.
    """
    own.configure_default_lights(cast_shadow=False)
    own.configure_environment_map(None)
    own.add_light_ambient(_AMBIENT_NODE, intensity=_AMBIENT_INTENSITY)


ROBOT_COLOURS: tuple[Rgb, ...] = (
    (11, 132, 216),
    (217, 101, 10),
    (15, 157, 118),
    (192, 90, 168),
    (169, 130, 0),
    (125, 120, 216),
    (224, 72, 122),
    (95, 143, 47),
)
"""Each has a contrast of 3 : 1 and more against the light and against the dark surfaces."""


class RobotRoster:
    """Order and colours of robots, the same on all pages and in the scene; thread-safe.

    The robots that were named come first, in that order; a page that opens shows the first one. The
    others follow by id. A robot keeps its colour; when all are in use, they are used again.
    """

    def __init__(self, first: Sequence[str] = ()) -> None:
        """`first` are ids of robots, which may appear later, or never."""
        self._lock = threading.Lock()
        self._first = {robot_id: place for place, robot_id in enumerate(dict.fromkeys(first))}
        self._numbers = dict(self._first)

    def in_order(self, robot_ids: Iterable[str]) -> list[str]:
        """Return robots in the order of the menu."""
        last = len(self._first)
        return sorted(robot_ids, key=lambda each: (self._first.get(each, last), each))

    def colour(self, robot_id: str) -> Rgb:
        """Return the colour of a robot."""
        with self._lock:
            number = self._numbers.setdefault(robot_id, len(self._numbers))
        return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]


class CameraPreset(StrEnum):
    """Camera presets; the values are the labels in the panel."""

    ISO = "3-D"
    TOP = "top"
    CHASE = "chase"
    """Behind the robot: the picture turns along with it, while the camera follows it."""


class TruePoseDisplay(StrEnum):
    """Display condition of the true pose; the values are the labels in the panel."""

    DIFFERS = "when it differs"
    ALWAYS = "always"
    NEVER = "never"


class TiltFactor(StrEnum):
    """Factors of the drawn tilt; the values are the labels in the panel."""

    TRUE = "x1"
    THREE = "x3"
    TEN = "x10"

    @property
    def number(self) -> int:
        """The factor."""
        return int(self.value[1:])


class ViewSettings(msgspec.Struct, frozen=True):
    """View settings of one page, as it keeps them."""

    camera: CameraPreset = CameraPreset.ISO
    follow: bool = True
    """Whether the camera moves with the robot."""
    hidden: Annotated[Sequence[Layer], Meta(max_length=len(Layer))] = ()
    true_pose: TruePoseDisplay = TruePoseDisplay.DIFFERS
    tilt: TiltFactor = TiltFactor.TRUE
    dark: bool | None = None
    """Dark or light colours; None as the browser prefers."""
