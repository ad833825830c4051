"""`python -m tsd_twin.dynamixel`: write the C headers, the Python structs and the page of the docs
from the control table and the servo models.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from textwrap import wrap

from tsd_twin.dynamixel import control_table
from tsd_twin.dynamixel.control_table import (
    ADDRESS,
    BLOCKS,
    TABLE_SIZE,
    Block,
    BoardMode,
    Item,
    ReceiverKind,
    Refusal,
    ResetCause,
    Trip,
    Type,
)
from tsd_twin.dynamixel.servo_models import MODELS, ServoModel, span

_BY = "python -m tsd_twin.dynamixel"
_C_TYPES: dict[Type, str] = {
    "u8": "uint8_t",
    "u16": "uint16_t",
    "u32": "uint32_t",
    "i16": "int16_t",
}
_LETTERS: dict[Type, str] = {"u8": "B", "u16": "H", "u32": "I", "i16": "h"}
_ACCESS = {"r": "read only", "w": "read and write", "setup": "read; write while disarmed"}
_CONSTANTS = (
    "MODEL",
    "FW_VERSION",
    "BOARD_ID",
    "TABLE_VERSION",
    "SERVOS",
    "ESCS",
    "RC_CHANNELS",
    "RECEIVER_CHANNELS",
    "STICKS",
)
_CODES: tuple[type[IntEnum], ...] = (BoardMode, Trip, Refusal, ReceiverKind)
_C_NAMES: dict[type[IntEnum], str] = {BoardMode: "BOARD", ReceiverKind: "RECEIVER"}
_THROTTLES = ("ZERO_THROTTLE", "FULL_THROTTLE")


def files() -> dict[str, str]:
    """Return what is made, by its path from the root of the project."""
    return {
        "firmware/control_table.h": header(),
        "firmware/servo_models.h": models(),
        "src/tsd_twin/dynamixel/blocks.py": structs(),
        "docs/control_table.md": page(),
    }


def header() -> str:
    """C header: constants, addresses, the packed struct, and one row for each item."""
    lines = [
        f"// Made by `{_BY}` from src/tsd_twin/dynamixel/control_table.py; do not edit.",
        "// The control table: little endian, packed. Error 4: a value beyond its limits; error 7:",
        "// not writable, or not now.",
        "#ifndef CONTROL_TABLE_H",
        "#define CONTROL_TABLE_H",
        "",
        "#include <stdint.h>",
        "",
        *(f"#define CT_{name} {getattr(control_table, name)}" for name in _CONSTANTS + _THROTTLES),
        f"#define CT_SIZE {TABLE_SIZE}",
        "",
    ]
    for codes in _CODES:
        lines += [f"typedef enum {{  // {codes.__doc__}"]
        lines += [f"  {_c_name(codes)}_{code.name} = {code.value}," for code in codes]
        lines += [f"}} {_c_name(codes).lower()}_code_t;", ""]
    for block in BLOCKS:
        upper = block.name.upper()
        lines += [f"// {block.doc}"]
        lines += [f"#define CT_{upper} {ADDRESS[block.name]}"]
        lines += [f"#define CT_{upper}_SIZE {block.size}", ""]
    lines += ["typedef struct __attribute__((packed)) {"]
    for block in BLOCKS:
        lines += [f"  // {block.name}: {_ACCESS[block.access]}"]
        for item in block.items:
            array = f"[{item.count}]" if item.count > 1 else ""
            unit = f" [{item.unit}]" if item.unit else ""
            lines += [
                f"  {_C_TYPES[item.type]} {item.name}{array};"
                f"  // {ADDRESS[item.name]}: {item.doc}{unit}"
            ]
    lines += ["} control_table_t;", ""]
    lines += ['_Static_assert(sizeof(control_table_t) == CT_SIZE, "the table is packed");', ""]
    lines += ["// X(name, address, type, count, default, rise from entry to entry): every item."]
    lines += _macro("CT_ITEMS", [(b, i) for b in BLOCKS for i in b.items], limited=False)
    lines += ["", "// X(name, address, type, count, least, most): every item that can be written."]
    lines += _macro("CT_WRITABLE", [(b, i) for b in BLOCKS for i in b.items if i.limits], True)
    return "\n".join([*lines, "", "#endif", ""])


def models() -> str:
    """C header: the settings of each servo model, in the order in which they are read."""
    lines = [
        f"// Made by `{_BY}` from src/tsd_twin/dynamixel/servo_models.py; do not edit.",
        "// {address, size, bytes of the read that begins with it, least, most}",
    ]
    for model in MODELS.values():
        lines += [f"static const setting_t SETTINGS_{model.number}[] = {{", *_rows(model), "};"]
    lines += ["", "// {number, current in mA / 256, settings, how many}"]
    lines += ["static const servo_model_t MODELS[] = {"]
    for model in MODELS.values():
        current = round(256.0 * model.current_ma)
        name = f"SETTINGS_{model.number}"
        lines += [f"    {{{model.number}, {current}, {name}, {len(model.settings)}}},"]
    return "\n".join([*lines, "};", ""])


def _rows(model: ServoModel) -> list[str]:
    return [
        f"    {{{s.address}, {s.size}, {span(group) if s is group[0] else 0}, "
        f"{s.least}, {s.most}}},  // {s.name}"
        for group in model.reads()
        for s in group
    ]


def structs() -> str:
    """Python module: one frozen dataclass for each block."""
    lines = [
        f'"""Blocks of the control table as values; made by `{_BY}`, do not edit."""',
        "",
        "from __future__ import annotations",
        "",
        "from dataclasses import dataclass",
        "from struct import Struct",
        "from typing import ClassVar",
        "",
        "from tsd_twin.dynamixel.packets import Packed",
    ]
    for block in BLOCKS:
        lines += ["", "", *_dataclass(block)]
    return "\n".join([*lines, ""])


def page() -> str:
    """Page of the docs."""
    lines = [
        "# The control table of the board",
        "",
        f"<!-- Made by `{_BY}` from src/tsd_twin/dynamixel/control_table.py; do not edit. -->",
        "",
        f"The controller board is device {control_table.BOARD_ID} on its serial line and speaks "
        f"Dynamixel "
        "Protocol 2.0: `Ping`, `Read`, `Write`.",
        f"This is version {control_table.TABLE_VERSION} of its table, {TABLE_SIZE} bytes, little "
        f"endian, "
        "without gaps. [bridge.md](bridge.md) says how it is used.",
        "A value beyond its limits is answered with error 4, a write to what cannot be written (or "
        "not now) with error 7, other instructions with error 2; such a write has no effect.",
    ]
    for block in BLOCKS:
        lines += ["", f"## {block.name.capitalize()}", ""]
        lines += [f"{block.doc} {_ACCESS[block.access].capitalize()}; {block.size} bytes.", ""]
        lines += ["| Address | Name | Type | Unit | Default | Limits | What |"]
        lines += ["| ---: | --- | --- | --- | ---: | --- | --- |"]
        for item in block.items:
            kind = item.type + (f" × {item.count}" if item.count > 1 else "")
            limits = "{} to {}".format(*item.limits) if item.limits else ""
            lines += [
                f"| {ADDRESS[item.name]} | `{item.name}` | {kind} | {item.unit} "
                f"| {_default(item)} | {limits} | {item.doc} |"
            ]
    lines += ["", "## Codes"]
    for codes in (*_CODES, ResetCause):
        lines += ["", f"`{codes.__name__}`: "]
        lines[-1] += ", ".join(f"{c.value} {c.name}" for c in codes) + "."
    return "\n".join([*lines, ""])


def _default(item: Item) -> str:
    rising = range(item.default, item.default + item.rise * item.count, item.rise or 1)
    return ", ".join(map(str, rising)) or str(item.default)


def _c_name(codes: type[IntEnum]) -> str:
    return _C_NAMES.get(codes, codes.__name__.upper())


def _macro(name: str, rows: list[tuple[Block, Item]], limited: bool) -> list[str]:
    lines = [f"#define {name}(X)"]
    for _, item in rows:
        tail = (
            ", {}, {}".format(*item.limits or ()) if limited else f", {item.default}, {item.rise}"
        )
        of = f"{item.name}, {ADDRESS[item.name]}, {_C_TYPES[item.type]}, {item.count}"
        lines.append(f"  X({of}{tail})")
    return [f"{line} \\" for line in lines[:-1]] + [lines[-1]]


def _dataclass(block: Block) -> list[str]:
    layout = "<" + "".join(
        (str(item.count) if item.count > 1 else "") + _LETTERS[item.type] for item in block.items
    )
    lines = ["@dataclass(frozen=True, slots=True)", f"class {block.name.capitalize()}(Packed):"]
    lines += [f'    """{block.doc}"""', ""]
    lines += [f"    ADDRESS: ClassVar[int] = {ADDRESS[block.name]}"]
    lines += [f'    LAYOUT: ClassVar[Struct] = Struct("{layout}")', ""]
    for item in block.items:
        many = item.count > 1
        kind = "tuple[int, ...]" if many else "int"
        same = f"({item.default},) * {item.count}" if many else str(item.default)
        default = f"({_default(item)})" if item.rise else same
        unit = f" [{item.unit}]" if item.unit else ""
        lines += [f"    {item.name}: {kind} = {default}"]
        lines += _docstring(item.doc.removesuffix(".") + unit + ".")
    return lines


def _docstring(text: str) -> list[str]:
    line = f'    """{text}"""'
    if len(line) <= 100:
        return [line]
    first, *others = wrap(f'"""{text}', 95)
    return [f"    {part}" for part in (first, *others, '"""')]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files, say where, and return the exit status; `arguments` as in a shell."""
    parser = argparse.ArgumentParser(prog="python -m tsd_twin.dynamixel", description=__doc__)
    parser.add_argument("--to", type=Path, default=Path(), help="root of the project; default .")
    flags = parser.parse_args(arguments)
    for name, text in files().items():
        path: Path = flags.to / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
