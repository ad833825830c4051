"""Scene for servers without one."""

from __future__ import annotations

from concurrent.futures import Future

import numpy as np

from tsd_twin.lie import Array


class EmptyScene:
    """A scene without robots."""

    def pick_floor(self, *_: object) -> Future[Array]:
        nothing: Future[Array] = Future()
        nothing.set_result(np.empty((0, 2)))
        return nothing

    def show_route(self, *_: object, **__: object) -> None:
        """Draw nothing."""

    draw = envelope = camera_state = show_route

    def reach_m(self, *_: object) -> float:
        return 0.0
