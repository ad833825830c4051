"""A client restricted to some robots receives nothing of the others."""

from __future__ import annotations

import json
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
import viser
from websockets.sync.client import connect

from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import CAMERA, ViserClient
from tsd_twin import robots
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.client_views import ClientViews, PageView
from tsd_twin.dashboard.scene.robot_filter import robot_filters, visible_robots
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.wire.view import Layer, TruePoseDisplay, ViewSettings

HERS, HIDDEN = "lab1", "hidden"
PAGE = "0" * 16
FAR = np.array([777.25, 888.5, 0.5])
"""Position of the hidden robot."""


@pytest.fixture
def server() -> Generator[viser.ViserServer]:
    made = viser_compat.start_server("test")
    viser_compat.limit_clients(made, robot_filters)
    yield made
    made.stop()


def client_of(server: viser.ViserServer, shown: str) -> ViserClient:
    headers = {
        viser_compat.KEY_HEADER: viser_compat.access_key(),
        viser_compat.PAGE_HEADER: PAGE,
        viser_compat.ROBOTS_HEADER: shown,
    }
    socket = connect(
        f"ws://127.0.0.1:{server.get_port()}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers,
        compression=None,
        max_size=None,
    )
    client = ViserClient(socket)
    client.send(CAMERA)
    return client


def play(scene: Scene, views: ClientViews) -> None:
    """Show all scene features of two robots, the hidden one first."""
    robot = robots.load_robot("tsd")
    feeds = {name: RobotFeed(name, robot) for name in (HIDDEN, HERS)}
    for feed in feeds.values():
        scene.add(feed)
    hers = np.array([1.0, 2.0, 0.0])
    for name, pose in ((HIDDEN, FAR), (HERS, hers)):
        feeds[name].say(pose=pose)
        scene.show_route(name, np.array([pose, pose + 1.0]))
    scene.draw()
    scene.set_stale(HIDDEN, True)
    settings = ViewSettings(true_pose=TruePoseDisplay.ALWAYS, hidden=tuple(Layer)[:2], dark=False)
    for view in views.of_page(PAGE):
        view.apply(settings, look=True)
    for step in range(5):
        feeds[HIDDEN].say(pose=FAR + step)
        feeds[HERS].say(pose=hers + 0.1 * step)
        scene.draw()


def text_of(messages: list[dict[str, Any]]) -> str:
    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else repr(value)

    return json.dumps(messages, default=plain)


@pytest.mark.parametrize("shown", [HERS, "all", ""])
def test_a_client_gets_no_message_about_a_hidden_robot(
    server: viser.ViserServer, shown: str
) -> None:
    scene = Scene(server, separate=True)
    views = ClientViews(server, scene, view_of=lambda _page: PageView(robot_id=HERS))
    client = client_of(server, shown)
    try:
        client.until(lambda: bool(views.of_page(PAGE)))
        play(scene, views)
        server.scene.add_frame("/end")
        server.flush()
        client.until(lambda: "/end" in client.shared)
        text = text_of(client.messages)
    finally:
        client.socket.close()
    leaks = HIDDEN in text or any(number in text for number in ("777.", "888.", "778."))
    assert leaks == (shown == "all")
    assert (f"/w/r/{HERS}" in text) == (shown != "")


@pytest.mark.parametrize("robots_in_header", ["", "lab1", "lab1,lab2", "all", "all,lab1"])
def test_the_header_names_the_robots_or_all(robots_in_header: str) -> None:
    names = robots_in_header.split(",") if robots_in_header else []
    expected = None if "all" in names else frozenset(names)
    assert visible_robots(robots_in_header) == expected
    assert (robot_filters(robots_in_header) is None) == (expected is None)
