"""Programs that end at once after a mistake, with many calls in one process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_LONGEST_S = 20
"""A program that takes a mistake for none would run on."""

_RUNNER = """
import importlib, json, os, signal, sys, tempfile
module = importlib.import_module(sys.argv[1])
for flags in json.loads(sys.argv[2]):
    with tempfile.TemporaryFile() as errors, tempfile.TemporaryFile() as output:
        child = os.fork()
        if child == 0:
            signal.alarm(int(sys.argv[3]))
            os.dup2(errors.fileno(), 2)
            os.dup2(output.fileno(), 1)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            sys.argv = [sys.argv[1], *flags]
            try:
                module.main()
            except SystemExit as end:
                sys.stdout.flush()
                if isinstance(end.code, str):
                    os.write(2, (end.code + "\\n").encode())
                os._exit(1 if isinstance(end.code, str) else end.code or 0)
            except BaseException:
                sys.excepthook(*sys.exc_info())
                os._exit(99)
            sys.stdout.flush()
            os._exit(0)
        _, status = os.waitpid(child, 0)
        texts = []
        for file in (errors, output):
            file.seek(0)
            texts.append(file.read().decode())
    print(json.dumps([os.waitstatus_to_exitcode(status), *texts]), flush=True)
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a program ended."""

    code: int
    said: str
    """Text on standard error."""
    printed: str
    """Text on standard output."""


def start_each(module: str, mistakes: Sequence[Sequence[str]], folder: Path) -> list[Ended]:
    """Start a program with each of these flags, in a folder, and return how it ended."""
    flags = json.dumps([list(each) for each in mistakes])
    command = [sys.executable, "-c", _RUNNER, module, flags, str(_LONGEST_S)]
    ran = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    return [Ended(*json.loads(line)) for line in ran.stdout.splitlines()]
