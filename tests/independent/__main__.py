"""Print the table of consistency on the independent plants: `python -m tests.independent`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

from research.open_loop import BY_NAME, DEAD_WHEELS
from tests.independent.built import Undeclared
from tests.independent.drive import GYRO, JOINTS, MOUNTED, SPHERE_TWISTS, Cell, Row, run_rows

MANOEUVRES = (
    "turn and translate", "figure eight", "stops", "reversals", "creep 0.02 m/s", "at the cap",
    "wander", "to and fro",
)  # fmt: skip


def groups(args: argparse.Namespace) -> Iterator[list[Row]]:
    """Yield groups of rows that share a drive."""
    for robot in args.robots:
        if robot == "atlas":
            names = [name for name in args.manoeuvres or SPHERE_TWISTS if name in SPHERE_TWISTS]
            for name in names:
                yield [_row(args, robot, name, JOINTS, "")]
            continue
        for name in args.manoeuvres or MANOEUVRES:
            if name not in BY_NAME:
                continue
            wanted = [(odometry, camera) for odometry in (JOINTS, GYRO) for camera in ("", MOUNTED)]
            rows = [
                _row(args, robot, name, odometry, camera)
                for odometry, camera in wanted
                if label(odometry, camera) in args.sensors
            ]
            if rows:
                yield rows
            if robot == "omni4" and DEAD_WHEELS in args.sensors:
                yield [_row(args, robot, name, DEAD_WHEELS, "")]


def label(odometry: str, camera: str) -> str:
    return f"{odometry} + camera" if camera else odometry


def _row(args: argparse.Namespace, robot: str, name: str, odometry: str, camera: str) -> Row:
    # Rows of a robot use different machines, so that means over rows are independent.
    place = ([*MANOEUVRES, *BY_NAME, *SPHERE_TWISTS]).index(name)
    first = args.seed + 1000 * place
    row = Row(robot, name, odometry, camera, args.errors, robots=args.count, first=first)
    floor = Undeclared(friction=args.friction)
    return replace(row, times_s=tuple(args.times), undeclared=floor)


def text(cells: list[Cell]) -> str:
    means = " / ".join(f"{cell.nees:.1f}" for cell in cells)
    return f"{means} ({', '.join(f'{100 * cell.share:.0f}' for cell in cells)})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["tsd", "kiwi", "omni4", "mecanum", "atlas"])
    parser.add_argument("--manoeuvres", nargs="+")
    parser.add_argument("--sensors", nargs="+", default=[JOINTS, GYRO])
    parser.add_argument("--errors", type=float, default=1.0)
    parser.add_argument("--count", type=int, default=40, help="robots a row")
    parser.add_argument("--seed", type=int, default=9000, help="default 9000; 5000 is for tuning")
    parser.add_argument("--times", nargs="+", type=float, default=[2.0, 5.0, 20.0])
    parser.add_argument("--friction", type=float, help="of the floor; default as described")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    head = [label(JOINTS, ""), label(GYRO, ""), label(JOINTS, "c"), label(GYRO, "c"), DEAD_WHEELS]
    head = [each for each in head if each in args.sensors]
    print("| robot | manoeuvre |", " | ".join(head), "|")
    print("| --- " * (2 + len(head)) + "|")
    start = time.monotonic()
    work = list(groups(args))
    lines: dict[tuple[str, str], dict[str, str]] = {}
    with ProcessPoolExecutor(args.jobs) as pool:
        for rows, cells in zip(work, pool.map(run_rows, work), strict=True):
            for row, row_cells in zip(rows, cells, strict=True):
                line = lines.setdefault((row.robot, row.manoeuvre), {})
                line[label(row.odometry, row.camera)] = text(row_cells)
            print(
                f"| {row.robot} | `{row.manoeuvre}` |",
                " | ".join(line.get(each, "") for each in head),
                "|",
                flush=True,
            )
    print(f"{time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main()
