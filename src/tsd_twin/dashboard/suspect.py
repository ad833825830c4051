"""Which wheel contradicts the others: a ring about it on the floor."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.shape import Shape, Surface
from tsd_twin.lie import Array
from tsd_twin.messages.status import Status

RADIUS_M = 0.075
_THICK_M = 0.006
_LIFTED_M = 0.008


class SuspectMark:
    """Shown for as long as the robot suspects one of its actuators; it cannot be hidden."""

    def __init__(self, scene: viser.SceneApi, name: str, shape: Shape) -> None:
        self._actuators = shape.drive.actuators
        # Where wheels touch does not depend on what they do: near enough for a ring.
        at_rest = shape.drive.inverse(np.zeros(3))
        self._places: Array = shape.skeleton.contacts(at_rest)[0]
        profile: Any = CrossSection.circle(_THICK_M, 8).translate((RADIUS_M, 0.0))
        self._shown: str | None = None
        self._handle = scene.add_mesh_simple(
            name,
            *Surface.of(profile.revolve(48)),
            color=palette.SUSPECT,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, status: Status) -> None:
        """Show whom the robot suspects, or nobody."""
        suspect = status.conflict.suspect
        if suspect == self._shown:
            return
        self._shown = suspect
        self._handle.visible = suspect in self._actuators
        if suspect in self._actuators:
            x, y, z = self._places[self._actuators.index(suspect)]
            self._handle.position = (float(x), float(y), float(z) + _LIFTED_M)
