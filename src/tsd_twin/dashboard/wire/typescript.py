"""TypeScript types of messages between page and server, of codes, sentences and texts of the page.

`python -m tsd_twin.dashboard.wire.typescript` writes `web/src/generated/` again, with `--check` it
only compares. It includes every struct of the modules in this package, so a new message needs no
entry here.
"""

from __future__ import annotations

import ast
import importlib
import inspect as source
import json
import pkgutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard, get_args

import msgspec
from msgspec import inspect

import tsd_twin.dashboard.wire as package
from tsd_twin.dashboard.wire import to_page
from tsd_twin.dashboard.wire.from_page import (
    Message,
    MotionMessage,
    PageMessage,
    RecordedPageMessage,
)
from tsd_twin.dashboard.wire.typescript_tables import HEADER, codes_module, sentences_module
from tsd_twin.dashboard.wire.typescript_texts import texts_module


def docs_of(cls: type) -> tuple[str, dict[str, str]]:
    """Return the docstring of a class, and the docstrings of all its fields by name."""
    fields: dict[str, str] = {}
    for each in reversed(cls.__mro__):
        if each.__module__.startswith("tsd_twin."):
            fields |= _field_docs(each)
    return source.cleandoc(cls.__doc__ or ""), fields


def _field_docs(cls: type) -> dict[str, str]:
    (tree,) = ast.parse(textwrap.dedent(source.getsource(cls))).body
    if not isinstance(tree, ast.ClassDef):
        raise TypeError(f"the source of {cls} is not a class")
    fields: dict[str, str] = {}
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        if not (isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)):
            continue
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            fields[before.target.id] = source.cleandoc(str(after.value.value))
    return fields


def block_comment(text: str, indent: str = "") -> str:
    """Return a text as a comment for the declaration below it."""
    rows = text.replace("*/", "* /").splitlines()
    if len(rows) == 1:
        return f"{indent}/** {rows[0]} */\n"
    body = "".join(f"{indent} * {row}".rstrip() + "\n" for row in rows)
    return f"{indent}/**\n{body}{indent} */\n"


def limits_text(kind: inspect.Type) -> str:
    """Return the limits of a field as a sentence; "" if it has none."""
    match kind:
        case inspect.UnionType(types=types):
            return " ".join(filter(None, map(limits_text, types)))
        case inspect.IntType() | inspect.FloatType():
            return _range_text(kind)
        case (
            inspect.StrType(max_length=int(most)) | inspect.ListType(max_length=int(most))
        ):  # fmt: skip
            unit = "characters" if isinstance(kind, inspect.StrType) else "items"
            return f"At most {most} {unit}."
        case _:
            return ""


def _range_text(kind: inspect.IntType | inspect.FloatType) -> str:
    least = f"At least {_number(kind.ge)}" if kind.ge is not None else ""
    above = f"More than {_number(kind.gt)}" if kind.gt is not None else ""
    most = f"at most {_number(kind.le)}" if kind.le is not None else ""
    text = ", ".join(filter(None, (least, above, most)))
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _number(value: float) -> str:
    return f"{value:g}" if abs(value) < 1e6 else f"{value:,.0f}".replace(",", " ")


FOLDER = Path(__file__).parents[4] / "web/src/generated"
"""Folder in the checkout; a wheel has none."""
RECORDED_ONLY = frozenset({to_page.Timeline, to_page.PastStates, to_page.Cursor})
"""Messages sent only to a page that shows a recording."""
_BASES = Message, MotionMessage
WIDTH = 100

Struct = type[msgspec.Struct]


def generated() -> dict[str, str]:
    """Return the text of each generated file by name."""
    return {
        "wire.ts": wire_module(),
        "codes.ts": codes_module(),
        "sentences.ts": sentences_module(),
        "texts.ts": texts_module(),
    }


def wire_module() -> str:
    """Return the module with the types of all messages."""
    live, recorded = get_args(PageMessage), get_args(RecordedPageMessage)
    structs = list(wire_structs())
    from_page = {*live, *recorded}
    to_pages = [each for each in structs if _is_message(each) and each not in from_page]
    others = [each for each in structs if not issubclass(each, Message)]
    sent = [each for each in to_pages if each not in RECORDED_ONLY]
    only_recorded = [each for each in to_pages if each in RECORDED_ONLY]
    types = _Types()
    types.add(to_pages, is_sent_by_page=False)
    types.add((*live, *recorded), is_sent_by_page=True)
    types.add(others, is_sent_by_page=False)
    unions = (
        _union("ServerMessage", _names(sent), "Message to a page that shows live robots."),
        _union(
            "RecordedServerMessage",
            ["ServerMessage", *_names(only_recorded)],
            "Message to a page that shows a recording.",
        ),
        _union("PageMessage", _names(live), "Message from a page that shows live robots."),
        _union(
            "RecordedPageMessage",
            _names(recorded),
            "Message from a page that shows a recording; none of them moves a robot.",
        ),
    )
    return "\n".join((HEADER, *unions, *types.texts.values()))


def _modules() -> Iterator[ModuleType]:
    """Yield the modules of this package that define messages."""
    for found in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        if not found.name.startswith(__name__):
            yield importlib.import_module(found.name)


