"""Where the links of robots are: forward kinematics for drawing, any number at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsd_twin.description import Link
from tsd_twin.drives import JointKind, SingularityDrive
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.ros import JointState

_Y = np.array([0.0, 1.0, 0.0])
_X = np.array([1.0, 0.0, 0.0])
_Z = np.array([0.0, 0.0, 1.0])


class Poses(NamedTuple):
    """Poses of all links of one kind, k to a robot."""

    wxyz: Array
    """(..., k, 4): unit quaternions, p_world = R p_link."""
    position: Array
    """(..., k, 3): metres; z is the height above the floor."""


def link_poses(
    drive: SingularityDrive, base: SE2, joints: Array, wheel_angles_rad: Array
) -> dict[Link, Poses]:
    """Return the poses of the links `chassis`, `outer`, `inner` and `wheel` above the floor.

    `base` (...) is where `base_link` is, whose origin is as high as the gimbal centres: a wheel
    radius above the floor. `joints` (..., n) are the joint vector, whose wheel speeds do not matter
    here, and `wheel_angles_rad` (..., k) the angles that the wheels have turned by. All links of a
    module have their origin in its pivot; the outer one turns by beta about Y_W, in it the inner
    one by -alpha about X, in it the wheel about Z (Eq. 24 and 25).
    """
    k, heading = drive.modules, base.xy_heading[..., 2:]
    modules = joints.reshape(*joints.shape[:-1], k, 3)
    outer = _turn(heading + drive.azimuths_rad - 0.5 * np.pi, _Z) @ _turn(modules[..., 1], _Y)
    inner = outer @ _turn(-modules[..., 0], _X)
    wheel = inner @ _turn(wheel_angles_rad, _Z)
    pivots = SE2(base.xy_heading[..., None, :]).transform(drive.pivots_m)
    at_pivots = _raised(pivots, drive.wheel_radius_m)
    return {
        "chassis": Poses(
            _turn(heading, _Z).wxyz, _raised(base.xy_heading[..., None, :2], drive.wheel_radius_m)
        ),
        "outer": Poses(outer.wxyz, at_pivots),
        "inner": Poses(inner.wxyz, at_pivots),
        "wheel": Poses(wheel.wxyz, at_pivots),
    }


def contact_velocities(drive: SingularityDrive, joints: Array) -> Array:
    """Return what each wheel does over the ground (..., k, 2), m/s in the axes of the base frame.

    By rolling, from `joints` (..., n) alone: wheels that contradict one another are seen to.
    """
    angles = drive.azimuths_rad - 0.5 * np.pi
    poses = SE2(np.stack([0.0 * angles, 0.0 * angles, angles], axis=-1))
    return poses.rotate(drive.contacts(joints))


def joint_vector(drive: SingularityDrive, state: JointState) -> Array | None:
    """Return the joint vector (n,) in a message, or None when it is of other joints.

    What the message leaves open, like speeds in set-points of angles, is zero.
    """
    if list(state.names) != [joint.name for joint in drive.joints]:
        return None
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    return np.nan_to_num(np.where(is_angle, state.position_rad, state.velocity_rad_per_s))


def _turn(angle_rad: Array, axis: Array) -> SO3:
    return SO3.exp(angle_rad[..., None] * axis)


def _raised(xy: Array, z_m: float) -> Array:
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), z_m)], axis=-1)
