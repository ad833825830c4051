"""What was measured on a robot that drove: its joints, and where a camera saw it; CSV both ways."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

Row: TypeAlias = dict[str, float]
POSE = ("x_m", "y_m", "heading_rad")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One drive without a pause in it."""

    t_s: Array
    """(n,): rising."""
    angles_rad: Array
    """(n, 2k): alpha and beta of each module, measured, as in `state/joints`."""
    told_rad_per_s: Array
    """(n, k): speeds that the wheels were told, as in `state/setpoint`, times the voltage of the
    battery over the nominal one where that is known: by so much motors are slower."""
    spin_rad_per_s: Array
    """(n, k): measured speeds, NaN where nothing measures them."""
    seen_s: Array
    """(m,): when the camera saw it, on the same clock, within `t_s`."""
    seen: Array
    """(m, 3): x, y and heading, which does not jump at half a turn."""

    @property
    def modules(self) -> int:
        """Number of wheels."""
        return self.told_rad_per_s.shape[1]

    def part(self, first_s: float, last_s: float) -> Recording:
        """Return what lies between two times."""
        rows = (self.t_s >= first_s) & (self.t_s <= last_s)
        t_s = self.t_s[rows]
        frames = (self.seen_s >= t_s[0]) & (self.seen_s <= t_s[-1])
        return Recording(
            t_s,
            self.angles_rad[rows],
            self.told_rad_per_s[rows],
            self.spin_rad_per_s[rows],
            self.seen_s[frames],
            self.seen[frames],
        )


def columns(recordings: Sequence[Recording]) -> dict[str, Array]:
    """Return a table of all: joints and poses, in one row where they are of one time."""
    table: dict[str, list[Array]] = {}
    for number, run in enumerate(recordings):
        t_s = np.union1d(run.t_s, run.seen_s)
        wheels = [f"module{i + 1}_wheel" for i in range(run.modules)]
        groups = [
            (angle_names(run.modules), run.t_s, run.angles_rad),
            ([f"{wheel}_told_rad_per_s" for wheel in wheels], run.t_s, run.told_rad_per_s),
            ([f"{wheel}_rad_per_s" for wheel in wheels], run.t_s, run.spin_rad_per_s),
            (POSE, run.seen_s, run.seen),
        ]
        named = {"run": np.full(len(t_s), float(number)), "t_s": t_s}
        for names, times, values in groups:
            rows = np.full((len(t_s), len(names)), np.nan)
            rows[np.searchsorted(t_s, times)] = values
            named |= dict(zip(names, rows.T, strict=True))
        for name, column in named.items():
            table.setdefault(name, []).append(column)
    return {name: np.concatenate(parts) for name, parts in table.items()}


def angle_names(modules: int) -> list[str]:
    """Return the columns of the gimbals."""
    return [f"module{i + 1}_{part}_rad" for i in range(modules) for part in ("alpha", "beta")]


def read(file: str, modules: int) -> list[Recording]:
    """Return the recordings in a CSV file as `columns` makes it; empty or `nan` is not measured.

    A row may hold joints, a pose, or both. Measured wheel speeds may be left out.

    Raises:
        TwinError: it cannot be read, or a column is missing, or there is too little in it.
    """
    try:
        with Path(file).open(newline="", encoding="utf-8") as opened:
            rows = [
                {name: float(value or "nan") for name, value in row.items()}
                for row in csv.DictReader(opened)
            ]
    except (OSError, ValueError, TypeError) as error:
        raise TwinError(f"{file} cannot be read as a log: {error}") from error
    needed = ["t_s", *angle_names(modules), *POSE]
    needed += [f"module{i + 1}_wheel_told_rad_per_s" for i in range(modules)]
    missing = [name for name in needed if not rows or name not in rows[0]]
    if missing:
        raise TwinError(f"{file}: no column {missing[0]} (needed are {', '.join(needed)})")
    runs = sorted({row.get("run", 0.0) for row in rows})
    return [
        _recording([row for row in rows if row.get("run", 0.0) == run], modules, file)
        for run in runs
    ]


def _recording(rows: list[Row], modules: int, file: str) -> Recording:
    rows = sorted(rows, key=lambda row: row["t_s"])
    joints = _table(rows, angle_names(modules))
    told = _table(rows, [f"module{i + 1}_wheel_told_rad_per_s" for i in range(modules)])
    spin = _table(rows, [f"module{i + 1}_wheel_rad_per_s" for i in range(modules)])
    poses, t_s = _table(rows, POSE), np.array([row["t_s"] for row in rows])
    have = np.isfinite(np.column_stack([t_s, joints, told])).all(axis=1)
    if have.sum() < 2:
        raise TwinError(f"{file}: a run needs two rows with joints or more")
    first_s, last_s = t_s[have][[0, -1]]
    seen = np.isfinite(poses).all(axis=1) & (t_s >= first_s) & (t_s <= last_s)
    if seen.sum() < 2:
        raise TwinError(f"{file}: a run needs two poses or more between its joints")
    poses[seen, 2] = np.unwrap(poses[seen, 2])
    return Recording(t_s[have], joints[have], told[have], spin[have], t_s[seen], poses[seen])


def _table(rows: list[Row], names: Sequence[str]) -> Array:
    return np.array([[row.get(name, np.nan) for name in names] for row in rows])
