"""Hues of the overlays are told apart in both themes, by colour-blind people as well."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.support.colour_vision import MACHADO_2009, ciede2000, seen_by
from tsd_twin.dashboard.scene.appearance import PALETTES, ROBOT_COLOURS, Rgb, Theme

pytestmark = pytest.mark.computes

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
    """Test data of Sharma, Wu and Dalal (2005)."""
    assert ciede2000(np.array(one), np.array(other)) == pytest.approx(expected, abs=1e-4)
