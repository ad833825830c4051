"""Shared fixtures of the dashboard tests."""

from __future__ import annotations

from collections.abc import Generator

import pytest
import viser

from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.sessions import teleop

PATIENT_S = 1.0


@pytest.fixture(autouse=True)
def patient_deadman(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pages stall for as long as `robot_node.PATIENT`, so that a busy machine ends no drive."""
    monkeypatch.setattr(teleop, "COMMAND_TIMEOUT_S", PATIENT_S)


@pytest.fixture(scope="module")
def server() -> Generator[viser.ViserServer]:
    started = viser_compat.start_server("test")
    yield started
    started.stop()
