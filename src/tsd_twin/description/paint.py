"""The materials that parts are made of; those with a colour in the description are made there."""

from __future__ import annotations

from tsd_twin.description.part import Material
from tsd_twin.robots.robot import Body

STEEL = Material((0.62, 0.64, 0.67, 1.0), 0.85, 0.34, 7800.0)
COPPER = Material((0.80, 0.42, 0.22, 1.0), 0.75, 0.4, 8900.0)
ANODISED = Material((0.20, 0.22, 0.26, 1.0), 0.6, 0.38, 2700.0)
BLACK = Material((0.115, 0.12, 0.135, 1.0), 0.1, 0.5, 1300.0)
RUBBER = Material((0.11, 0.11, 0.12, 1.0), 0.0, 0.85, 1200.0)
WHITE = Material((0.93, 0.93, 0.92, 1.0), 0.0, 0.55, 1050.0)
BOARD = Material((0.01, 0.33, 0.42, 1.0), 0.1, 0.5, 1850.0)
SHRINK = Material((0.10, 0.20, 0.62, 1.0), 0.0, 0.4, 1900.0)
YELLOW = Material((0.98, 0.74, 0.05, 1.0), 0.0, 0.5, 1100.0)
RED = Material((0.80, 0.06, 0.06, 1.0), 0.0, 0.5, 1300.0)
BLUE = Material((0.08, 0.32, 0.80, 1.0), 0.0, 0.5, 1300.0)


def acrylic(body: Body) -> Material:
    """Return the sheet that decks and ribs are cut from."""
    return Material(body.acrylic_rgba, 0.0, 0.12, 1180.0)


def frame(body: Body) -> Material:
    """Return the aluminium of the gimbal frames."""
    return Material(body.frame_rgba, 0.8, 0.36, 2700.0)


def shell(body: Body) -> Material:
    """Return the plastic of the wheels."""
    return Material(body.wheel_rgba, 0.0, 0.45, 1200.0)


def front(body: Body) -> Material:
    """Return what the arrow is made of."""
    return Material(body.front_rgba, 0.0, 0.5, 1200.0)
