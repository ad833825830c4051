"""A sheet of paper that writes SVG: lines, arrows, arcs and text, on a light ground."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from xml.sax.saxutils import escape

INK, GREY, PALE = "#1f2933", "#7b8794", "#e4e7eb"
RED, GREEN, BLUE = "#c62828", "#2e7d32", "#1565c0"
AMBER, ORANGE = "#b26a00", "#d9480f"

Point = tuple[float, float]


class Sheet:
    """Elements in drawing order; x to the right and y down, in pixels."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self._size = (width, height)
        self._title = title
        self._elements: list[str] = []
        self._heads: set[str] = set()

    def text(
        self,
        at: Point,
        words: str,
        *,
        size: float = 14,
        colour: str = INK,
        anchor: str = "middle",
        style: str = "",
        halo: bool = True,
    ) -> None:
        """Write `words`; a newline begins a new line, `_` lowers the next letter.

        `style` may hold `b` and `i`.
        """
        weight = ' font-weight="600"' if "b" in style else ""
        slant = ' font-style="italic"' if "i" in style else ""
        for row, line in enumerate(words.split("\n")):
            x, y = at[0], at[1] + row * size * 1.2
            place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}"'
            if halo:
                # Firefox and librsvg draw a stroke over the fill whatever paint-order says.
                edge = 'fill="none" stroke="#fff" stroke-width="4" stroke-linejoin="round"'
                self._add(f"<text {place}{weight}{slant} {edge}>{_lowered(line)}</text>")
            self._add(f'<text {place}{weight}{slant} fill="{colour}">{_lowered(line)}</text>')

    def line(
        self,
        points: Sequence[Point],
        *,
        colour: str = INK,
        width: float = 1.5,
        dash: str = "",
        arrow: bool = False,
        fill: str = "none",
    ) -> None:
        """Draw a polyline, with a head at its end when it is an arrow."""
        path = "M" + " L".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.path(path, colour=colour, width=width, dash=dash, arrow=arrow, fill=fill)

    def path(
        self,
        path: str,
        *,
        colour: str = INK,
        width: float = 1.5,
        dash: str = "",
        arrow: bool = False,
        fill: str = "none",
    ) -> None:
        """Draw path data."""
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        if arrow:
            self._heads.add(colour)
            extra += f' marker-end="url(#head-{colour[1:]})"'
        stroke = f'stroke="{colour}" stroke-width="{width:g}" stroke-linejoin="round"'
        self._add(f'<path d="{path}" fill="{fill}" {stroke}{extra}/>')

    def circle(
        self, at: Point, radius: float, *, colour: str = INK, fill: str = "none", width: float = 1.5
    ) -> None:
        """Draw a circle."""
        self._add(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}" fill="{fill}" '
            f'stroke="{colour}" stroke-width="{width:g}"/>'
        )

    def box(
        self, corner: Point, size: Point, *, colour: str = INK, fill: str = "#fff", dash: str = ""
    ) -> None:
        """Draw a rounded rectangle."""
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        self._add(
            f'<rect x="{corner[0]:.1f}" y="{corner[1]:.1f}" width="{size[0]:g}" '
            f'height="{size[1]:g}" rx="8" fill="{fill}" stroke="{colour}" '
            f'stroke-width="1.5"{extra}/>'
        )

    def arc(
        self,
        centre: Point,
        radius: float,
        start_deg: float,
        end_deg: float,
        *,
        colour: str = INK,
        width: float = 1.5,
        arrow: bool = False,
    ) -> None:
        """Draw an arc; degrees turn counter-clockwise on the page, from the right."""
        (x0, y0), (x1, y1) = (polar(centre, radius, a) for a in (start_deg, end_deg))
        large, sweep = int(abs(end_deg - start_deg) > 180.0), int(end_deg < start_deg)
        path = f"M{x0:.1f},{y0:.1f} A{radius:g},{radius:g} 0 {large} {sweep} {x1:.1f},{y1:.1f}"
        self.path(path, colour=colour, width=width, arrow=arrow)

    def svg(self) -> str:
        """Return the document."""
        width, height = self._size
        heads = "".join(
            f'<marker id="head-{colour[1:]}" viewBox="0 0 10 10" refX="9" refY="5" '
            'markerUnits="userSpaceOnUse" markerWidth="11" markerHeight="11" orient="auto">'
            f'<path d="M0,1 L10,5 L0,9 z" fill="{colour}"/></marker>'
            for colour in sorted(self._heads)
        )
        rows = "\n".join(self._elements)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img" '
            'font-family="DejaVu Sans, Verdana, Helvetica, Arial, sans-serif">\n'
            f"<title>{escape(self._title)}</title>\n<defs>{heads}</defs>\n"
            f'<rect width="{width}" height="{height}" rx="10" fill="#fff"/>\n{rows}\n</svg>\n'
        )

    def _add(self, element: str) -> None:
        self._elements.append(element)


def _lowered(line: str) -> str:
    """Return a line of text with its indices lowered."""
    low = r'<tspan dy="3" font-size="75%">\1</tspan><tspan dy="-3">&#8203;</tspan>'
    return re.sub(r"_(\w)", low, escape(line))


def polar(centre: Point, radius: float, angle_deg: float) -> Point:
    """Return a point around `centre`; degrees turn counter-clockwise on the page."""
    angle = math.radians(angle_deg)
    return centre[0] + radius * math.cos(angle), centre[1] - radius * math.sin(angle)
