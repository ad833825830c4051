"""Map data: robots, trails and paths; a refused path is removed from map and scene."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import viser

from tests.support.page_client import Page, Site, site
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import ViserClient, viser_client
from tsd_twin.dashboard.scene.client_views import BackgroundWorker, ClientViews, SceneExecutor
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.sessions.map_data import TRAIL_POINTS, TRAIL_SPACING_M, MapTrail

ROUTE_NODE = "/w/p/tsd/dark/p"


@dataclass
class Stage:
    """A site whose pages have a scene, and a client connected to it."""

    site: Site
    scene: Scene
    viewer: ViserClient


@pytest.fixture(scope="module")
def stage(server: viser.ViserServer) -> Generator[Stage]:
    scene = Scene(server)
    scene.add(RobotFeed())
    views = ClientViews(server, scene)
    worker = BackgroundWorker("test")
    executor = SceneExecutor(worker, scene, lambda: views)
    with site(page_scene=executor) as made, viser_client(server.get_port(), None) as viewer:
        yield Stage(made, scene, viewer)
    worker.close()


def take_control(page: Page) -> None:
    page.until(lambda: page.state)
    page.until(lambda: page.take(take_over=True)["ok"])
    page.until(lambda: page.state["has_control"])


REFUSED: dict[str, dict[str, Any]] = {
    "too far": {"points": [[900.0, 0.0]], "on": "floor"},
    "not on the floor": {"points": [[0.5, 0.5]], "on": "picture"},
}


@pytest.mark.parametrize("reason", [*REFUSED, "no control"])
def test_a_refused_plan_takes_the_old_path_off_the_scene_and_the_map(
    stage: Stage, reason: str
) -> None:
    with stage.site.page() as page:
        take_control(page)
        page.send(t="map", on=True)
        x, y, _ = page.state["pose"]
        there = {"kind": "to", "points": [[x + 0.7, y + 0.4]], "on": "floor"}
        assert page.answer("plan", t="plan", **there)["ok"]
        stage.viewer.until(lambda: ROUTE_NODE in stage.viewer.shared)
        route = page.until(lambda: page.last("map_lines")["routes"]["tsd"])
        np.testing.assert_allclose(route[0], (x, y), atol=0.01)
        np.testing.assert_allclose(route[-1], (x + 0.7, y + 0.4), atol=0.01)
        assert page.last("map_lines")["trails"] is None, "the page has them"
        if reason == "no control":
            assert page.answer("lease", t="lease", op="release")["ok"]
        page.send(t="plan", **(there | REFUSED.get(reason, {})))
        page.until(lambda: [m for m in page.all("reply") if m["to"] == "plan" and not m["ok"]])
        stage.viewer.until(lambda: ROUTE_NODE not in stage.viewer.shared)
        page.until(lambda: page.last("map_lines")["routes"] == {})
        page.until(lambda: page.state["route"] is None)


def test_an_open_map_has_the_robots_where_they_are_and_where_they_have_been(stage: Stage) -> None:
    with stage.site.page() as page:
        page.make_ready()
        assert page.state["map"] is None
        assert page.all("map_lines") == []
        before = page.state["pose"]
        page.drive(vx=0.4)
        page.until(lambda: np.hypot(*np.subtract(page.state["pose"], before)[:2]) > 0.3)
        page.holds = None
        page.send(t="release")
        page.until(lambda: page.mode == "ready")
        page.send(t="map", on=True)
        page.until(lambda: page.state["map"])
        shown = page.state
        (robot,) = shown["map"]["robots"]
        np.testing.assert_allclose(robot["pose"], shown["pose"], atol=1e-4)
        assert (robot["id"], robot["stale"]) == ("tsd", False)
        assert robot["reach_m"] == pytest.approx(
            stage.scene.visuals["tsd"].meshes.shape.reach_m, abs=1e-3
        )
        trail = np.array(page.last("map_lines")["trails"]["tsd"])
        for pose in (before, page.state["pose"]):
            apart = np.hypot(*(trail - pose[:2]).T).min()
            assert apart < 2.0 * TRAIL_SPACING_M
        page.send(t="map", on=False)
        page.until(lambda: page.state["map"] is None)


def test_the_envelope_on_the_map_is_the_one_that_is_drawn(stage: Stage) -> None:
    overlay = stage.scene.visuals["tsd"].overlays.envelope
    with stage.site.page() as page:
        page.send(t="map", on=True)
        page.until(lambda: page.state["map"])
        assert page.state["map"]["envelope"] is None
        overlay.update(np.array([[0.0, 0.0, 0.0], [0.4, 0.1, 0.2]]))
        page.until(lambda: page.state["map"]["envelope"])
        envelope = page.state["map"]["envelope"]
        stage.viewer.until(lambda: np.allclose(drawn(stage.viewer), envelope, atol=1e-3))
        overlay.update(None)
        page.until(lambda: page.state["map"]["envelope"] is None)


def drawn(viewer: ViserClient) -> np.ndarray:
    """Corners of the floor area, in the robot frame."""
    return np.reshape(viewer.node("/w/r/tsd/b/dark/v/a").props["vertices"], (-1, 3))[:, :2]


def test_a_trail_is_thinned_breaks_where_the_pose_was_set_and_has_a_bound() -> None:
    trail = MapTrail()
    for x in (0.0, 0.02, 0.04, 0.06, 3.0, 3.1):
        trail.add(x, 0.0)
    assert list(trail.points) == [(0.0, 0.0), (0.06, 0.0), None, (3.0, 0.0), (3.1, 0.0)]
    for i in range(2 * TRAIL_POINTS):
        trail.add(3.1 + 0.1 * i, 0.0)
    assert len(trail.points) == TRAIL_POINTS
