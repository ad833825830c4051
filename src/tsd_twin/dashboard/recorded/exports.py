"""Exports of recordings for download, made in separate processes with limits."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import tempfile
from collections.abc import AsyncGenerator
from pathlib import Path

from tsd_twin.errors import RecordingError
from tsd_twin.recording.export import RecordingSlice

MAX_EXPORTS = 2
"""Maximum number of exports at a time, for all pages."""
TIMEOUT_S = 600.0
_PROGRAM = "tsd_twin.dashboard.html_export.process"
_MOST_CHARACTERS = 400
KINDS = {"html": ".html", "csv": ".zip", "mcap": ".mcap"}
"""Endings of the exported files."""


class ExportsBusyError(RecordingError):
    """Too many exports are in progress."""


class Exports:
    """Runs exports; event loop only."""

    def __init__(self) -> None:
        self._running: set[asyncio.subprocess.Process] = set()
        self._count = 0

    def close(self) -> None:
        """End all exports."""
        for process in self._running:
            process.kill()

    @contextlib.asynccontextmanager
    async def file(self, kind: str, part: RecordingSlice) -> AsyncGenerator[Path]:
        """Context with an exported file of one of the `KINDS`, which is removed afterwards.

        Raises:
            ExportsBusyError: If too many exports are in progress.
            RecordingError: If the recording cannot be exported within the limits.
        """
        if self._count >= MAX_EXPORTS:
            raise ExportsBusyError(f"{MAX_EXPORTS} exports are in progress: try again soon")
        self._count += 1
        try:
            with tempfile.TemporaryDirectory(prefix="tsd-export-") as folder:
                out = Path(folder) / f"export{KINDS[kind]}"
                await self._run(kind, part, out)
                yield out
        finally:
            self._count -= 1

    async def _run(self, kind: str, part: RecordingSlice, out: Path) -> None:
        end = "" if part.end_s is None else f"{part.end_s!r}"
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",
            "-m",
            _PROGRAM,
            kind,
            str(part.path),
            str(out),
            f"{part.start_s!r}",
            end,
            part.robot or "",
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            process_group=0,  # Ctrl-C is for the dashboard.
        )
        self._running.add(process)
        try:
            async with asyncio.timeout(TIMEOUT_S):
                _, errors = await process.communicate()
        except TimeoutError:
            errors = b""
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            self._running.discard(process)
        if process.returncode == 1 and errors.strip():
            raise RecordingError(errors.decode(errors="replace").strip()[-_MOST_CHARACTERS:])
        if process.returncode != 0:
            raise RecordingError("this export takes too much time or memory: choose a shorter part")
