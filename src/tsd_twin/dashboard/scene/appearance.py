"""Colours of both themes, names of nodes, and the roster of robots."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from tsd_twin.dashboard.wire.view import Layer

Rgb: TypeAlias = tuple[int, int, int]


class Theme(StrEnum):
    """Theme of a client."""

    DARK = "dark"
    LIGHT = "light"


def rgb(css: str) -> Rgb:
    """Return the colour of `#rrggbb`."""
    return int(css[1:3], 16), int(css[3:5], 16), int(css[5:7], 16)


class Palette(NamedTuple):
    """Colours of the scene in one theme."""

    estimate: Rgb
    """Estimated pose: trail, axles, region; solid lines and filled dots."""
    command: Rgb
    """Setpoints and push: dashed rings and arrows."""
    plan: Rgb
    """Path, goal and preview: long dashes."""
    caution: Rgb
    """Stop envelope and past states: short dashes around an area."""
    danger: Rgb
    """Stops and faults."""
    ink: Rgb
    """True pose of a simulated robot, dashed."""
    casing: Rgb
    """Outline of overlays, since their contrast to the floor may be low."""
    floor: Rgb
    far: Rgb
    """Background, and the floor at a distance."""
    line: Rgb
    """Lines on the floor each metre."""
    label: Rgb
    """Metre labels."""


PALETTES: Mapping[Theme, Palette] = {
    Theme.DARK: Palette(
        estimate=rgb("#1d96fe"),
        command=rgb("#77fbdf"),
        plan=rgb("#b75190"),
        caution=rgb("#ecc76e"),
        danger=rgb("#f10716"),
        ink=rgb("#f1f3f6"),
        casing=rgb("#0b0d10"),
        floor=rgb("#353d44"),
        far=rgb("#15181c"),
        line=rgb("#7d8791"),
        label=rgb("#b4bcc7"),
    ),
    Theme.LIGHT: Palette(
        estimate=rgb("#23428c"),
        command=rgb("#038676"),
        plan=rgb("#9b69d4"),
        caution=rgb("#b47c06"),
        danger=rgb("#a30127"),
        ink=rgb("#14171b"),
        casing=rgb("#ffffff"),
        floor=rgb("#e1e5e9"),
        far=rgb("#c7cdd4"),
        line=rgb("#8d98a5"),
        label=rgb("#454d59"),
    ),
}
"""Colour-blind people can distinguish any two of the first five."""
STALE: Rgb = (128, 132, 138)
"""Colour of stale data in both themes."""


ROOT = "/w"
"""The world frame, `odom`, the parent of all nodes. It moves so that the followed robot stays in
place.
"""


TRUE_POSES, ALTERNATIVE_POSES, TRAILS = f"{ROOT}/t", f"{ROOT}/o", f"{ROOT}/k"
"""Parent nodes of the true poses, alternative estimates and trails of all robots."""
ROUTES = f"{ROOT}/p"
"""Parent node of all planned paths."""
METRES = f"{ROOT}/l"
"""Parent node of the metre labels."""
GROUND_NODE = f"{ROOT}/f"
"""Parent node of the pictures of cameras above the floor."""
PAST_NODE = f"{ROOT}/h"
"""Node of a robot's past state, in the scene of its page."""
_SHARED_NODES = {
    Layer.TRUTH: TRUE_POSES,
    Layer.OTHER: ALTERNATIVE_POSES,
    Layer.TRAIL: TRAILS,
    Layer.ROUTE: ROUTES,
    Layer.LABELS: METRES,
}
_ROBOT_NODES = {
    Layer.SETPOINT: "s",
    Layer.ARROWS: "a",
    Layer.REGION: "e",
    Layer.PREDICTED: "g",
    Layer.ENVELOPE: "b",
    Layer.LABELS: "n",
}
AXLES, HEADING, FAULT = "d", "h", "j"
"""Child nodes of a robot: axles with contacts, heading mark and fault ring."""


def robot_node(robot_id: str) -> str:
    """Return the node at the floor projection of `base_link`."""
    return f"{ROOT}/r/{robot_id}"


class NodeOwner(NamedTuple):
    """Robot and theme of a node."""

    robot_id: str | None
    """Robot that it belongs to, or None for a node of the stage."""
    theme: Theme | None
    """Theme whose clients see it, or None for all clients."""


_ROBOT_PARENTS = {f"{ROOT}/r": 1} | dict.fromkeys(
    (TRUE_POSES, ALTERNATIVE_POSES, TRAILS, ROUTES), 0
)
"""Parents of a node for each robot, and the levels between that and the node of a theme."""
_THEMES = {str(theme): theme for theme in Theme}


@lru_cache(maxsize=8192)
def node_owner(name: str) -> NodeOwner:
    """Return robot and theme of a node."""
    for parent, levels in _ROBOT_PARENTS.items():
        if name.startswith(f"{parent}/"):
            robot_id, *below = name.removeprefix(f"{parent}/").split("/")
            return NodeOwner(robot_id, _THEMES.get(below[levels]) if below[levels:] else None)
    return NodeOwner(None, None)


def overlay_node(layer: Layer, robot_id: str) -> str:
    """Return the node that shows a robot's layer and moves with the robot."""
    return f"{robot_node(robot_id)}/{_ROBOT_NODES[layer]}"


def layer_nodes(layer: Layer, robot_ids: Iterable[str]) -> set[str]:
    """Return the nodes to hide for a layer; hiding includes their children."""
    robot_ids = list(robot_ids)
    shared = {_SHARED_NODES[layer]} if layer in _SHARED_NODES else set[str]()
    own = {overlay_node(layer, one) for one in robot_ids if layer in _ROBOT_NODES}
    axles = {f"{robot_node(one)}/{AXLES}" for one in robot_ids if layer is Layer.ARROWS}
    return shared | own | axles


ROBOT_COLOURS: tuple[Rgb, ...] = (
    (31, 156, 230),
    (237, 9, 101),
    (5, 132, 103),
    (162, 150, 2),
    (76, 80, 248),
    (211, 121, 154),
    (118, 106, 7),
    (195, 13, 149),
)
"""Each has a contrast of at least 3 : 1 to the light and the dark background, and
colour-blind people can distinguish any two.
"""


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
