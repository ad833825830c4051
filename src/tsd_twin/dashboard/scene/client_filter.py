"""Filters of messages to clients, by the robots that a user may watch, and by theme."""

from __future__ import annotations

from functools import partial

import viser
from viser.infra import Message

from tsd_twin.dashboard.scene.appearance import ROOT, Theme, node_owner
from tsd_twin.dashboard.scene.viser_compat import MessageFilter, look_of, robots_of
from tsd_twin.security.router_rules import ALL, parse_robots


def visible_robots(robots: str) -> frozenset[str] | None:
    """Return the robots that a client may show, from its header, or None for all."""
    visible = parse_robots(filter(None, robots.split(",")))
    return None if ALL in visible else visible


def client_filters(
    server: viser.ViserServer, client_id: int
) -> tuple[MessageFilter, MessageFilter]:
    """Return two filters for a new client: for the shared scene, and for its private messages."""
    visible = visible_robots(robots_of(server, client_id))
    theme = Theme.DARK if "dark" in look_of(server, client_id) else Theme.LIGHT
    return shared_filter(visible, theme), partial(_is_permitted, visible)


def shared_filter(visible: frozenset[str] | None, theme: Theme) -> MessageFilter:
    """Return the filter of the shared scene for a client that shows a theme.

    `visible` are the robots that it may show, None for all.
    """
    return partial(_is_shared, visible, theme)


def _is_permitted(visible: frozenset[str] | None, message: Message) -> bool:
    name = getattr(message, "name", None)
    if visible is None or not isinstance(name, str):
        return True
    robot_id = node_owner(name).robot_id
    return robot_id is None or robot_id in visible


_CREATION = "FrameMessage"


def _is_shared(visible: frozenset[str] | None, theme: Theme, message: Message) -> bool:
    name = getattr(message, "name", None)
    if not isinstance(name, str):
        return True
    if name == ROOT:
        # The shared world follows the first robot, so its pose is that robot's.
        return visible is None or type(message).__name__ == _CREATION
    owner = node_owner(name)
    if owner.theme not in (None, theme):
        return False
    return visible is None or owner.robot_id is None or owner.robot_id in visible
