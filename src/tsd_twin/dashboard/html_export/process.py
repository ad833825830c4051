"""Process that exports a recording within limits: `process KIND FILE OUT FROM TO ROBOT`.

`KIND` is `html`, `mcap` or `csv`, a ZIP archive. None of them contains lease ids. Empty arguments
`TO` and `ROBOT` mean the end and all robots. Errors are written to stderr as one sentence.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

from tsd_twin.dashboard import html_export
from tsd_twin.errors import TwinError
from tsd_twin.recording import export
from tsd_twin.recording.export import RecordingSlice

NICE = 5
"""Lower priority, so that commands and STOP of the dashboard are not delayed."""
CPU_S = 240
MEMORY_BYTES = 2 << 30
"""Memory limit in addition to the program itself."""
FILE_BYTES = 2 << 30
"""Size limit of each written file."""


def _limit() -> None:
    os.nice(NICE)
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    for kind, value in (
        (resource.RLIMIT_CPU, CPU_S),
        (resource.RLIMIT_AS, most),
        (resource.RLIMIT_FSIZE, FILE_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (value, value))
    # If memory runs out, the kernel should kill this process, not the dashboard.
    Path("/proc/self/oom_score_adj").write_text("1000", "ascii")


def _to_csv(part: RecordingSlice, out: Path) -> None:
    with tempfile.TemporaryDirectory(dir=out.parent) as name:
        folder = Path(name)
        export.to_mcap(part, folder / "part.mcap")  # Replaces the lease ids.
        redacted = replace(part, path=folder / "part.mcap", start_s=0.0, end_s=None)
        export.to_csv(redacted, folder / "tables")
        with zipfile.ZipFile(out, "x", zipfile.ZIP_DEFLATED) as archive:
            for table in sorted((folder / "tables").iterdir()):
                archive.write(table, table.name)


def main(kind: str, path: str, out: str, start: str, end: str, robot: str) -> None:
    """Export a part of a recording.

    Raises:
        TwinError: If the part cannot be exported.
    """
    _limit()
    part = RecordingSlice(Path(path), float(start), float(end) if end else None, robot or None)
    if kind == "html":
        html_export.to_html(part, Path(out))
    elif kind == "mcap":
        export.to_mcap(part, Path(out))
    else:
        _to_csv(part, Path(out))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except TwinError as error:
        sys.exit(f"{error}")
    except Exception as error:  # An unforeseen file causes a refusal, not a traceback.
        sys.exit(f"this recording cannot be exported: {type(error).__name__}")
