"""Materials of robots on the stage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from tsd_twin.dashboard.scene.appearance import Rgb
from tsd_twin.models import solids
from tsd_twin.models.solids import Part
from tsd_twin.robots.description import Body

_Rgba: TypeAlias = tuple[float, float, float, float]


class _Look(NamedTuple):
    rgba: _Rgba
    metallic: float
    roughness: float


_DEFAULTS = Body()
_DECK = _Look((0.875, 0.886, 0.898, 1.0), 0.0, 0.55)
_RIBS = _Look((0.624, 0.690, 0.749, 1.0), 0.0, 0.6)
"""Ribs join decks and would not be seen in their colour."""
_LOOKS: Mapping[tuple[float, ...], _Look] = {
    _DEFAULTS.acrylic_rgba: _DECK,
    _DEFAULTS.frame_rgba: _Look((0.765, 0.784, 0.808, 1.0), 0.75, 0.38),
    _DEFAULTS.wheel_rgba: _Look((1.0, 0.416, 0.075, 1.0), 0.0, 0.42),
    solids.BLACK.rgba: _Look((0.169, 0.180, 0.200, 1.0), 0.05, 0.5),
    solids.ANODISED.rgba: _Look((0.227, 0.243, 0.275, 1.0), 0.6, 0.38),
    solids.BOARD.rgba: _Look((0.043, 0.353, 0.388, 1.0), 0.1, 0.5),
    solids.SHRINK.rgba: _Look((0.173, 0.310, 0.620, 1.0), 0.0, 0.45),
    solids.WHITE.rgba: _Look((0.851, 0.855, 0.859, 1.0), 0.0, 0.55),
}
"""Looks of the built-in materials, by their colour."""
_TINT_SHARE = 0.6
"""Fraction of the tint colour in tinted parts."""


def staged(part: Part) -> Part:
    """Return a part as it looks on the stage: opaque, custom colours unchanged."""
    material = part.material
    own = _Look((*material.rgba[:3], 1.0), material.metallic, material.roughness)
    look = _LOOKS.get(tuple(material.rgba), own)
    if part.name == "ribs" and look is _DECK:
        look = _RIBS
    return replace(part, material=replace(material, **look._asdict()))


def tinted(drawn: Iterable[Part], colour: Rgb) -> list[Part]:
    """Return parts with all their colours mixed with another."""
    tint = np.array(colour) / 255.0
    return [
        replace(part, material=replace(part.material, rgba=_mixed(part, tint))) for part in drawn
    ]


def _mixed(part: Part, tint: np.ndarray) -> _Rgba:
    r, g, b = (1.0 - _TINT_SHARE) * np.array(part.material.rgba[:3]) + _TINT_SHARE * tint
    return float(r), float(g), float(b), 1.0
