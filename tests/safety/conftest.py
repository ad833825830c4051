"""An authority with time in hand."""

import pytest

from tests.support.supervisor_harness import SupervisorHarness


@pytest.fixture
def stage() -> SupervisorHarness:
    """A robot that has just been switched on."""
    return SupervisorHarness()
