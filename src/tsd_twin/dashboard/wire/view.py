"""Settings of the view of a page."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta


class Layer(StrEnum):
    """Layers that clients can hide; the values are their names on the page."""

    SETPOINT = "set_point"
    TRUTH = "true_pose"
    OTHER = "other_estimate"
    TRAIL = "trail"
    ROUTE = "planned_path"
    ARROWS = "thrust"
    REGION = "region"
    PREDICTED = "predicted_pose"
    ENVELOPE = "stop_envelope"
    LABELS = "labels"


class CameraPreset(StrEnum):
    """Camera presets; the values are their names on the page."""

    ISO = "3-D"
    TOP = "top"
    CHASE = "chase"
    """Behind the robot; while following, the view turns with the robot."""


class TruePoseDisplay(StrEnum):
    """When the true pose is displayed; the values are their names on the page."""

    DIFFERS = "when_different"
    ALWAYS = "always"
    NEVER = "never"


class TiltFactor(StrEnum):
    """Exaggeration of the displayed tilt; the values are their names on the page."""

    TRUE = "x1"
    THREE = "x3"
    FIVE = "x5"
    TEN = "x10"

    @property
    def number(self) -> int:
        """Exaggeration factor."""
        return int(self.value[1:])


class ViewSettings(msgspec.Struct, frozen=True):
    """View settings stored by a page."""

    camera: CameraPreset = CameraPreset.ISO
    follow: bool = True
    """Whether the camera moves with the robot."""
    hidden: Annotated[Sequence[Layer], Meta(max_length=len(Layer))] = ()
    true_pose: TruePoseDisplay = TruePoseDisplay.DIFFERS
    tilt: TiltFactor = TiltFactor.FIVE
    floor_camera: bool = False
    """Whether the pictures of cameras above the floor lie on the floor of the scene."""
    dark: bool | None = None
    """Dark or light colours; None follows the browser's preference."""
