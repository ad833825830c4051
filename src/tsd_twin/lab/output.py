"""Where an experiment leaves its pictures and tables, and how it shows that it is not stuck."""

from __future__ import annotations

import csv
import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from rich.console import Console
from rich.progress import track

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

T = TypeVar("T")
_DOTS_PER_INCH = 130


class Output:
    """A folder for PNG and CSV, made when it is needed.

    Raises:
        TwinError: the folder cannot be made or written to; when something is written.
    """

    def __init__(self, folder: Path, *, quiet: bool = False) -> None:
        self.folder = folder
        self.written: list[Path] = []
        """Files, in the order they were written."""
        self._quiet = quiet

    def table(self, name: str, columns: Mapping[str, Array | Sequence[float | str]]) -> None:
        """Write `name`.csv: one column for each entry, its unit in its name."""
        rows = itertools.zip_longest(*(np.asarray(column).tolist() for column in columns.values()))
        try:
            with self._file(f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(columns)
                writer.writerows([_written(value) for value in row] for row in rows)
        except OSError as error:
            raise _refused(self.folder, error) from error

    def picture(self, name: str, figure: Any) -> None:
        """Write `name`.png, from a figure of matplotlib."""
        FigureCanvasAgg(figure)
        try:
            figure.savefig(self._file(f"{name}.png"), dpi=_DOTS_PER_INCH)
        except OSError as error:
            raise _refused(self.folder, error) from error

    def text(self, name: str, text: str) -> None:
        """Write a file as it stands."""
        try:
            self._file(name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise _refused(self.folder, error) from error

    def spare(self, name: str, unless: str | None) -> None:
        """Refuse to write over a file that is there already, `unless` it is this one.

        Raises:
            TwinError: it would be lost.
        """
        path = self.folder / name
        same = unless is not None and path.absolute() == Path(unless).absolute()
        if path.exists() and not same:
            raise TwinError(f"{path} would be written over: add to it with --log, or choose --out")

    def progress(self, items: Iterable[T], what: str, total: int) -> Iterator[T]:
        """Go through `items` with a bar on the error stream, which goes away at the end."""
        console = Console(file=sys.stderr, quiet=self._quiet)
        yield from track(items, what, total, console=console, transient=True)

    def _file(self, name: str) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / name
        self.written.append(path)
        return path


def _refused(folder: Path, error: OSError) -> TwinError:
    return TwinError(f"{folder} cannot be written to: {error.strerror}")


def _written(value: object) -> object:
    return f"{value:.6g}" if isinstance(value, float) else value
