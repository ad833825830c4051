"""Scene for servers without one."""

from __future__ import annotations

from concurrent.futures import Future

import numpy as np

from tsd_twin.lie import Array


class EmptyScene:
    """A scene without robots, which notes which ones pages choose."""

    def __init__(self) -> None:
        self.chosen: list[tuple[str, str]] = []

    def select_robot(self, page: str, robot_id: str) -> None:
        self.chosen.append((page, robot_id))

    def pick_floor(self, *_: object) -> Future[Array]:
        nothing: Future[Array] = Future()
        nothing.set_result(np.empty((0, 2)))
        return nothing

    def show_route(self, *_: object, **__: object) -> None:
        """Draw nothing."""

    apply_view = show_past = show_preview = show_student = envelope = camera_state = show_route

    def reach_m(self, *_: object) -> float:
        return 0.0
