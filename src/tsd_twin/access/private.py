"""Files that decide who gets in: nobody else may read or change them."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from tsd_twin.errors import TwinError

_OTHERS = stat.S_IWGRP | stat.S_IRWXO
"""A group may read, such as that of a service."""


def refuse_public(file: Path) -> None:
    """Refuse a file that others can read or change.

    Raises:
        TwinError: so it is, or the file is not there.
    """
    try:
        status = file.stat()
    except OSError as error:
        raise TwinError(f"{file} cannot be read: {error.strerror}") from error
    if status.st_mode & _OTHERS:
        raise TwinError(f"{file} can be read or changed by others: run chmod 600 {file}")
    if status.st_uid not in (0, os.geteuid()):
        raise TwinError(f"{file} belongs to somebody else: make it your own, or root's")
