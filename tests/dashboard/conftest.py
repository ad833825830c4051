"""What many tests of the dashboard need running."""

from __future__ import annotations

from collections.abc import Generator

import pytest
import viser

from tsd_twin.dashboard.viser_compat import viser_server


@pytest.fixture(scope="module")
def server() -> Generator[viser.ViserServer]:
    started = viser_server.start_server("test")
    yield started
    started.stop()
