"""Experiments of `tsd-lab`: subcommands, output folder, tables, figures and progress."""

from __future__ import annotations

import argparse
import csv
import importlib
import itertools
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track

from tsd_twin.cli import flags
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # Takes 0.5 s; not needed for `--help` or usage errors.

T = TypeVar("T")
CaseT = TypeVar("CaseT")
_DOTS_PER_INCH = 130


class Output:
    """Output folder for PNG and CSV files, created at the first write.

    Raises:
        TwinError: If the folder cannot be created or written; raised by the write.
    """

    def __init__(self, folder: Path, *, quiet: bool = False) -> None:
        # Load matplotlib before an experiment drives a robot, which would have to wait for it.
        for name in ("figure", "backends.backend_agg"):
            importlib.import_module(f"matplotlib.{name}")
        self.folder = folder
        self.written: list[Path] = []
        """Written files, in order."""
        self._quiet = quiet

    def table(self, name: str, columns: Mapping[str, Array | Sequence[float | str]]) -> None:
        """Write `name`.csv with one column per entry; column names include units."""
        rows = itertools.zip_longest(*(np.asarray(column).tolist() for column in columns.values()))
        try:
            with self._file(f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(columns)
                writer.writerows(
                    [f"{it:.6g}" if isinstance(it, float) else it for it in row] for row in rows
                )
        except OSError as error:
            raise _cannot_write(self.folder, error) from error

    def figure(self, name: str, figure: Any) -> None:
        """Write a matplotlib figure to `name`.png."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        FigureCanvasAgg(figure)
        try:
            with warnings.catch_warnings():
                # matplotlib warns here if the machine was busy while it placed the legend.
                warnings.filterwarnings("ignore", 'Creating legend with loc="best"')
                figure.savefig(self._file(f"{name}.png"), dpi=_DOTS_PER_INCH)
        except OSError as error:
            raise _cannot_write(self.folder, error) from error

    def text(self, name: str, text: str) -> None:
        """Write `text` to a file unchanged."""
        try:
            self._file(name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise _cannot_write(self.folder, error) from error

    def refuse_overwrite(self, name: str, unless: str | None) -> None:
        """Refuse to overwrite an existing file other than `unless`.

        Raises:
            TwinError: If the file exists.
        """
        path = self.folder / name
        same = unless is not None and path.absolute() == Path(unless).absolute()
        if path.exists() and not same:
            raise TwinError(f"{path} would be written over: add to it with --log, or choose --out")

    def progress(self, items: Iterable[T], what: str, total: int) -> Iterator[T]:
        """Yield `items` with a progress bar on stderr, which is cleared at the end."""
        console = Console(file=sys.stderr, quiet=self._quiet)
        yield from track(items, what, total, console=console, transient=True)

    def show_progress(self, shares: Iterator[float], whole: float, what: str) -> None:
        """Iterate over `shares` of `whole` to the end, with a progress bar."""
        for _ in self.progress(in_percent_steps(shares, whole), what, PERCENT_STEPS):
            pass

    def _file(self, name: str) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / name
        self.written.append(path)
        return path


def _cannot_write(folder: Path, error: OSError) -> TwinError:
    return TwinError(f"{folder} cannot be written to: {error.strerror}")


PERCENT_STEPS = 100


def in_percent_steps(shares: Iterator[float], whole: float) -> Iterator[int]:
    """Iterate over `shares`, and yield once per completed hundredth of `whole`."""
    done = 0
    for share in shares:
        while done < min(PERCENT_STEPS, int(PERCENT_STEPS * share / whole)):
            done += 1
            yield done


Axes: TypeAlias = Any
"""matplotlib axes; `Any`, because matplotlib leaves its keyword types open."""

REFERENCE_COLOUR = "#5b6472"
TRUTH_COLOUR = "#c2410c"
ESTIMATE_COLOUR = "#1d4ed8"
CAMERA_COLOUR = "#0f766e"
SERIES_COLOURS = (TRUTH_COLOUR, ESTIMATE_COLOUR, CAMERA_COLOUR, "#7c3aed", "#b45309", "#be185d")
"""Colour-blind safe; crossing lines also differ in line style."""
_INK, _GRID = "#1f2933", "#d9dee5"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [f"| {' | '.join(cells)} |" for cells in (head, len(head) * ["---"], *rows)]


def spread(values: Array | Sequence[float], digits: int) -> str:
    """Format the median, 95th percentile and maximum as text."""
    found = np.quantile(values, [0.5, 0.95, 1.0], method="inverted_cdf")
    return " / ".join(f"{value:.{digits}f}" for value in found)


def new_figure(width_in: float, height_in: float, title: str) -> Figure:
    """Return an empty figure with a title and automatic layout."""
    from matplotlib.figure import Figure

    made: Any = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    made.suptitle(title, fontsize=13, color=_INK, x=0.01, ha="left", weight="bold")
    return made


def label_axes(axes: Axes, x_label: str, y_label: str, title: str = "") -> None:
    """Label both axes, including units, and draw the grid."""
    axes.set_xlabel(x_label, color=_INK)
    axes.set_ylabel(y_label, color=_INK)
    if title:
        axes.set_title(title, fontsize=10, color=_INK, loc="left")
    axes.grid(visible=True, color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_INK, labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(_SPINE)


def add_legend(axes: Axes, **where: Any) -> None:
    """Add a legend."""
    axes.legend(frameon=False, fontsize=9, labelcolor=_INK, **where)


_SPINE = "#8a94a3"


def add_jobs_flag(parser: argparse.ArgumentParser) -> None:
    """Add `--jobs`, for `run_cases`."""
    text = "worker processes; default one for each core"
    flags.add(parser, "--jobs", text, flags.whole(0), 0)


def run_cases(
    function: Callable[[CaseT], T], cases: Sequence[CaseT], jobs: int, out: Output
) -> list[T]:
    """Return the result of `function` for each case, computed in `jobs` worker processes.

    0 uses one process per core; 1 runs in this process.
    """
    jobs = min(jobs or os.cpu_count() or 1, len(cases))
    if jobs <= 1:
        return list(out.progress(map(function, cases), "driving", len(cases)))
    with ProcessPoolExecutor(jobs) as pool:
        return list(out.progress(pool.map(function, cases), "driving", len(cases)))


@dataclass(frozen=True, slots=True)
class Experiment:
    """Subcommand of `tsd-lab`."""

    name: str
    run: Callable[[argparse.Namespace, Output], list[str]]
    """Writes figures and tables to the output, and returns the lines to print.
    The first line of its docstring is the purpose shown in the help."""
    examples: Sequence[str]
    robot: str | None = None
    """Default of `--robot`, or None without that flag."""
    noise: bool = False
    """Whether the experiment has the flag `--noise`."""
    seed_of: str = ""
    """Meaning of `--seed`, or empty without that flag."""
    add_own_flags: Callable[[argparse.ArgumentParser], None] | None = None

    @property
    def purpose(self) -> str:
        """One sentence, for the list of experiments and its help."""
        return (self.run.__doc__ or "").partition("\n")[0]

    def add_flags(self, parser: argparse.ArgumentParser) -> None:
        """Add the common flags and the experiment's flags."""
        if self.robot:
            text = f"default {self.robot}"
            flags.add(parser, "--robot", text, default=self.robot, metavar="NAME|FILE")
        if self.seed_of:
            flags.add(parser, "--seed", f"of {self.seed_of}", flags.SEED, 0)
        if self.noise:
            flags.add(parser, "--noise", "times [noise]", flags.SCALE, 1.0, "SCALE")
        if self.add_own_flags:
            self.add_own_flags(parser)
