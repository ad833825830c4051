"""What can be shown and hidden, and the names of the nodes that it hangs on."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

ROOT = "/w"
"""The world, `odom`: everything hangs on it. It moves so that the robot keeps its place."""


class Layer(StrEnum):
    """What a client may hide; the values are the words of the panel."""

    SETPOINT = "set-point"
    TRUTH = "true pose"
    OTHER = "other estimate"
    TRAIL = "trail"
    ROUTE = "planned path"
    ARROWS = "thrust arrows"
    ELLIPSE = "covariance ellipse"
    PREDICTED = "predicted pose"
    ENVELOPE = "stop envelope"
    LABELS = "labels"


TRUTHS, OTHERS, TRAILS, SCALE = f"{ROOT}/t", f"{ROOT}/o", f"{ROOT}/k", f"{ROOT}/l"
"""Nodes of all robots' true poses, of what else is estimated, of all trails, and of the metres on
the floor."""
ROUTES = f"{ROOT}/p"
"""Node of all planned paths."""
_SHARED = {
    Layer.TRUTH: TRUTHS,
    Layer.OTHER: OTHERS,
    Layer.TRAIL: TRAILS,
    Layer.ROUTE: ROUTES,
    Layer.LABELS: SCALE,
}
_EACH = {
    Layer.SETPOINT: "s",
    Layer.ARROWS: "a",
    Layer.ELLIPSE: "e",
    Layer.PREDICTED: "g",
    Layer.ENVELOPE: "b",
    Layer.LABELS: "n",
}


def robot_node(robot_id: str) -> str:
    """Return the node that stands on the floor below a robot, and turns with it."""
    return f"{ROOT}/r/{robot_id}"


def mark_node(layer: Layer, robot_id: str) -> str:
    """Return the node that shows a layer of one robot and moves with it."""
    return f"{robot_node(robot_id)}/{_EACH[layer]}"


def layer_nodes(layer: Layer, robot_ids: Iterable[str]) -> set[str]:
    """Return the nodes to hide so that a layer cannot be seen: what is below them is hidden too."""
    shared = {_SHARED[layer]} if layer in _SHARED else set[str]()
    return shared | {mark_node(layer, one) for one in robot_ids if layer in _EACH}
