"""Small disk that can be filled: a tmpfs where one can be mounted, a limit of file sizes else."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
from collections.abc import Generator
from pathlib import Path

SIZE = 600_000


class SmallDisk:
    """Folder on a separate disk; `fill` uses all space, `free` frees some."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ballast = folder / "ballast"

    def fill(self, pid: int) -> None:  # noqa: ARG002  The other kind needs it.
        """Write until nothing fits any more."""
        with self._ballast.open("wb", buffering=0) as file, contextlib.suppress(OSError):
            while file.write(bytes(512)):
                pass

    def free(self, pid: int) -> None:  # noqa: ARG002  The other kind needs it.
        """Make room."""
        self._ballast.unlink()


class LimitedFiles(SmallDisk):
    """Folder for a process with a limit on its file size.

    Writes fail as on a full disk, with another error number.
    """

    def fill(self, pid: int) -> None:
        """Allow no file to grow."""
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))

    def free(self, pid: int) -> None:
        """Allow files to grow."""
        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, unlimited)


@contextlib.contextmanager
def small_disk(folder: Path) -> Generator[SmallDisk]:
    """Make a small disk in an empty folder."""
    folder.mkdir()
    mount = ["/bin/mount", "-t", "tmpfs", "-o", f"size={SIZE}", "none", str(folder)]
    mounted = (
        os.geteuid() == 0
        and subprocess.run(mount, capture_output=True, check=False).returncode == 0
    )
    if not mounted:
        yield LimitedFiles(folder)
        return
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["/bin/umount", "-l", str(folder)], check=True)
