"""Forward and inverse kinematics of omnidirectional robots, vectorized with numpy."""

from __future__ import annotations

from tsd_twin.kinematics.base import (
    ContactLayout,
    Joint,
    JointKind,
    Kinematics,
    TwistKinematics,
    TwistSolution,
)
from tsd_twin.kinematics.omni import OmniKinematics, SphereKinematics
from tsd_twin.kinematics.singularity import SingularityKinematics

__all__ = [
    "ContactLayout",
    "Joint",
    "JointKind",
    "Kinematics",
    "OmniKinematics",
    "SingularityKinematics",
    "SphereKinematics",
    "TwistKinematics",
    "TwistSolution",
]
