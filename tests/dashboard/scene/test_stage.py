"""The stage: exact colours, opaque robots, dashes, fading trails and metre labels."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.dashboard.scene.appearance import PALETTES, Rgb, Theme
from tsd_twin.dashboard.scene.framing import Rectangle, Stand, frame_robot, pictured
from tsd_twin.dashboard.scene.metres import metre_places, text_picture
from tsd_twin.dashboard.scene.paths import trail_shares
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.dashboard.scene.stage import contact_shadow
from tsd_twin.dashboard.scene.themed import dashes
from tsd_twin.dashboard.scene.unlit import (
    before_tone_mapping,
    linear,
    srgb,
    tone_mapped,
    unlit_glb,
)
from tsd_twin.lie import Array
from tsd_twin.robots import load_robot, robot_names

channels = st.integers(20, 220)


@given(colour=st.tuples(channels, channels, channels))
def test_srgb_is_the_inverse_of_linear(colour: Rgb) -> None:
    np.testing.assert_allclose(255.0 * srgb(linear(colour)), colour, atol=1e-6)


@given(level=st.integers(0, 225))
def test_greys_are_shown_as_they_are_asked_for(level: int) -> None:
    shown = 255.0 * srgb(tone_mapped(before_tone_mapping((level, level, level))))
    np.testing.assert_allclose(shown, level, atol=2.0)


@pytest.mark.parametrize("theme", Theme)
def test_hues_are_shown_close_to_their_colour(theme: Theme) -> None:
    for colour in PALETTES[theme]:
        shown = 255.0 * srgb(tone_mapped(before_tone_mapping(colour)))
        assert np.abs(shown - colour).max() < 35.0, colour


def glb_head(data: bytes) -> dict[str, object]:
    assert data[:4] == b"glTF"
    assert int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length])


@pytest.mark.parametrize(("opacity", "mode"), [(1.0, "OPAQUE"), (0.5, "BLEND")])
def test_an_unlit_mesh_blends_only_if_it_is_translucent(opacity: float, mode: str) -> None:
    faces = np.array([[0, 1, 2]], np.uint32)
    head = glb_head(unlit_glb(np.eye(3), faces, np.full((3, 4), opacity)))
    (material,) = head["materials"]  # type: ignore[misc]
    assert material["alphaMode"] == mode
    assert "KHR_materials_unlit" in material["extensions"]


@pytest.mark.parametrize("name", robot_names())
def test_robots_are_opaque_and_have_a_soft_shadow(name: str) -> None:
    shape = robot_shape(load_robot(name))
    for data in shape.glbs.values():
        for material in glb_head(data)["materials"]:  # type: ignore[attr-defined]
            assert material.get("alphaMode", "OPAQUE") == "OPAQUE"
    (blob,) = glb_head(contact_shadow(shape.footprint))["materials"]  # type: ignore[misc]
    assert blob["alphaMode"] == "BLEND"


@given(
    corners=st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=2, max_size=8),
    dash=st.floats(0.02, 0.5),
    gap=st.floats(0.02, 0.5),
)
def test_dashes_cover_their_share_of_a_path(
    corners: list[tuple[float, float]], dash: float, gap: float
) -> None:
    path = np.array(corners)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())
    drawn = dashes(path, dash, gap)
    covered = float(np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=-1).sum())
    periods, rest = divmod(length, dash + gap)
    assert covered == pytest.approx(periods * dash + min(rest, dash), abs=1e-6 + 1e-3 * length)


@given(ages=st.lists(st.floats(0.0, 40.0), min_size=2, max_size=20))
def test_the_trail_fades_with_its_age_and_is_never_gone(ages: list[float]) -> None:
    shares = trail_shares(np.sort(ages))
    assert (np.diff(shares) <= 0.0).all()
    assert (shares > 0.2).all()
    assert trail_shares(np.zeros(1))[0] == 1.0


def test_a_negative_metre_has_a_minus_sign() -> None:
    negative, positive = (text_picture(f"y {metre} m", (255, 255, 255)) for metre in (-1, 1))
    assert negative.shape[1] > positive.shape[1] + 30  # A hyphen is narrower,
    assert negative.shape[0] == positive.shape[0]  # and the box of an unknown sign is higher.


places = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))


@settings(max_examples=30)
@given(xy=places, heading=st.floats(-math.pi, math.pi), left=st.floats(0.0, 0.3))
def test_metre_labels_are_on_their_line_in_the_free_rectangle_and_apart(
    xy: tuple[float, float], heading: float, left: float
) -> None:
    free = Rectangle(left, 0.0, 1.0, 0.9)
    pose = frame_robot(Stand(xy, 0.27, 0.18), heading, 1.7, 0.55, free)
    labels = metre_places(xy, pose, 1.7, 0.55, free)
    assert len(labels) >= 2
    seen: list[Array] = []
    for text, at in labels.items():
        letter, metre, _ = text.split()
        assert at["xy".index(letter)] == pytest.approx(int(metre))
        (place,) = pictured(pose, np.array([[*at, 0.0]]), 1.7, 0.55)
        assert free.left < place[0] < free.right
        assert free.top < place[1] < free.bottom
        seen.append(place)
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(one - other) > 0.05
