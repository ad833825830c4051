"""The shadow twin of a page runs while a page shows it or its robot is driven."""

from __future__ import annotations

import threading
from typing import Any

from tests.support.page_client import site


def twins() -> int:
    return sum(thread.name == "shadow" for thread in threading.enumerate())


def test_it_runs_while_a_page_shows_it_and_ends_with_the_server() -> None:
    with site() as place, place.page() as page:

        def report() -> dict[str, Any]:
            """Return the latest report, empty before the first."""
            found: dict[str, Any] | None = page.state["shadow"]
            return found or {}

        page.until(lambda: page.state)
        assert report() == {}
        assert twins() == 0
        page.send(t="shadow", on=True)
        page.until(lambda: report()["compared_s"] > 0.5)
        assert twins() == 1
        assert report()["drifts"] == []
        assert len(report()["joints"]) == 9
        page.send(t="shadow", on=False)
        page.until(lambda: page.state["shadow"] is None)
    assert twins() == 0


def test_it_runs_for_a_robot_that_is_driven_while_no_page_shows_it() -> None:
    with site() as place, place.page() as page:
        page.until(lambda: page.state)
        assert twins() == 0
        page.make_ready()
        page.until(lambda: twins() == 1)
        assert page.state["shadow"] is None
        page.send(t="shadow", on=True)
        page.until(lambda: (page.state["shadow"] or {"compared_s": 0.0})["compared_s"] > 0.0)
    assert twins() == 0
