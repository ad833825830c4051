"""Printed sheets: the board for lenses, and tags, as PDF of true size with a ruler to check it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tsd_twin.camera.detect import Gray
from tsd_twin.camera.tags import Cells, Tag, cells, dictionary, with_quiet_zone
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

PAPERS_MM = {"a4": (297.0, 210.0), "a3": (420.0, 297.0), "letter": (279.4, 215.9)}
"""Width and height, landscape."""
_MARGIN_MM = 8.0
"""Printers leave at least 5 mm white."""
_RULER_MM = 100.0
_STRIP_MM = 22.0
"""Strip on the left for ruler and text."""
_POINTS_PER_MM = 72.0 / 25.4
_TEXT_POINTS = 9


@dataclass(frozen=True, slots=True)
class Board:
    """Chessboard with a marker in each white square, so that a part of it suffices."""

    columns: int = 7
    rows: int = 5
    square_m: float = 0.036
    marker_m: float = 0.027
    family: str = "4x4_50"

    def find(self, picture: Gray) -> tuple[Array, Array] | None:
        """Return inner corners on the board (n, 3), metres, and in the picture (n, 2).

        None if fewer than eight are seen.
        """
        # OpenCV returns None when it finds nothing, unlike its type hints.
        found: Any = _detector(self).detectBoard(picture)
        corners, numbers = found[:2]
        if numbers is None or len(numbers) < _LEAST_CORNERS:
            return None
        points = np.asarray(_charuco(self).getChessboardCorners(), float)[numbers.ravel()]
        return points, corners.reshape(-1, 2).astype(float)

    def picture(self, texels_per_square: int = 80) -> tuple[Gray, float]:
        """Return a picture of the board on white paper, and its texels per metre."""
        edge = texels_per_square // 2
        size = tuple(texels_per_square * count + 2 * edge for count in (self.columns, self.rows))
        drawn = np.asarray(_charuco(self).generateImage(size, marginSize=edge), np.uint8)
        return drawn, texels_per_square / self.square_m

    def squares(self) -> list[tuple[float, float, float]]:
        """Return the black squares: left, top and side in mm from the top left of the board."""
        side = 1e3 * self.square_m
        black = [
            (column * side, row * side, side)
            for row in range(self.rows)
            for column in range(self.columns)
            if (row + column) % 2 == 0
        ]
        white = [
            (column * side, row * side)
            for row in range(self.rows)
            for column in range(self.columns)
            if (row + column) % 2
        ]
        inset = 500.0 * (self.square_m - self.marker_m)
        for number, (left, top) in enumerate(white):
            shown = cells(self.family, number)
            black += _black_cells(shown, left + inset, top + inset, 1e3 * self.marker_m)
        return black


_LEAST_CORNERS = 8


def _charuco(board: Board) -> cv2.aruco.CharucoBoard:
    size = board.columns, board.rows
    return cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary(board.family))


@functools.cache
def _detector(board: Board) -> cv2.aruco.CharucoDetector:
    return cv2.aruco.CharucoDetector(_charuco(board))


def board_pdf(board: Board, paper: str = "a4") -> bytes:
    """Return a page with the board.

    Raises:
        TwinError: If it does not fit on the paper.
    """
    width, height = 1e3 * board.square_m * board.columns, 1e3 * board.square_m * board.rows
    note = (
        f"tsd-camera board {board.columns} x {board.rows}, squares of {1e3 * board.square_m:g} mm"
    )
    return _pdf([_Sheet(board.squares(), width, height, note)], paper)


def tags_pdf(tags: Sequence[Tag], paper: str = "a4") -> bytes:
    """Return one page for each tag, with its white border.

    Raises:
        TwinError: If one does not fit on the paper.
    """
    sheets: list[_Sheet] = []
    for tag in tags:
        shown = with_quiet_zone(tag.family, tag.number)
        side = 1e3 * tag.size_m * len(shown) / (len(shown) - 2)
        note = f"{tag.family} {tag.number}, black square {1e3 * tag.size_m:g} mm, top is this side"
        sheets.append(_Sheet(_black_cells(shown, 0.0, 0.0, side), side, side, note))
    return _pdf(sheets, paper)


def _black_cells(
    shown: Cells, left: float, top: float, side: float
) -> list[tuple[float, float, float]]:
    cell = side / len(shown)
    return [(left + c * cell, top + r * cell, cell) for r, c in np.argwhere(~shown).tolist()]


@dataclass(frozen=True, slots=True)
class _Sheet:
    """Squares with their bounds, in mm from the top left, and a line of text next to them."""

    squares: list[tuple[float, float, float]]
    width: float
    height: float
    note: str


def _pdf(sheets: Sequence[_Sheet], paper: str) -> bytes:
    """Return the sheets as a PDF 1.4 file, one on each page, in the middle.

    Raises:
        TwinError: If the paper is unknown or too small.
    """
    if paper not in PAPERS_MM:
        raise TwinError(f"--paper is one of {', '.join(PAPERS_MM)}, not {paper}")
    size = PAPERS_MM[paper]
    objects = [b"", b"", b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"]
    pages: list[int] = []
    for sheet in sheets:
        content = _content(sheet, size).encode("ascii")
        objects.append(b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content))
        box = " ".join(f"{mm * _POINTS_PER_MM:.4f}" for mm in size)
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {box}] /Contents {len(objects)} 0 R "
            "/Resources << /Font << /F1 3 0 R >> >> >>".encode()
        )
        pages.append(len(objects))
    # Viewers that obey it print at 100 %.
    objects[0] = b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
    kids = " ".join(f"{number} 0 R" for number in pages)
    objects[1] = f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode()
    return _joined(objects)


def _content(sheet: _Sheet, size: tuple[float, float]) -> str:
    """Return the drawing commands of a page; its coordinates are mm from the bottom left."""
    if sheet.width > size[0] - _STRIP_MM - _MARGIN_MM or sheet.height > size[1]:
        raise TwinError(
            f"{sheet.width:.0f} x {sheet.height:.0f} mm do not fit on paper of "
            f"{size[0]:g} x {size[1]:g} mm: choose a smaller "
            "--tag-size or --square-mm, or a larger --paper"
        )
    left = size[0] - _MARGIN_MM - sheet.width
    top = 0.5 * (size[1] + sheet.height)
    lines = [f"{_POINTS_PER_MM:.8f} 0 0 {_POINTS_PER_MM:.8f} 0 0 cm 0 g"]
    lines += [
        f"{left + x:.4f} {top - y - side:.4f} {side:.4f} {side:.4f} re"
        for x, y, side in sheet.squares
    ]
    lines.append("f")
    lines += [f"{_MARGIN_MM - 0.1:.4f} {_MARGIN_MM:.4f} 0.2 {_RULER_MM:.4f} re f"]
    for mm in range(0, int(_RULER_MM) + 1, 5):
        long = 3.0 if mm % 10 == 0 else 1.8
        lines.append(f"{_MARGIN_MM:.4f} {_MARGIN_MM + mm - 0.1:.4f} {long} 0.2 re f")
    notes = "This ruler is 100 mm long: measure it. Print at 100 %, not 'fit to page'.", sheet.note
    lines += [_text(note, _MARGIN_MM + 8.0 + 5.0 * i, _MARGIN_MM) for i, note in enumerate(notes)]
    return "\n".join(lines)


def _text(text: str, x: float, y: float) -> str:
    """Return a line of text that runs upward."""
    quoted = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    size_mm = _TEXT_POINTS / _POINTS_PER_MM
    return f"BT /F1 {size_mm:.4f} Tf 0 1 -1 0 {x:.4f} {y:.4f} Tm ({quoted}) Tj ET"


def _joined(objects: Sequence[bytes]) -> bytes:
    """Return a file of numbered objects, with the table of their offsets."""
    file = bytearray(b"%PDF-1.4\n")
    offsets: list[int] = []
    for number, content in enumerate(objects, 1):
        offsets.append(len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (number, content)
    start = len(file)
    file += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    file += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    file += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n" % (len(objects) + 1)
    return bytes(file + b"%d\n%%%%EOF\n" % start)
