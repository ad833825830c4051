"""Overlay colours are distinguishable in both themes, also with colour vision deficiency."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tsd_twin.dashboard.scene.appearance import PALETTES, ROBOT_COLOURS, Rgb, Theme
from tsd_twin.lie import Array

pytestmark = pytest.mark.computes

MACHADO_2009 = {
    "normal": np.eye(3),
    "protan": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deutan": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritan": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
"""Matrices at full severity, for linear sRGB (Machado, Oliveira and Fernandes, 2009)."""
_TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_WHITE_D65 = np.array([0.95047, 1.0, 1.08883])


def seen_by(colour: tuple[int, int, int], vision: str) -> Array:
    """Return the CIELAB coordinates (3,) of an sRGB colour for a vision."""
    part = np.array(colour) / 255.0
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    seen = np.clip(MACHADO_2009[vision] @ linear, 0.0, 1.0)
    ratio = _TO_XYZ @ seen / _WHITE_D65
    x, y, z = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16.0) / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def ciede2000(one: Array, other: Array) -> float:
    """Return the colour difference of CIELAB coordinates (3,), as in Sharma et al. (2005)."""
    mean = 0.5 * float(np.hypot(one[1], one[2]) + np.hypot(other[1], other[2]))
    grow = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25.0**7))
    chroma_1, hue_1 = _polar(grow * one[1], one[2])
    chroma_2, hue_2 = _polar(grow * other[1], other[2])
    light, chroma = 0.5 * (one[0] + other[0]), 0.5 * (chroma_1 + chroma_2)
    apart = (hue_2 - hue_1 + 180.0) % 360.0 - 180.0
    hue = hue_1 + 0.5 * apart if chroma_1 * chroma_2 else hue_1 + hue_2
    weight = 1.0
    for share, times, shift in (
        (-0.17, 1, -30.0),
        (0.24, 2, 0.0),
        (0.32, 3, 6.0),
        (-0.20, 4, -63.0),
    ):
        weight += share * np.cos(np.radians(times * hue + shift))
    middle = (light - 50.0) ** 2
    lightness = (other[0] - one[0]) / (1.0 + 0.015 * middle / np.sqrt(20.0 + middle))
    saturation = (chroma_2 - chroma_1) / (1.0 + 0.045 * chroma)
    turn = 2.0 * np.sqrt(chroma_1 * chroma_2) * np.sin(np.radians(0.5 * apart))
    turn /= 1.0 + 0.015 * chroma * weight
    blue = 60.0 * np.exp(-(((hue % 360.0 - 275.0) / 25.0) ** 2))
    coupling = -2.0 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7)) * np.sin(np.radians(blue))
    squares = lightness**2 + saturation**2 + turn**2
    return float(np.sqrt(squares + coupling * saturation * turn))


def _polar(a: float, b: float) -> tuple[float, float]:
    return float(np.hypot(a, b)), float(np.degrees(np.arctan2(b, a))) % 360.0


HUES = ("estimate", "command", "plan", "caution", "danger")
LEAST = 18.0
LEAST_OF_ROBOTS = 14.0


def distance(one: Rgb, other: Rgb, vision: str) -> float:
    return ciede2000(seen_by(one, vision), seen_by(other, vision))


@pytest.mark.parametrize("vision", MACHADO_2009)
@pytest.mark.parametrize("theme", Theme)
def test_any_two_hues_of_a_theme_are_told_apart(theme: Theme, vision: str) -> None:
    colours = [getattr(PALETTES[theme], hue) for hue in HUES]
    for one, other in itertools.combinations(colours, 2):
        assert distance(one, other, vision) >= LEAST, (one, other)


@pytest.mark.parametrize("vision", MACHADO_2009)
def test_any_two_robots_of_a_fleet_are_told_apart(vision: str) -> None:
    for one, other in itertools.combinations(ROBOT_COLOURS, 2):
        assert distance(one, other, vision) >= LEAST_OF_ROBOTS, (one, other)


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((63.0109, -31.0961, -5.8663), (62.8187, -29.7946, -4.0864), 1.2630),
        ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_distances_are_those_of_sharma_and_others(
    one: tuple[float, float, float], other: tuple[float, float, float], expected: float
) -> None:
    """Test data from Sharma, Wu and Dalal (2005)."""
    assert ciede2000(np.array(one), np.array(other)) == pytest.approx(expected, abs=1e-4)
