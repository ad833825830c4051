"""Comments of the generated TypeScript: docstrings of classes and fields, and limits of fields."""

from __future__ import annotations

import ast
import inspect as source
import textwrap

from msgspec import inspect


def docs_of(cls: type) -> tuple[str, dict[str, str]]:
    """Return the docstring of a class, and those of its fields by name."""
    (tree,) = ast.parse(textwrap.dedent(source.getsource(cls))).body
    if not isinstance(tree, ast.ClassDef):
        raise TypeError(f"the source of {cls} is not a class")
    fields: dict[str, str] = {}
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        if not (isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)):
            continue
        match after:
            case ast.Expr(value=ast.Constant(value=str(text))):
                fields[before.target.id] = source.cleandoc(text)
            case _:
                pass
    return source.cleandoc(ast.get_docstring(tree) or ""), fields


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
