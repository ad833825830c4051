"""Run all attacks, or the named parts, against live processes.

Each part is a module of this package with a function `rows()` that yields one `Row` per attack.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Iterator

from attack.table import Row, summary
from tsd_twin.errors import TwinError

PARTS: tuple[str, ...] = (
    "commands",
    "distances",
    "gateway",
    "discovery",
    "login",
    "ros_age",
    "instances",
    "files",
    "router",
)


def main() -> None:
    """Print rows and a summary; exit with 1 if a guarantee did not hold."""
    parser = argparse.ArgumentParser(
        prog="make attack",
        description="Attack live processes on this machine and compare with what is promised.",
        epilog='Example: make attack ARGS="commands gateway --times 10"',
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--times", type=int, default=1, metavar="N", help="repeat all; default 1")
    args = parser.parse_args()
    parts = args.parts or PARTS
    for unknown in set(parts) - set(PARTS):
        parser.error(f"there is no part '{unknown}': choose from {', '.join(PARTS)}")
    results: list[tuple[str, Row]] = []
    try:
        for time_ in range(1, args.times + 1):
            for part in parts:
                start_s = time.monotonic()
                print(f"=== {part}, {time_} of {args.times}", flush=True)
                for row in rows_of(part):
                    print(row, flush=True)
                    results.append((part, row))
                print(f"    {time.monotonic() - start_s:.0f} s", flush=True)
    finally:
        print(f"=== summary of {args.times}", *summary(results), sep="\n", flush=True)
    broken = sum(not row.held for _, row in results)
    print(f"{broken} broken" if broken else "all held")
    sys.exit(1 if broken else 0)


def rows_of(part: str) -> Iterator[Row]:
    """Yield the rows of a part; an early end yields a row that did not hold."""
    try:
        yield from importlib.import_module(f"attack.{part}").rows()
    except (AssertionError, OSError, TwinError) as error:
        why = f"{type(error).__name__}: {error}".splitlines()[0][:100]
        yield Row("all attacks of this part are done", "no error", why, held=False)


if __name__ == "__main__":
    main()
