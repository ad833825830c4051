"""The shadow twin of a page: its thread runs only while a page shows it."""

from __future__ import annotations

import threading

from tests.support.page_client import site


def twins() -> int:
    return sum(thread.name == "shadow" for thread in threading.enumerate())


def test_it_runs_while_a_page_shows_it_and_ends_with_the_server() -> None:
    with site() as place, place.page() as page:
        page.until(lambda: page.state)
        assert page.state["shadow"] is None
        assert twins() == 0
        page.send(t="shadow", on=True)
        page.until(lambda: (page.state["shadow"] or {})["compared_s"] > 0.5)
        assert twins() == 1
        report = page.state["shadow"]
        assert report["drifts"] == []
        assert len(report["joints"]) == 9
        page.send(t="shadow", on=False)
        page.until(lambda: page.state["shadow"] is None)
    assert twins() == 0
