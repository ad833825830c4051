"""The only door to MuJoCo, which is an extra and has no types."""

from __future__ import annotations

import importlib
from typing import Any

from tsd_twin.errors import MissingExtraError


def engine() -> Any:
    """Return the module `mujoco`.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        raise MissingExtraError("The plant `mujoco`", "mujoco") from error
