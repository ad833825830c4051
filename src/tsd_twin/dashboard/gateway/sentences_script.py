"""Sentences of all codes as a script for the page.

`python -m tsd_twin.dashboard.gateway.sentences_script` writes it again after a change of
`messages/sentences.py`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tsd_twin.messages.codes import PARAMETERS
from tsd_twin.messages.sentences import TEMPLATES, WORDS

SCRIPT = Path(__file__).parents[1] / "static" / "sentences.js"


def script() -> str:
    """Return the text of the script."""
    types = {
        str(code): {name.removesuffix("?"): str(kind) for name, kind in parameters.items()}
        for code, parameters in PARAMETERS.items()
    }
    words = {str(kind): dict(texts) for kind, texts in WORDS.items()}
    templates = {str(code): template for code, template in TEMPLATES.items()}
    return "\n".join(
        (
            "// Generated from tsd_twin/messages/sentences.py by",
            "// python -m tsd_twin.dashboard.gateway.sentences_script",
            "",
            _constant("TEMPLATES", "Record<string, string>", templates),
            _constant("TYPES", "Record<string, Record<string, string>>", types),
            _constant("WORDS", "Record<string, Record<string, string>>", words),
        )
    )


def _constant(name: str, kind: str, value: Mapping[str, Any]) -> str:
    rows = "".join(_row(key, each) for key, each in value.items())
    return f"/** @type {{{kind}}} */\nexport const {name} = {{\n{rows}}};\n"


def _row(key: str, value: str | Mapping[str, str], indent: str = "  ") -> str:
    """Return one line, broken as prettier does it."""
    name = key if key.isidentifier() else json.dumps(key, ensure_ascii=False)
    if isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
        line = f"{indent}{name}: {text},\n"
        return line if len(line) <= _WIDTH + 1 else f"{indent}{name}:\n{indent}  {text},\n"
    inside = "".join(f" {_row(each, text, '').rstrip()}" for each, text in value.items())
    line = f"{indent}{name}: {{{inside.rstrip(',')}{' ' if value else ''}}},\n"
    if len(line) <= _WIDTH + 1 and len(value) < _MANY:
        return line
    rows = "".join(_row(each, text, indent + "  ") for each, text in value.items())
    return f"{indent}{name}: {{\n{rows}{indent}}},\n"


_WIDTH = 100
_MANY = 6
"""Number of words from which each has its line."""


if __name__ == "__main__":
    SCRIPT.write_text(script(), encoding="utf-8")
