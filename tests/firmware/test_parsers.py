"""Parsers of the firmware, compiled for this machine with sanitizers, on random bytes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from firmware.simulator.board import FIRMWARE

ROUNDS = 5000
SPOILT = (
    ("packet.c", "length > PACKET_LONGEST - HEADER ? 0", "length > 300 ? 0"),
    ("protocol1.c", "reply[3] > sizeof reply - 4", "reply[3] > 250"),
    ("esc_telemetry.c", "line->count >= ESC_TELEMETRY_PACKET", "line->count > 200"),
    ("protocol2.c", "within(i32(data), MOST_SPEED)", "i32(data)"),
)


def fuzz(program: Path, seed: int) -> subprocess.CompletedProcess[str]:
    run = [str(program), str(seed), str(ROUNDS)]
    return subprocess.run(run, capture_output=True, text=True, check=False)


def build(folder: Path, goal: str) -> Path:
    run = ["make", "-s", "-C", str(folder), goal]
    subprocess.run(run, check=True)
    return folder / goal


@pytest.fixture(scope="module")
def program() -> Path:
    return build(FIRMWARE, "build/fuzz")


@pytest.mark.parametrize("seed", range(4))
def test_no_bytes_lead_out_of_bounds_or_to_undefined_behaviour(program: Path, seed: int) -> None:
    result = fuzz(program, seed)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("seed", range(2))
def test_nothing_from_outside_leads_to_undefined_behaviour_or_pulses_while_disarmed(
    seed: int,
) -> None:
    program = build(FIRMWARE, "build/fuzz_board")
    result = fuzz(program, seed)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout.split()[2]) > ROUNDS // 40, "it has to be armed, or nothing is shown"


@pytest.mark.parametrize(("file", "old", "new"), SPOILT)
def test_a_missing_bound_is_noticed(file: str, old: str, new: str, tmp_path: Path) -> None:
    text = (FIRMWARE / file).read_text(encoding="utf-8")
    assert text.count(old) == 1, old
    for path in [*FIRMWARE.glob("*.[ch]"), FIRMWARE / "Makefile"]:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "fuzz").mkdir()
    (tmp_path / "fuzz/packets.c").write_bytes((FIRMWARE / "fuzz/packets.c").read_bytes())
    (tmp_path / file).write_text(text.replace(old, new), encoding="utf-8")
    program = build(tmp_path, "build/fuzz")
    assert any(fuzz(program, seed).returncode for seed in range(4))
