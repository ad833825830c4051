"""Order and colours of the robots."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.scene.appearance import ROBOT_COLOURS, RobotRoster

IDS = st.lists(st.sampled_from("abcdefgh"), unique=True)
LIGHT, DARK = (255, 255, 255), (27, 31, 37)
"""Background colours of the page."""


@given(first=IDS, there=IDS)
def test_robots_that_were_named_come_first_in_that_order(
    first: list[str], there: list[str]
) -> None:
    order = RobotRoster(first).in_order(there)
    assert sorted(order) == sorted(there)
    named = [robot_id for robot_id in first if robot_id in there]
    assert order[: len(named)] == named
    assert order[len(named) :] == sorted(order[len(named) :])


@given(first=IDS, asked=st.lists(st.sampled_from("abcdefgh")))
def test_a_robot_keeps_its_colour_which_no_other_has(first: list[str], asked: list[str]) -> None:
    roster = RobotRoster(first)
    colours = {robot_id: roster.colour(robot_id) for robot_id in asked}
    assert colours == {robot_id: roster.colour(robot_id) for robot_id in reversed(asked)}
    assert len(set(colours.values())) == len(colours)


def luminance(colour: tuple[int, int, int]) -> float:
    """Relative luminance by the WCAG definition."""
    parts = [part / 255.0 for part in colour]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_colours_stand_out_on_light_and_dark_surfaces() -> None:
    for surface in (LIGHT, DARK):
        for colour in ROBOT_COLOURS:
            low, high = sorted((luminance(surface), luminance(colour)))
            assert (high + 0.05) / (low + 0.05) >= 3.0, (surface, colour)
