"""The firmware is built once; every test looks at its pulses in the end."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest

from firmware.simulator.board import build

pytest.register_assert_rewrite("tests.firmware.laws", "tests.firmware.pilot")

from tests.support.firmware_host import Bench  # noqa: E402


@pytest.fixture(scope="session")
def elf() -> Path:
    return build()


@pytest.fixture
def bench(elf: Path) -> Generator[Bench]:
    it = Bench(elf)
    try:
        yield it
        it.finish()
    finally:
        it.close()
