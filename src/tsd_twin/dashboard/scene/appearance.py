"""Colours, scene nodes of the layers, lights, and the roster of robots.

The colours are distinct for colour-blind people.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import viser

from tsd_twin.dashboard.wire.view import Layer

Rgb: TypeAlias = tuple[int, int, int]

ESTIMATE: Rgb = (36, 132, 227)
"""Colour of the estimate: trail and covariance."""
SETPOINT: Rgb = (0, 200, 215)
"""Colour of setpoints."""
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
"""Colour of history and recordings."""
SUSPECT: Rgb = (225, 40, 40)
"""Colour of a suspected fault."""
STALE: Rgb = (128, 132, 138)
"""Colour of stale data."""
GRID_FINE: Rgb = (128, 134, 142)
GRID_METRE: Rgb = (118, 124, 132)
GRID_LABEL: Rgb = (140, 146, 155)


ROOT = "/w"
"""The world frame, `odom`, the parent of all nodes. It moves so that the followed robot stays in
place.
"""


TRUE_POSES, ALTERNATIVE_POSES, TRAILS, AXIS_LABELS = (
    f"{ROOT}/t",
    f"{ROOT}/o",
    f"{ROOT}/k",
    f"{ROOT}/l",
)
"""Parent nodes of the true poses, alternative estimates, trails and metre labels of all robots."""
ROUTES = f"{ROOT}/p"
"""Parent node of all planned paths."""
PAST_NODE = f"{ROOT}/h"
"""Node of a robot's past state, in the scene of its page."""
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
    """Return the node at the floor projection of `base_link`."""
    return f"{ROOT}/r/{robot_id}"


def overlay_node(layer: Layer, robot_id: str) -> str:
    """Return the node that shows a robot's layer and moves with the robot."""
    return f"{robot_node(robot_id)}/{_ROBOT_NODES[layer]}"


def layer_nodes(layer: Layer, robot_ids: Iterable[str]) -> set[str]:
    """Return the nodes to hide for a layer; hiding includes their children."""
    shared = {_SHARED_NODES[layer]} if layer in _SHARED_NODES else set[str]()
    return shared | {overlay_node(layer, one) for one in robot_ids if layer in _ROBOT_NODES}


_AMBIENT_NODE = "/ambient"
_AMBIENT_INTENSITY = 1.5
"""Matches the brightness of the reflections it replaces."""


def disable_shadows_and_reflections(own: viser.SceneApi) -> None:
    """Disable shadows and reflections, most of the rendering time, in the scene of a client.

    Call it again after the client's nodes have been reset.
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
"""Each has a contrast of at least 3 : 1 to the light and the dark background."""


class RobotRoster:
    """Order and colours of robots, the same on all pages and in the scene; thread-safe.

    Named robots precede the others, in the given order, and new pages show the first one; the
    others are sorted by id. A robot keeps its colour; if all colours are in use, they repeat.
    """

    def __init__(self, first: Sequence[str] = ()) -> None:
        """`first` lists robot ids, which may appear later or never."""
        self._lock = threading.Lock()
        self._first = {robot_id: place for place, robot_id in enumerate(dict.fromkeys(first))}
        self._numbers = dict(self._first)

    def in_order(self, robot_ids: Iterable[str]) -> list[str]:
        """Return robots in menu order."""
        last = len(self._first)
        return sorted(robot_ids, key=lambda each: (self._first.get(each, last), each))

    def colour(self, robot_id: str) -> Rgb:
        """Return the colour of a robot."""
        with self._lock:
            number = self._numbers.setdefault(robot_id, len(self._numbers))
        return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]

    def css_colour(self, robot_id: str) -> str:
        """Return the colour of a robot as `#rrggbb`."""
        return "#{:02x}{:02x}{:02x}".format(*self.colour(robot_id))
