"""Snapshot of a controller: its state as bytes, and back.

Pickle writes it, since that is fast enough for the control loop. To read it, only classes of the
packages below are allowed, which have no I/O, and what numpy needs to make arrays: a file from
another person cannot run code.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from typing import Any

from tsd_twin.control.robot_controller import RobotController
from tsd_twin.errors import TwinError

_PURE = frozenset(
    {"control", "safety", "estimation", "motion", "messages", "robots", "kinematics", "lie"}
)
_OTHERS = frozenset(
    {
        ("collections", "OrderedDict"),
        ("collections", "deque"),
        ("msgspec._utils", "rebuild"),
        ("numpy", "dtype"),
        ("numpy", "ndarray"),
        ("numpy._core.multiarray", "_reconstruct"),
        ("numpy._core.multiarray", "scalar"),
        ("numpy._core.numeric", "_frombuffer"),
        ("numpy.core.multiarray", "_reconstruct"),
        ("numpy.core.multiarray", "scalar"),
        ("numpy.core.numeric", "_frombuffer"),
    }
)


class LeaseIds:
    """Source of lease ids that keeps what it has drawn; it can be put into a snapshot."""

    def __init__(self, draw: Callable[[], bytes]) -> None:
        self.draw = draw
        self.drawn: list[bytes] = []

    def __call__(self) -> bytes:
        """Return a new id."""
        lease_id = self.draw()
        self.drawn.append(lease_id)
        return lease_id

    def take(self) -> list[bytes]:
        """Return the ids drawn since the last time."""
        drawn, self.drawn = self.drawn, []
        return drawn

    def __getstate__(self) -> dict[str, object]:
        return {}  # Where ids come from is no state: a snapshot that is read gets a new source.


def dump(controller: RobotController, lease_ids: LeaseIds, without: frozenset[str]) -> bytes:
    """Return the state of a controller whose ids come from `lease_ids`.

    `without` are the names of its attributes that are left out.
    """
    state = {name: value for name, value in vars(controller).items() if name not in without}
    return pickle.dumps((lease_ids, state), protocol=5)


def load(state: bytes, draw: Callable[[], bytes]) -> RobotController:
    """Return a controller with a state; its lease ids come from `draw`.

    Raises:
        TwinError: the bytes are damaged, contain something else, or come from other code.
    """
    try:
        ids, attributes = _Reader(io.BytesIO(state)).load()
        ids.draw, ids.drawn = draw, []
        controller = RobotController.__new__(RobotController)
        vars(controller).update(attributes)
    except Exception as error:  # Damaged bytes can raise anything.
        raise TwinError(f"the state of the controller cannot be read: {error}") from error
    return controller


class _Reader(pickle.Unpickler):
    """Reader that makes only objects of classes without I/O."""

    def find_class(self, module_name: str, global_name: str) -> Any:
        package = module_name.split(".")[:2]
        if (module_name, global_name) in _OTHERS:
            return super().find_class(module_name, global_name)
        if package[0] == "tsd_twin" and len(package) == 2 and package[1] in _PURE:
            found = super().find_class(module_name, global_name)
            if isinstance(found, type) and found.__module__ == module_name:
                return found
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is not part of a state")
