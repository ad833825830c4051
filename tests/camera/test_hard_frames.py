"""In difficult pictures, no pose is far off, and complete tags are used."""

from __future__ import annotations

import numpy as np
import pytest

from tests.camera.hard_frames import SMALLEST_PX, hard_frames, tally
from tsd_twin.camera.detect import find_tags
from tsd_twin.camera.lens import CameraPlace, Lens, View
from tsd_twin.camera.render import Body, SimulatedCamera, cylinder
from tsd_twin.camera.tags import Tag


@pytest.mark.timeout(1500)
@pytest.mark.parametrize(("count", "seed"), [(60, 0), (2_500, 1)])
def test_no_pose_is_five_centimetres_off_and_whole_tags_are_used(count: int, seed: int) -> None:
    """Glare, occlusion, other tags, sides of 25 to 80 px, and tilts of up to 3 degrees."""
    found = tally(count, seed)
    assert found.frames == count
    assert not found.wrong, found.refused
    assert found.whole > 0.2 * count
    # With few frames, allow one miss.
    assert found.whole_used >= min(0.95 * found.whole, found.whole - 1), found.refused
    assert found.used > found.whole_used


def test_frames_are_as_hard_as_described() -> None:
    view = View(Lens.ideal(1280, 720, 60.0), CameraPlace.looking_down(2.8))
    frames = list(hard_frames(SimulatedCamera(view), np.random.default_rng(2)))
    whole = sum(is_whole for *_, is_whole in frames)
    assert 0.2 < whole / len(frames) < 0.8
    assert min(side for _, _, side, _ in frames) > SMALLEST_PX


def test_tag_with_a_border_on_a_dark_robot_is_found_at_the_edge_of_the_picture() -> None:
    """Both edges of the white border are square outlines."""
    random = np.random.default_rng(0)
    view = View(Lens.ideal(1280, 720, 60.0), CameraPlace.looking_down(2.7))
    camera = SimulatedCamera(view)
    tag = Tag(3, 0.16, "tsd", 0.3)
    robot = Body([cylinder(0.2, 0.29)], [tag])
    for column in np.linspace(100.0, 1180.0, 20):
        # The tag side is 74 px, and half its diagonal 65 px with the border.
        place = view.on_plane(np.array([[column, 720.0 - 72.0]]), tag.height_m)[0]
        pose = np.array([*place, random.uniform(-3.1, 3.1)])
        seen = find_tags(camera.draw([(robot, [pose])]), [tag.family], view.lens)
        assert [each.number for each in seen] == [3]
