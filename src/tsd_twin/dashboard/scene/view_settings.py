"""View settings of one page: camera, hidden layers, and how poses, tilt and colours are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from tsd_twin.dashboard.scene.appearance import Layer


class CameraPreset(StrEnum):
    """Camera presets; the values are the labels in the panel."""

    ISO = "3-D"
    TOP = "top"
    CHASE = "chase"
    """Behind the robot: the picture turns along with it, while the camera follows it."""


class TruePoseDisplay(StrEnum):
    """Display condition of the true pose; the values are the labels in the panel."""

    DIFFERS = "when it differs"
    ALWAYS = "always"
    NEVER = "never"


class TiltFactor(StrEnum):
    """Factors of the drawn tilt; the values are the labels in the panel."""

    TRUE = "x1"
    THREE = "x3"
    TEN = "x10"

    @property
    def number(self) -> int:
        """The factor."""
        return int(self.value[1:])


class ViewSettings(msgspec.Struct, frozen=True):
    """View settings of one page, as it keeps them."""

    camera: CameraPreset = CameraPreset.ISO
    follow: bool = True
    """Whether the camera moves with the robot."""
    hidden: Annotated[Sequence[Layer], Meta(max_length=len(Layer))] = ()
    true_pose: TruePoseDisplay = TruePoseDisplay.DIFFERS
    tilt: TiltFactor = TiltFactor.TRUE
    dark: bool | None = None
    """Dark or light colours; None as the browser prefers."""
