"""Portraits require the right to watch the robot; for other users they do not exist."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from tsd_twin.dashboard.gateway.auth import PRINCIPAL
from tsd_twin.dashboard.gateway.portraits import PortraitRoutes
from tsd_twin.robots import load_robot
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights

LINKS: dict[str, Any] = {"lab1": SimpleNamespace(robot=load_robot("kiwi"))}


def ask(robot: str, rights: RobotRights) -> tuple[int, object]:
    async def answered() -> web.StreamResponse:
        routes = web.UrlDispatcher()
        PortraitRoutes(LINKS).add_to(routes)
        path = f"/portraits/{robot}"
        match = await routes.resolve(make_mocked_request("GET", path))
        request = make_mocked_request("GET", path, match_info=dict(match))
        request[PRINCIPAL] = cast("Any", SimpleNamespace(rights=rights))
        return await match.handler(request)

    try:
        answer = asyncio.run(answered())
    except web.HTTPException as refused:
        return refused.status, refused.text
    assert isinstance(answer, web.Response)
    return answer.status, answer.body


@pytest.mark.parametrize("rights", [RobotRights(frozenset({"lab2"})), RobotRights(frozenset())])
def test_a_robot_that_a_user_may_not_watch_is_answered_like_none(rights: RobotRights) -> None:
    assert ask("lab1", rights) == ask("lab7", rights) == ask("lab7", EVERY_ROBOT)


@pytest.mark.parametrize(
    "rights",
    [EVERY_ROBOT, RobotRights(frozenset({"lab1"})), RobotRights(watch=frozenset({"lab1"}))],
)
def test_those_who_may_use_or_watch_it_get_its_portrait(rights: RobotRights) -> None:
    status, body = ask("lab1", rights)
    assert status == 200
    assert isinstance(body, bytes)
