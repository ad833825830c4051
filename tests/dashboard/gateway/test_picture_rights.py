"""Robot cameras require the right to watch the robot; floor cameras, to watch all."""

from __future__ import annotations

import asyncio
import json
from types import SimpleNamespace
from typing import Any, cast

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from tsd_twin.dashboard.gateway.auth import PRINCIPAL
from tsd_twin.dashboard.gateway.pictures import PictureRoutes
from tsd_twin.messages.pictures import CameraName
from tsd_twin.security.router_rules import ALL, EVERY_ROBOT, RobotRights

AHEAD, BEHIND, ABOVE = (
    CameraName("ahead", "lab1"),
    CameraName("behind", "lab2"),
    CameraName("above"),
)
NAMES = {name.key: name for name in (AHEAD, BEHIND, ABOVE)}
CASES = [
    (RobotRights(), set[CameraName]()),
    (RobotRights(use=frozenset({"lab1"})), {AHEAD}),
    (RobotRights(use=frozenset({"lab1"}), watch=frozenset({"lab2"})), {AHEAD, BEHIND}),
    (RobotRights(watch=frozenset({ALL})), {AHEAD, BEHIND, ABOVE}),
    (EVERY_ROBOT, {AHEAD, BEHIND, ABOVE}),
]


def routes() -> PictureRoutes:
    feeds = {key: SimpleNamespace(name=name) for key, name in NAMES.items()}
    return PictureRoutes(
        cast("Any", SimpleNamespace(feeds=feeds)), cast("Any", None), cast("Any", None)
    )


@pytest.mark.parametrize(("rights", "seen"), CASES)
def test_the_list_names_the_cameras_that_a_login_may_see(
    rights: RobotRights, seen: set[CameraName]
) -> None:
    request = make_mocked_request("GET", "/cameras")
    request[PRINCIPAL] = cast("Any", SimpleNamespace(rights=rights))
    answer = asyncio.run(routes().serve_list(request))
    assert isinstance(answer, web.Response)
    assert {each["key"] for each in json.loads(cast("bytes", answer.body))} == {
        name.key for name in seen
    }


@pytest.mark.parametrize("key", [*NAMES, "floor/none", ""])
@pytest.mark.parametrize(("rights", "seen"), CASES)
def test_a_camera_that_a_login_may_not_see_is_answered_like_none(
    rights: RobotRights, seen: set[CameraName], key: str
) -> None:
    request = make_mocked_request("GET", f"/pictures?camera={key}")
    principal = cast("Any", SimpleNamespace(rights=rights, key=None))
    answer = web.HTTPBadRequest if NAMES.get(key) in seen else web.HTTPNotFound
    with pytest.raises(answer):  # The handshake, checked last, is missing.
        asyncio.run(routes().serve(request, "page", principal))
