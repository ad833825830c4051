"""Kinematics, nothing else."""

from tsd_twin.drives.drive import Drive, Joint, JointKind, Motion
from tsd_twin.drives.singularity import SingularityDrive

__all__ = ["Drive", "Joint", "JointKind", "Motion", "SingularityDrive"]
