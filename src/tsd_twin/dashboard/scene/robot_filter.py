"""Filters that keep the robots a user may not watch out of a client's scene."""

from __future__ import annotations

from functools import partial

from viser.infra import Message

from tsd_twin.dashboard.scene.appearance import ROOT, robot_of_node
from tsd_twin.dashboard.scene.viser_compat import MessageFilter
from tsd_twin.security.router_rules import ALL, parse_robots


def visible_robots(robots: str) -> frozenset[str] | None:
    """Return the robots that a client may show, from its header, or None for all."""
    visible = parse_robots(filter(None, robots.split(",")))
    return None if ALL in visible else visible


_CREATION = "FrameMessage"


def robot_filters(robots: str) -> tuple[MessageFilter, MessageFilter] | None:
    """Return filters for messages of the shared scene and of the client's own, or None for none.

    `robots` lists the robots that the client may show, or is `all`.
    """
    if (visible := visible_robots(robots)) is None:
        return None
    return partial(_is_permitted, visible, shared=True), partial(_is_permitted, visible)


def _is_permitted(visible: frozenset[str], message: Message, *, shared: bool = False) -> bool:
    name = getattr(message, "name", None)
    if not isinstance(name, str):
        return True
    if name == ROOT:
        # The shared world follows the first robot, so its pose is that robot's.
        return not shared or type(message).__name__ == _CREATION
    robot = robot_of_node(name)
    return robot is None or robot in visible
