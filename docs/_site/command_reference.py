"""The command reference, written from the argument parsers of the programs in `app`.

A parser is complete when the program asks it to parse. Each `main` is run up to that point.
"""

from __future__ import annotations

import argparse
import importlib
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from unittest import mock

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

PAGE = "reference/commands"
_PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"


class _Complete(Exception):  # noqa: N818
    """A program has asked its parser to parse."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        super().__init__()
        self.parser = parser


def programs() -> dict[str, str]:
    """Return the module of each program."""
    project = tomllib.loads(_PYPROJECT.read_text(encoding="utf-8"))["project"]
    return {name: name.replace("-", "_") for name in project["scripts"]}


@cache  # A program can add its flags only once per process.
def parser_of(module: str) -> argparse.ArgumentParser:
    """Return the complete parser of a program.

    Raises:
        RuntimeError: If the program ended without parsing.
    """

    def stop(parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        raise _Complete(parser)

    with mock.patch.object(argparse.ArgumentParser, "parse_args", stop):
        try:
            importlib.import_module(module).main()
        except _Complete as complete:
            return complete.parser
    raise RuntimeError(f"{module}.main() parses no flags")


def reference() -> str:
    """Return the reference of all programs as Markdown."""
    return "".join("".join(_program(parser_of(module))) for module in programs().values())


def _program(parser: argparse.ArgumentParser, level: str = "##") -> Iterator[str]:
    yield f"\n{level} {parser.prog}\n\n"
    if parser.description:
        yield f"{_escaped(parser.description)}\n\n"
    yield f"```text\n{parser.format_usage()}```\n\n"
    if parser.epilog:
        yield f"```text\n{parser.epilog}\n```\n\n"
    yield f"```{{program}} {parser.prog}\n```\n\n"
    nested: dict[str, argparse.ArgumentParser] = {}
    # argparse has no public way to its groups and flags.
    for group in parser._action_groups:  # noqa: SLF001
        shown = [action for action in group._group_actions if action.help != argparse.SUPPRESS]  # noqa: SLF001
        flags = [action for action in shown if not isinstance(action.choices, dict)]
        for action in shown:
            if isinstance(action.choices, dict):
                nested |= action.choices
        if flags and group.title not in {"options", "positional arguments"}:
            yield f"**{_escaped(str(group.title))}.** {_escaped(group.description or '')}\n\n"
        for action in flags:
            yield f"````{{option}} {_signature(action)}\n{_help(action, parser)}\n````\n\n"
    for each in nested.values():
        yield from _program(each, level + "#")


def _signature(action: argparse.Action) -> str:
    """Return the names of a flag, each with its value, as `--help` shows them."""
    value = ""
    if action.nargs != 0:
        choices = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else ""
        given = action.metavar if isinstance(action.metavar, str) else None
        value = given or choices or action.dest.upper()
    if not action.option_strings:
        return action.metavar if isinstance(action.metavar, str) else action.dest
    return ", ".join(f"{name} {value}".strip() for name in action.option_strings)


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    values = {name: value for name, value in vars(action).items() if value != argparse.SUPPRESS}
    return _escaped((action.help or "") % {**values, "prog": parser.prog})


def _escaped(text: str) -> str:
    """Escape text for Markdown, except code between backticks."""
    parts = re.split(r"(`[^`]*`)", text)
    parts[::2] = [re.sub(r"([*_<>$\[\]])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


def append(_app: Sphinx, docname: str, source: list[str]) -> None:
    """Add the reference to its page."""
    if docname == PAGE:
        source[0] += reference()


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the change of the page."""
    app.connect("source-read", append)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
