"""Floor camera pictures are in place, for clients that show them and all robots."""

from __future__ import annotations

import numpy as np
import pytest
import simplejpeg

from tests.dashboard.scene.view_desk import OTHER_PAGE, ViewDesk
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import ViserClient
from tsd_twin.dashboard.wire.view import TiltFactor, ViewSettings
from tsd_twin.messages.pictures import GroundGrid

GRID = GroundGrid((-1.0, 2.0), (3.0, 2.0), [[(0.0, 1.0), (1.0, 1.0)], [(0.0, 0.0), (1.0, 0.0)]])
NODE = "/w/f/floor-a"


def picture(brightness: int = 0) -> np.ndarray:
    return np.full((40, 60, 3), brightness, np.uint8)


def sent(viewer: ViserClient) -> np.ndarray:
    """Pixels sent to the client; in the browser, the first row has the least y."""
    return simplejpeg.decode_jpeg(viewer.node(NODE).props["_data"], "RGB")


def test_a_picture_is_drawn_where_its_floor_is_and_moves_with_the_world(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    feed.say(pose=np.array([1.0, 0.5, 0.0]))
    desk.scene.draw()
    desk.views.draw_ground("floor/a", picture(), GRID)
    assert not desk.views.show_ground
    desk.apply(floor_camera=True)
    assert desk.views.show_ground
    viewer.until(lambda: np.allclose(viewer.node("/w").position, (-1.0, -0.5, 0.0)))
    desk.views.draw_ground("floor/a", picture(), GRID)
    viewer.until(lambda: NODE in viewer.own)
    assert np.allclose(viewer.node(NODE).position[:2], (0.5, 3.0))
    half = picture()
    half[:20] = 255
    desk.views.draw_ground("floor/a", half, GRID)
    viewer.until(lambda: sent(viewer)[:10].mean() < 20 and sent(viewer)[-10:].mean() > 235)
    desk.apply(floor_camera=True, follow=False)
    desk.views.draw_ground("floor/a", picture(100), GRID)
    viewer.until(lambda: NODE in viewer.own)
    desk.views.draw_ground("floor/a")
    viewer.until(lambda: NODE not in viewer.own)


@pytest.mark.parametrize(("robots", "sees"), [("tsd", False), ("all", True)])
def test_only_a_client_that_may_see_all_robots_sees_the_floor(
    desk: ViewDesk, feed: RobotFeed, robots: str, sees: bool
) -> None:
    del feed
    with desk.opened(OTHER_PAGE, robots=robots) as viewer:
        desk.apply(OTHER_PAGE, floor_camera=True)
        assert desk.views.show_ground is sees
        desk.views.draw_ground("floor/a", picture(), GRID)
        desk.view(OTHER_PAGE).apply(ViewSettings(floor_camera=True, tilt=TiltFactor.TRUE))
        desk.views.draw_ground("floor/a", picture(), GRID)
        viewer.until(lambda: "/w" in viewer.own)
        if sees:
            viewer.until(lambda: NODE in viewer.own)
        assert (NODE in viewer.own) is sees
