"""List of the tests by topic: `python -m tests.list_laws [FOLDER ...]`.

A folder is a topic, the first sentence of a file its subject, and the name of each test a law.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent


def law(name: str) -> str:
    """Return the name of a test as a sentence."""
    words = name.removeprefix("test_").replace("_", " ")
    return f"{words[:1].upper()}{words[1:]}."


def laws(file: Path) -> tuple[str, list[str]]:
    """Return the subject of a file of tests, and its laws in their order."""
    tree = ast.parse(file.read_text("utf-8"))
    subject = (ast.get_docstring(tree) or file.stem).split("\n\n")[0].replace("\n", " ")
    functions = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef))
    names = [each.name for each in functions if each.name.startswith("test_")]
    return subject, [law(name) for name in names]


def lines(folders: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the list as Markdown, for all folders of tests or for some."""
    for folder in sorted({file.parent for file in TESTS.rglob("test_*.py")}):
        topic = folder.relative_to(TESTS).as_posix()
        if folders and not topic.startswith(folders):
            continue
        yield f"# {'project' if topic == '.' else topic}"
        for file in sorted(folder.glob("test_*.py")):
            subject, found = laws(file)
            yield f"\n## {subject}\n"
            yield from (f"- {each}" for each in found)
        yield ""


if __name__ == "__main__":
    sys.stdout.writelines(f"{line}\n" for line in lines(tuple(sys.argv[1:])))
