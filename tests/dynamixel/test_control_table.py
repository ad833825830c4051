"""The control table and the files generated from it."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.markdown_pages import ROOT
from tsd_twin.hardware.dynamixel.__main__ import files, main
from tsd_twin.hardware.dynamixel.control_table import ADDRESS, BLOCKS, Block, Telemetry


@pytest.mark.parametrize("name", sorted(files()))
def test_the_committed_files_are_those_that_are_made(name: str) -> None:
    assert (ROOT / name).read_text("utf-8") == files()[name], (
        "run: python -m tsd_twin.hardware.dynamixel"
    )


def test_the_program_writes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--to", str(tmp_path)]) == 0
    printed = capsys.readouterr().out.split()
    written = {path.relative_to(tmp_path).as_posix() for path in map(Path, printed)}
    assert written == set(files())
    for name, text in files().items():
        assert (tmp_path / name).read_text("utf-8") == text


def test_who_it_is_stands_first() -> None:
    """A bridge must recognise another table version, whatever else changes."""
    assert [ADDRESS[name] for name in ("model", "fw", "table_version")] == [0, 2, 3]


def test_names_are_there_once_and_limits_hold_the_default() -> None:
    items = [item for block in BLOCKS for item in block.items()]
    assert len({item.name for item in items}) == len(items)
    for block in BLOCKS:
        for item in block.items():
            assert (item.limits is None) == (block.ACCESS == "r"), item.name
            if item.limits:
                least, most = item.limits
                assert all(least <= value <= most for value in item.values), item.name


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_has_a_place_and_packs_to_its_bytes(block: type[Block]) -> None:
    assert ADDRESS[block.NAME] == block.ADDRESS == ADDRESS[block.items()[0].name]
    assert block.LAYOUT.size == sum(struct.calcsize(f"<{item.layout}") for item in block.items())
    assert block.unpack(block().pack()) == block()


@given(st.binary(min_size=Telemetry.LAYOUT.size, max_size=Telemetry.LAYOUT.size))
def test_any_bytes_are_a_telemetry_that_packs_to_them(data: bytes) -> None:
    assert Telemetry.unpack(data).pack() == data


def test_a_compiler_places_the_items_where_the_structs_have_them(tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    assert compiler, "a C compiler is needed"
    names = [item.name for block in BLOCKS for item in block.items()]
    prints = "".join(f'  P("{name}", offsetof(control_table_t, {name}));\n' for name in names)
    source = tmp_path / "where.c"
    source.write_text(
        f'#include <stddef.h>\n#include <stdio.h>\n#include "{ROOT}/firmware/control_table.h"\n'
        '#define P(name, at) printf("%s %d\\n", name, (int)(at))\n'
        f"int main(void) {{\n{prints}  return 0;\n}}\n"
    )
    program = tmp_path / "where"
    subprocess.run([compiler, "-Wall", "-Werror", str(source), "-o", str(program)], check=True)
    output = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    found = dict(line.split() for line in output.splitlines())
    assert {name: int(at) for name, at in found.items()} == {n: ADDRESS[n] for n in names}
