"""A scene with per-client views, for the tests of views."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.dashboard.scene.view_desk import OTHER_PAGE, PAGE, ViewDesk
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import ViserClient
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.scene import Scene


@pytest.fixture(scope="module")
def module_desk() -> Generator[ViewDesk]:
    server = viser_compat.start_server("test")
    yield ViewDesk(server, Scene(server))
    server.stop()


@pytest.fixture
def desk(module_desk: ViewDesk) -> Generator[ViewDesk]:
    yield module_desk
    module_desk.clear()


@pytest.fixture
def feed(desk: ViewDesk) -> RobotFeed:
    robot = RobotFeed()
    desk.scene.add(robot)
    return robot


@pytest.fixture
def viewer(desk: ViewDesk, feed: RobotFeed) -> Generator[ViserClient]:
    del feed  # The robot exists before the client connects.
    with desk.opened(PAGE) as client:
        yield client


@pytest.fixture
def onlooker(desk: ViewDesk, viewer: ViserClient) -> Generator[ViserClient]:
    del viewer
    with desk.opened(OTHER_PAGE) as client:
        yield client
