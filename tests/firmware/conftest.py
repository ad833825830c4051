"""The firmware is built once; every test looks at its pulses in the end."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest

from firmware.simulator.board import build, build_native
from firmware.simulator.rp2040_board import build_rp2040

pytest.register_assert_rewrite(
    *(f"tests.firmware.{name}" for name in ("rules", "source_rules", "telemetry_rules")),
    *(f"tests.firmware.{name}" for name in ("trip_rules", "wheel_rules")),
)

from tests.support.firmware_host import Bench  # noqa: E402


@pytest.fixture(scope="session")
def elf() -> Path:
    return build()


@pytest.fixture(scope="session")
def native() -> Path:
    return build_native()


@pytest.fixture(scope="session")
def rp2040() -> Path:
    return build_rp2040()


def checked(program: Path, **defaults: object) -> Generator[Bench]:
    it = Bench(program, **defaults)
    try:
        yield it
        it.finish()
    finally:
        it.close()


@pytest.fixture
def bench(elf: Path) -> Generator[Bench]:
    yield from checked(elf)


@pytest.fixture
def native_bench(native: Path) -> Generator[Bench]:
    """As `bench`, with the program compiled for this machine: four times as fast."""
    yield from checked(native)


@pytest.fixture
def rp2040_bench(rp2040: Path) -> Generator[Bench]:
    """As `bench`, with the program compiled for the RP2040 and executed by rp2040js."""
    yield from checked(rp2040)


@pytest.fixture
def sbus_bench(native: Path) -> Generator[Bench]:
    """As `native_bench`, with receivers that send frames of SBUS."""
    yield from checked(native, sbus=True)
