"""What the firmware owes to the RP2040: its clock, lines, watchdog, converter and flash."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import pytest

from firmware.rp2040 import image
from firmware.simulator.board import FIRMWARE
from firmware.simulator.rp2040_board import Rp2040Board
from tests.firmware.rules import ALL_LAWS
from tests.support.firmware_host import Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import BoardMode, ResetCause, Setup, Trip

OF_THE_HARDWARE = (
    "zero_throttle_from_the_first_millisecond",
    "silence_stops",
    "a_hang_ends_in_a_reset_and_standstill",
    "broken_telemetry_is_no_wrong_speed",
)
"""`test_law_holds_on_an_rp2040` has all laws, and takes long."""


def board_of(pilot: FirmwareHost) -> Rp2040Board:
    board = pilot.simulation.board
    assert isinstance(board, Rp2040Board)
    return board


@pytest.mark.parametrize("name", OF_THE_HARDWARE)
def test_law_of_the_hardware_holds(name: str, rp2040_bench: Bench) -> None:
    ALL_LAWS[name](rp2040_bench)


def test_pulses_are_exact_to_half_a_microsecond_and_gimbals_follow(rp2040_bench: Bench) -> None:
    pilot = rp2040_bench.pilot(receiver=True).get_ready()
    assert pilot.arm().mode == BoardMode.ARMED
    goal = (120, -90, 60, 30, -100, 7)
    for throttle in ((2001, 2255, 2256), (3000, 2511, 2512)):
        seen = pilot.drive(0.3, throttle=throttle, goal=goal)
        assert seen.throttle_out == throttle
        assert pilot.simulation.pulses_us() == pytest.approx([t / 2 for t in throttle], abs=0.05)
    assert seen.position == goal
    assert (seen.servo_errors, seen.rx_errors, seen.crc_errors, seen.overruns) == (0, 0, 0, 0)
    assert pilot.missed == 0
    assert seen.rc == pytest.approx((1500, 1500, 1500, 1100, 1900, 1100), abs=2)
    # Servos with the shortest delay respond 20 us after the end of a request.
    assert 0.0 < board_of(pilot).turn_around_us < 10.0


def test_an_inverted_line_with_sbus_is_read_without_an_inverter(rp2040_bench: Bench) -> None:
    pilot = rp2040_bench.pilot(receiver=True, sbus=True).get_ready()
    assert pilot.arm().mode == BoardMode.ARMED
    assert pilot.telemetry().rc == pytest.approx((1500, 1500, 1500, 1100, 1900, 1100), abs=1)
    pilot.drive(0.2)
    pilot.simulation.set_signal(lost=True)
    assert pilot.drive(0.1).trip == Trip.RC_LOST


def test_setup_and_count_of_starts_outlive_more_starts_than_a_sector_has_pages(
    rp2040_bench: Bench,
) -> None:
    pilot = rp2040_bench.pilot()
    pilot.simulation.run(2.2)
    setup = Setup(goal_limit=300)
    assert pilot.set_up(setup) == 0
    pilot.simulation.run(0.2)
    starts = []
    for _ in range(40):  # Two sectors have 32 pages; each start writes one.
        pilot.simulation.power_cycle()
        pilot.simulation.run(0.1)
        seen = pilot.telemetry()
        assert (seen.setup_known, seen.reset_cause) == (1, ResetCause.POWER_ON)
        starts.append(seen.nonce[0])
    assert starts == list(range(2, 42))
    where = pilot.simulation.table_address + Setup.ADDRESS
    table = bytes(board_of(pilot).peek(where + i) for i in range(Setup.LAYOUT.size))
    assert Setup.unpack(table) == setup


def test_a_page_that_was_not_completely_written_is_skipped(rp2040_bench: Bench) -> None:
    """The last version before counts, and later ones are stored behind the broken page."""
    pilot = rp2040_bench.pilot()
    pilot.simulation.run(0.1)
    board = board_of(pilot)
    for start in (2, 3):
        board.break_next_page()
        pilot.simulation.power_cycle()
        pilot.simulation.run(0.1)
        assert pilot.telemetry().nonce[0] == start


def test_the_image_has_the_checksum_of_the_boot_rom_and_the_drive_file_all_of_it(
    rp2040: Path,
) -> None:
    data = rp2040.read_bytes()
    # Value of the CRC of "123456789" with these parameters, in any catalogue: CRC-32/MPEG-2.
    assert image.checksum(b"123456789") == 0x0376E6E7
    assert struct.unpack_from("<I", data, 252)[0] == image.checksum(data[:252])
    blocks = rp2040.with_suffix(".uf2").read_bytes()
    assert len(blocks) == 2 * len(data)
    payload = b"".join(blocks[i + 32 : i + 288] for i in range(0, len(blocks), 512))
    assert payload == data
    assert struct.unpack_from("<8I", blocks) == (
        0x0A324655, 0x9E5D5157, 0x2000, 0x10000000, 256, 0, len(data) // 256, 0xE48BFF56,
    )  # fmt: skip


def test_no_memory_of_the_program_is_the_one_of_the_boot(rp2040: Path) -> None:
    run = ["arm-none-eabi-nm", str(rp2040.with_suffix(".elf"))]
    listing = subprocess.run(run, check=True, capture_output=True, text=True).stdout
    ends = {line.split()[-1]: int(line.split()[0], 16) for line in listing.splitlines()}
    room = ends["__stack"] - max(ends["__bss_end"], ends["watchdog_memory"] + 64)
    assert room > 128 * 1024


def test_the_same_sources_are_the_same_build(tmp_path: Path, rp2040: Path) -> None:
    made = ["make", "-s", "-C", str(FIRMWARE), f"BUILD={tmp_path}", "rp2040"]
    subprocess.run(made, check=True)
    assert (tmp_path / "rp2040/firmware.bin").read_bytes() == rp2040.read_bytes()
