"""Runs programs as a user starts them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Generator, Iterable

import pytest
from playwright.sync_api import Browser, sync_playwright

from tests.support.browser import CHEAP_FLAGS, executable
from tests.support.programs import Program, starting
from tsd_twin.adapters.cmd_vel import PAUSE_S


def longest_pause_s(times_s: Iterable[float], since_s: float) -> float:
    """Return the longest gap between events from `since_s` until now."""
    within = [since_s, *(each for each in times_s if each > since_s), time.monotonic()]
    return max(after - before for before, after in itertools.pairwise(within))


def stays_put(moved_m: float, pushed_s: Iterable[float], since_s: float, withheld_s: float) -> None:
    """Check that a stick held since before did not move the robot.

    If the machine delayed the pushes by more than `PAUSE_S`, the robot counts the stick as
    released, and later pushes may move it.
    """
    pause_s = longest_pause_s(pushed_s, since_s)
    assert pause_s < PAUSE_S + withheld_s, "the stick was let go"
    assert moved_m < 0.01 or pause_s >= PAUSE_S


@pytest.fixture
def start() -> Generator[Callable[..., Program]]:
    """Start programs that end with the test."""
    with starting() as start_one:
        yield start_one


@pytest.fixture(scope="module")
def start_shared() -> Generator[Callable[..., Program]]:
    """Start programs that the tests of a module share."""
    with starting() as start_one:
        yield start_one


@pytest.fixture(scope="module")
def browser(request: pytest.FixtureRequest) -> Generator[Browser]:
    """Headless browser that renders the scene; tests may override the flags."""
    flags = list(getattr(request, "param", CHEAP_FLAGS))
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=executable(), args=flags)
        yield running
        running.close()
