"""A client receives nothing of robots that it may not show, and no overlays in other colours."""

from __future__ import annotations

import json
import secrets
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
import viser
from websockets.sync.client import connect

from tests.support.link_sockets import eventually
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import CAMERA, ViserClient, viser_client
from tsd_twin import robots
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import Theme, node_owner
from tsd_twin.dashboard.scene.client_filter import visible_robots
from tsd_twin.dashboard.scene.client_views import ClientViews, PageView
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.wire.view import Layer, TruePoseDisplay, ViewSettings

HERS, HIDDEN = "lab1", "hidden"
PAGE, OTHER_PAGE = "0" * 16, "1" * 16
FAR = np.array([777.25, 888.5, 0.5])
"""Position of the hidden robot."""


@pytest.fixture
def server() -> Generator[viser.ViserServer]:
    made = viser_compat.start_server("test")
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


def play(scene: Scene, views: ClientViews, *, dark: bool = False) -> None:
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
    settings = ViewSettings(true_pose=TruePoseDisplay.ALWAYS, hidden=tuple(Layer)[:2], dark=dark)
    for view in views.of_page(PAGE):
        view.apply(settings, look=True)
    for step in range(5):
        feeds[HIDDEN].say(pose=FAR + step)
        feeds[HERS].say(pose=hers + 0.1 * step)
        scene.draw()


def until_sent(server: viser.ViserServer, client: ViserClient) -> None:
    """Wait until a client has received all messages of the shared scene."""
    last = f"/end{secrets.token_hex(8)}"
    server.scene.add_frame(last)
    server.flush()
    client.until(lambda: last in client.shared)


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
        until_sent(server, client)
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


def overlays_of(client: ViserClient, theme: Theme) -> dict[str, str]:
    """Return the shared overlays of a client in a theme, as text by their names."""
    nodes = list(client.shared.items())  # Its thread still receives.
    return {name: text_of([vars(node)]) for name, node in nodes if node_owner(name).theme is theme}


def test_a_client_that_changes_its_theme_shows_what_a_new_one_does(
    server: viser.ViserServer,
) -> None:
    """It receives the overlays of its theme only, and after a change what it has missed."""
    scene, dark = Scene(server), False
    views = ClientViews(server, scene, view_of=lambda _page: PageView(ViewSettings(dark=dark)))
    client = client_of(server, "all")
    try:
        client.until(lambda: bool(views.of_page(PAGE)))
        play(scene, views)
        for dark in (True, False, True):
            until_sent(server, client)
            received = len(client.messages)
            views.of_page(PAGE)[0].apply(ViewSettings(dark=dark))
            until_sent(server, client)
            theme, other = Theme if dark else reversed(Theme)
            with viser_client(server.get_port(), OTHER_PAGE, robots="all") as fresh:
                eventually(lambda: bool(views.of_page(OTHER_PAGE)))
                until_sent(server, fresh)
                assert overlays_of(client, theme) == overlays_of(fresh, theme) != {}
                assert overlays_of(client, other) == overlays_of(fresh, other) == {}
            eventually(lambda: not views.of_page(OTHER_PAGE))
            for robot_id in (HERS, HIDDEN):
                scene.remove(robot_id)
            play(scene, views, dark=dark)
            until_sent(server, client)
            themes = {
                node_owner(str(message.get("name"))).theme
                for message in client.messages[received:]
                if not message.get("owner") and message["type"] != "RemoveSceneNodeMessage"
            }
            assert themes == {None, theme}
    finally:
        client.socket.close()
