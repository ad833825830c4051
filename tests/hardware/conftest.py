"""Devices in virtual time."""

from __future__ import annotations

import pytest

from tests.hardware.wired_machines import Wires


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    return Wires(monkeypatch)
