"""Access to recordings for users limited to some robots, over HTTP and sockets."""

from __future__ import annotations

import shutil
from collections.abc import Generator
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from tests.dashboard.recorded.test_recording_library import Client, drive
from tests.support.gateway_requests import PHRASE
from tests.support.page_client import Page, Site, site
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.security import Role
from tsd_twin.security.router_rules import RobotRights
from tsd_twin.security.users import Users

NAME, UNKNOWN = "drive.mcap", "unknown.mcap"
PAGE = "00000000000000a1"
TITLE = {"title": "Mine"}
READS = ("path", "lanes", "export?as=mcap")
CHANGES = (("PUT", "/title", TITLE), ("GET", "/download", None), ("DELETE", "", None))


@pytest.fixture
def users() -> Users:
    """Users who may drive `tsd`, watch it, or only use another robot."""
    made = Users({})
    own = {
        "driver": RobotRights(use=frozenset({"tsd", "other"})),
        "watcher": RobotRights(use=frozenset({"other"}), watch=frozenset({"tsd"})),
        "stranger": RobotRights(use=frozenset({"other"})),
    }
    for name, rights in own.items():
        made.put(name, Role.OPERATOR, PHRASE, may_stop=False, rights=rights)
    return made


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drive(tmp_path_factory.mktemp("recorded") / NAME, "alice")


@pytest.fixture
def served(users: Users, recorded: Path, tmp_path: Path) -> Generator[Site]:
    folder = tmp_path / "drives"
    folder.mkdir()
    shutil.copy(recorded, folder)
    auth = AuthMiddleware(AccessSettings(users=users))
    with site(auth=auth, recordings=folder) as made:
        yield made


def status_of(client: Client, method: str, name: str, path: str, body: object = None) -> int:
    data = None if body is None else b'{"title": "Mine"}'
    return client.raw(method, f"/recordings/{name}{path}", data)[0].status


def test_a_stranger_finds_nothing_and_is_answered_as_for_an_unknown_file(served: Site) -> None:
    client = Client(served, "stranger")
    assert client.names() == []
    for path in READS:
        answers = [client.raw("GET", f"/recordings/{each}/{path}") for each in (NAME, UNKNOWN)]
        assert [answer.status for answer, _ in answers] == [404, 404]
        assert answers[0][1] == answers[1][1]
    for method, path, body in CHANGES:
        assert status_of(client, method, NAME, path, body) == 404
    for each in (NAME, UNKNOWN):
        with pytest.raises(InvalidStatus, match="404"):
            Page(served.port, PAGE, cookie=client.cookie, recording=each)


def test_a_watcher_shows_and_exports_but_changes_and_downloads_nothing(served: Site) -> None:
    client = Client(served, "watcher")
    assert client.names() == [NAME]
    for path in READS:
        assert status_of(client, "GET", NAME, f"/{path}") == 200
    for method, path, body in CHANGES:
        assert status_of(client, method, NAME, path, body) == 403
    assert client.names() == [NAME]
    page = Page(served.port, PAGE, cookie=client.cookie, recording=NAME)
    page.until(lambda: page.last("welcome"))
    page.close()


def test_a_driver_changes_the_own_recordings_and_undoes_the_own_deletions(served: Site) -> None:
    client, stranger = Client(served, "driver"), Client(served, "stranger")
    for method, path, body in CHANGES[:2]:
        assert status_of(client, method, NAME, path, body) == 200
    status, deletion = client.ask("DELETE", f"/recordings/{NAME}")
    assert status == 200
    assert stranger.ask("GET", "/recordings/trash") == (200, [])
    restore = f"/recordings/trash/{deletion['id']}/restore"
    assert stranger.ask("POST", restore)[0] == 404
    assert [row["id"] for row in client.ask("GET", "/recordings/trash")[1]] == [deletion["id"]]
    assert client.ask("POST", restore)[0] == 200
    assert client.names() == [NAME]