def wire_structs() -> Iterator[Struct]:
    """Yield the structs of this package, in the order of modules and definitions."""
    for module in _modules():
        for each in vars(module).values():
            is_struct = isinstance(each, type) and issubclass(each, msgspec.Struct)
            if is_struct and each.__module__ == module.__name__ and each not in _BASES:
                yield each


def _is_message(struct: Struct) -> TypeGuard[type[Message]]:
    return issubclass(struct, Message)


def _names(structs: Iterable[Struct]) -> list[str]:
    return [each.__name__ for each in structs]


def _union(name: str, members: Iterable[str], doc: str) -> str:
    rows = "".join(f"\n  | {each}" for each in members)
    return f"{block_comment(doc)}export type {name} ={rows};\n"


class _Types:
    """Declarations by name, each followed by those that it refers to."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}
        self._classes: dict[str, type] = {}

    def add(self, structs: Iterable[Struct], *, is_sent_by_page: bool) -> None:
        """Declare structs and all types of their fields.

        A page may leave out fields that have a default; the server sends all fields, unless the
        struct omits defaults. Structs that both send are declared as the server sends them, so
        these must be added first.
        """
        for struct in structs:
            found = inspect.type_info(struct)
            if not isinstance(found, inspect.StructType):
                raise TypeError(f"{struct} is not a struct")
            self._struct(found, is_sent_by_page)

    def _is_new(self, cls: type) -> bool:
        if self._classes.setdefault(cls.__name__, cls) is not cls:
            raise TypeError(f"two types are named {cls.__name__}")
        return cls.__name__ not in self.texts

    def _struct(self, struct: inspect.StructType, is_sent_by_page: bool) -> str:
        cls, name = struct.cls, struct.cls.__name__
        if not self._is_new(cls):
            return name
        self.texts[name] = ""  # Keeps the place, and ends the recursion of a nested struct.
        may_omit = is_sent_by_page or cls.__struct_config__.omit_defaults
        own, fields = docs_of(cls)
        rows = [] if struct.tag is None else [f"  {struct.tag_field}: {json.dumps(struct.tag)};\n"]
        for field in struct.fields:
            mark = "?" if may_omit and not field.required else ""
            type_text = self._type(field.type, is_sent_by_page)
            doc = " ".join(filter(None, (fields.get(field.name), limits_text(field.type))))
            comment = block_comment(doc, "  ") if doc else ""
            rows.append(f"{comment}  {field.encode_name}{mark}: {type_text};\n")
        body = "".join(rows)
        self.texts[name] = f"{block_comment(own)}export interface {name} {{\n{body}}}\n"
        return name

    def _enum(self, cls: type[Enum]) -> str:
        """Declare the values of an enumeration as a list, and their union as its type."""
        if self._is_new(cls):
            values = [json.dumps(each.value, ensure_ascii=False) for each in cls]
            constant = _constant_name(cls.__name__)
            self.texts[cls.__name__] = (
                f"{block_comment(docs_of(cls)[0])}export const {constant} = "
                f"[{', '.join(values)}] as const;\n"
                f"export type {cls.__name__} = (typeof {constant})[number];\n"
            )
        return cls.__name__

    def _type(self, kind: inspect.Type, by_page: bool) -> str:
        """Return the TypeScript type of a field."""
        match kind:
            case inspect.UnionType(types=types):
                return " | ".join(self._type(each, by_page) for each in types)
            case inspect.StructType():
                return self._struct(kind, by_page)
            case inspect.EnumType(cls=cls):
                return self._enum(cls)
            case inspect.LiteralType(values=values):
                return " | ".join(json.dumps(each) for each in values)
            case inspect.ListType(item_type=item) | inspect.VarTupleType(item_type=item):
                inside = self._type(item, by_page)
                return f"({inside})[]" if " | " in inside else f"{inside}[]"
            case inspect.TupleType(item_types=items):
                return f"[{', '.join(self._type(each, by_page) for each in items)}]"
            case inspect.DictType(key_type=inspect.StrType(), value_type=value):
                return f"Record<string, {self._type(value, by_page)}>"
            case _:
                return _SIMPLE[type(kind)]


_SIMPLE: dict[type[Any], str] = {
    inspect.AnyType: "unknown",
    inspect.BoolType: "boolean",
    inspect.FloatType: "number",
    inspect.IntType: "number",
    inspect.NoneType: "null",
    inspect.StrType: "string",
}


def _constant_name(name: str) -> str:
    """Return the name of the list of values: `CAMERA_PRESETS` for `CameraPreset`."""
    words = "".join(f"_{letter}" if letter.isupper() else letter for letter in name)
    return f"{words.removeprefix('_').upper()}S"


def outdated() -> list[str]:
    """Return the names of files that are missing or differ from the generated text."""
    return [
        name
        for name, text in generated().items()
        if not (FOLDER / name).is_file() or (FOLDER / name).read_text(encoding="utf-8") != text
    ]


def main(arguments: Sequence[str]) -> None:
    """Write all files, or with `--check` exit with an error if one is outdated."""
    if "--check" in arguments:
        if names := outdated():
            sys.exit(f"{', '.join(names)} in {FOLDER}: outdated, run make web")
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, text in generated().items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
