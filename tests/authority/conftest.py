"""An authority with time in hand."""

import pytest

from tests.authority.stage import Stage


@pytest.fixture
def stage() -> Stage:
    """A robot that has just been switched on."""
    return Stage()
