"""Benchmarks as ratios to a peer or a lower bound that is measured in alternation.

Exit codes: 0 if all targets are met, 1 if one is missed or a part fails, 3 if the machine was too
busy.
"""

from __future__ import annotations

import argparse
import importlib
import statistics
import sys
import time
import traceback
from pathlib import Path

from bench.machine import description, pressure_s
from bench.table import BUSY, HEAD, MAX_WITHHELD, MISS, Row, Run, compare, write_json
from bench.targets import TARGETS

PARTS = tuple(dict.fromkeys(name.partition(".")[0] for name in TARGETS))
OVERLOADED = 3
"""Exit code of a run that the machine made meaningless."""
EXAMPLES = f"""examples:
  make bench                                      all rows
  make bench ARGS="dashboard bus.stop_p50"        a part, and one row
  make bench ARGS="simulation --json a.json"      also write all values to a file
  python -m bench --compare a.json b.json         compare two machines row by row

~ marks a provisional target. 'held' is the time that other processes withheld, as a fraction
of the time for which the measured ones were ready. A row above {MAX_WITHHELD:.0%} is not judged.

parts: {", ".join(PARTS)}
"""


def main() -> None:
    """Print each row when it is available."""
    args = _arguments()
    if args.compare:
        lines = list(compare(*args.compare))
        print("\n".join(line for line, _ in lines))
        sys.exit(not all(agrees for _, agrees in lines))
    run, began_s, pressed_s = Run(args.rows, args.smallest), time.monotonic(), pressure_s()
    machine = description()
    print("machine: " + ", ".join(f"{key} {value:.3g}" for key, value in machine.items()))
    print(HEAD, flush=True)
    rows: list[Row] = []
    failed: list[str] = []
    for part in PARTS:
        if not run.wants(*(name for name in TARGETS if name.startswith(f"{part}."))):
            continue
        try:
            for row in importlib.import_module(f"bench.{part}").rows(run):
                rows.append(row)
                print(row, flush=True)
        except Exception as error:  # The other parts are still worth measuring.
            reason = f"a measurement of {part} failed: {error or type(error).__name__}"
            if _overloaded(run):
                _give_up(reason)
            traceback.print_exc()
            print(reason, flush=True)
            failed.append(part)
    machine["seconds"] = time.monotonic() - began_s
    machine["withheld"] = statistics.mean(run.withheld or [0.0])
    machine["pressure"] = (pressure_s() - pressed_s) / machine["seconds"]
    print("whole run: " + ", ".join(f"{key} {machine[key]:.3g}" for key in list(machine)[-3:]))
    if args.json is not None:
        write_json(args.json, machine, rows)
    _conclude([row.verdict for row in rows], failed)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench",
        description=__doc__,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("rows", nargs="*", help="parts, rows or patterns such as 'bus.*'")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all values to FILE")
    parser.add_argument("--compare", nargs=2, type=Path, metavar="FILE", help="compare two files")
    parser.add_argument(
        "--smallest", action="store_true", help="one short round each; the values mean nothing"
    )
    args = parser.parse_args()
    for pattern in args.rows:
        if not any(Run([pattern]).wants(name) for name in TARGETS):
            parser.error(f"'{pattern}' matches no part or row; rows: {', '.join(TARGETS)}")
    return args


def _overloaded(run: Run) -> bool:
    """Return whether the machine withheld too much time before or during a failure."""
    return bool(run.withheld) and max(run.withheld[-4:]) > MAX_WITHHELD


def _conclude(verdicts: list[str], failed: list[str]) -> None:
    """Print the number of missed rows and the parts that failed, and exit."""
    missed, busy = verdicts.count(MISS), verdicts.count(BUSY)
    counts = f"{missed} missed, {busy} not judged"
    counts += f", failed: {', '.join(failed)}" if failed else ""
    print(counts if missed or busy or failed else "all met")
    if 2 * busy > len(verdicts):
        _give_up(f"{busy} of {len(verdicts)} rows cannot be judged")
    sys.exit(missed > 0 or bool(failed))


def _give_up(reason: str) -> None:
    print(
        f"The machine was too busy to measure: {reason}. Other processes held back those measured "
        f"for over {100 * MAX_WITHHELD:.0f} % of the time. End them and repeat.",
        file=sys.stderr,
    )
    sys.exit(OVERLOADED)


if __name__ == "__main__":
    main()
