"""`python -m tsd_twin.dynamixel`: write the files that are generated from the control table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tsd_twin.dynamixel import render


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files, say where, and return the exit status; `arguments` as in a shell."""
    parser = argparse.ArgumentParser(prog="python -m tsd_twin.dynamixel", description=__doc__)
    parser.add_argument("--to", type=Path, default=Path(), help="root of the project; default .")
    flags = parser.parse_args(arguments)
    for name, text in render.files().items():
        path: Path = flags.to / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
