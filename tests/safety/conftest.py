"""A supervisor with a manually advanced clock."""

import pytest

from tests.safety.supervisor_harness import SupervisorHarness


@pytest.fixture
def stage() -> SupervisorHarness:
    """A robot that has just been switched on."""
    return SupervisorHarness()
