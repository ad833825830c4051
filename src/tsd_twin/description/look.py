"""The look of a robot: all its parts, drawn from its description."""

from __future__ import annotations

from typing import TypeAlias

from tsd_twin.description import chassis, inner, outer, wheel
from tsd_twin.description.layout import Layout
from tsd_twin.description.part import Drawing, Link, Part
from tsd_twin.robots import Robot

Parts: TypeAlias = dict[Link, tuple[Part, ...]]
"""Parts of each kind of link; modules are alike, so `outer`, `inner` and `wheel` are there once."""


def draw(robot: Robot) -> Parts:
    """Return the parts of each kind of link, in the frame of the link, drawn to the description.

    Raises:
        RobotFileError: there is no room for the modules.
        MeshError: a drawing does not make a closed solid; a bug.
    """
    layout, body = Layout.of(robot), robot.body
    modules: dict[Link, list[Drawing]] = {
        "outer": outer.drawings(layout, body),
        "inner": inner.drawings(body),
        "wheel": wheel.drawings(body),
    }
    parts: Parts = {"chassis": _parts("chassis", chassis.drawings(layout, body))}
    m = layout.scale
    for link, drawings in modules.items():
        scaled = [drawing._replace(solid=drawing.solid.scale([m, m, m])) for drawing in drawings]
        parts[link] = _parts(link, scaled)
    return parts


def _parts(link: Link, drawings: list[Drawing]) -> tuple[Part, ...]:
    # A robot without room for a kind of part simply has none, no standoffs for example.
    there = [drawing for drawing in drawings if not drawing.solid.is_empty()]
    return tuple(Part.drawn(link, drawing) for drawing in there)
