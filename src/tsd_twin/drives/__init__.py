"""Kinematics, nothing else."""

from tsd_twin.drives.drive import Drive, Joint, JointKind, Motion
from tsd_twin.drives.omni import OmniDrive
from tsd_twin.drives.singularity import SingularityDrive
from tsd_twin.drives.sphere import SphereDrive

__all__ = [
    "Drive",
    "Joint",
    "JointKind",
    "Motion",
    "OmniDrive",
    "SingularityDrive",
    "SphereDrive",
]
