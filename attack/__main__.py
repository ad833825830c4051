"""Run all attacks, or the parts that are named, against live processes.

Each part is a module of this package with a function `rows()` that yields one `Row` per attack.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time

PARTS: tuple[str, ...] = ("commands", "distances", "gateway", "discovery", "login", "files")


def main() -> None:
    """Print the table as it comes; exit with 1 when a guarantee did not hold."""
    parser = argparse.ArgumentParser(
        prog="make attack",
        description="Attack live processes on this machine and compare with what is promised.",
        epilog='Example: make attack ARGS="commands gateway"',
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parts = parser.parse_args().parts or PARTS
    for unknown in set(parts) - set(PARTS):
        parser.error(f"there is no part '{unknown}': choose from {', '.join(PARTS)}")
    broken = 0
    for part in parts:
        start_s = time.monotonic()
        print(f"=== {part}", flush=True)
        for row in importlib.import_module(f"attack.{part}").rows():
            print(row, flush=True)
            broken += not row.held
        print(f"    {time.monotonic() - start_s:.0f} s", flush=True)
    print(f"{broken} broken" if broken else "all held")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
