"""What is kept in EEPROM: the count of power-ups, in sixteen cells in turn.

Here without the chip: `make mutants` runs these too.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from tests.support.firmware_host import Bench, FirmwareHost, number

FIRST, SIZE, CELLS = 128, 4, 16


def cells(pilot: FirmwareHost) -> list[bytes]:
    peek = pilot.simulation.board.peek_eeprom
    return [bytes(peek(FIRST + SIZE * i + j) for j in range(SIZE)) for i in range(CELLS)]


def started(pilot: FirmwareHost, *, power: bool) -> int:
    """Reset; return the number of the start."""
    pilot.simulation.board.reset(power=power)
    pilot.simulation.run(0.1)
    return number(pilot, "nonce", 2)


def test_power_ups_are_counted_in_cells_in_turn_and_resets_are_not(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    before, written = number(pilot, "nonce", 2), Counter[int]()
    for _ in range(40):
        old = cells(pilot)
        session = (before, number(pilot, "nonce", 2, 1))
        assert started(pilot, power=False) == before
        assert (before, number(pilot, "nonce", 2, 1)) != session
        assert cells(pilot) == old, "a reset writes nothing"
        after = started(pilot, power=True)
        assert after == before + 1
        before = after
        written.update(i for i, cell in enumerate(cells(pilot)) if cell != old[i])
    assert set(written) == set(range(CELLS))
    assert max(written.values()) <= 3


def test_the_count_goes_on_behind_its_largest_number(native_bench: Bench) -> None:
    pilot = native_bench.pilot()
    for start in (0, 1, 32767, 32768, 40000, 65535):
        for i in range(CELLS):
            value = (start - i) % 65536
            at = FIRST + SIZE * (value % CELLS)
            for j, byte in enumerate((value | (value ^ 0xFFFF) << 16).to_bytes(4, "little")):
                pilot.simulation.board.poke_eeprom(at + j, byte)
        assert started(pilot, power=True) == (start + 1) % 65536


def test_a_write_that_was_cut_leaves_the_count_before(native_bench: Bench) -> None:
    random = np.random.default_rng(1)
    pilot = native_bench.pilot()
    pilot.simulation.run(0.1)
    for _ in range(30):
        old = number(pilot, "nonce", 2)
        before = cells(pilot)
        assert started(pilot, power=True) == old + 1
        changed = [i for i, cell in enumerate(cells(pilot)) if cell != before[i]]
        assert changed == [(old + 1) % CELLS]
        whole = cells(pilot)[changed[0]]
        cut = int(random.integers(1, SIZE))
        for j in range(cut, SIZE):
            pilot.simulation.board.poke_eeprom(FIRST + SIZE * changed[0] + j, before[changed[0]][j])
        # A byte that was not written may be what it was to be.
        lost = cells(pilot)[changed[0]] != whole
        assert started(pilot, power=True) == old + (1 if lost else 2)
