"""What many tests of the dashboard need running."""

from __future__ import annotations

from collections.abc import Generator

import pytest
import viser

from tsd_twin.dashboard.scene import viser_compat


@pytest.fixture(scope="module")
def server() -> Generator[viser.ViserServer]:
    started = viser_compat.start_server("test")
    yield started
    started.stop()
