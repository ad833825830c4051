"""Where the links of robots are: forward kinematics for drawing, any number at a time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tsd_twin.description import Hinge, Limbs, Link, Tree
from tsd_twin.description.tree import Sphere
from tsd_twin.drives import Drive, JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.ros import JointState

_Z = np.array([0.0, 0.0, 1.0])
_MOVES = (Hinge.ANGLE, Hinge.SPIN)
"""Hinges that a joint of the drive turns."""


class Poses(NamedTuple):
    """Poses of all links of one kind, k to a robot."""

    wxyz: Array
    """(..., k, 4): unit quaternions, p_world = R p_link."""
    position: Array
    """(..., k, 3): metres; z is the height above the floor."""


class Skeleton:
    """The links of one description, which joint angles pose."""

    def __init__(self, tree: Tree, drive: Drive[Any]) -> None:
        self.tree = tree
        places = {joint.name: i for i, joint in enumerate(drive.joints)}
        self._columns: dict[Link, list[int]] = {
            limbs.kind: [places[name] for name in limbs.joints]
            for limbs in tree.limbs
            if limbs.hinge in _MOVES
        }

    def poses(self, base: SE2, ball: SO3, angles: Array) -> dict[Link, Poses]:
        """Return the poses of all links above the floor, by their kind.

        `base` (...) is where `base_link` stands, `ball` (...) how a ball in it is turned, which
        means nothing to a robot without one. `angles` (..., n) are those of the joints of the
        drive, in its order, radians: for a wheel the angle that it has turned by.
        """
        heading, xy = base.xy_heading[..., 2:], base.xy_heading[..., None, :2]
        seen = {"chassis": Poses(_turn(heading, _Z).wxyz, _raised(xy, self.tree.height_m))}
        for limbs in self.tree.limbs:
            above = seen[limbs.parent]
            turn = SO3(above.wxyz) @ limbs.turn
            if limbs.kind in self._columns:
                turn = turn @ _turn(angles[..., self._columns[limbs.kind]], limbs.axes)
            elif limbs.hinge is Hinge.BALL:
                turn = turn @ SO3(ball.wxyz[..., None, :])
            seen[limbs.kind] = Poses(turn.wxyz, _placed(limbs, above))
        return seen

    @property
    def wheels(self) -> tuple[Limbs, ...]:
        """The links that touch floor or ball: those that spin and collide."""
        return tuple(
            limbs
            for limbs in self.tree.limbs
            if limbs.hinge is Hinge.SPIN and limbs.hull is not None
        )

    def contacts(self, joints: Array) -> tuple[Array, Array]:
        """Return where wheels touch (k, 3) and what they do there (k, 3), m/s, by rolling.

        In the frame on the floor below `base_link`, from a joint vector (n,): the velocity that a
        wheel gives the robot over the floor, or the ball over the robot. Only along its circle: on
        rollers a wheel lets the rest be. Wheels that contradict one another are seen to.
        """
        here = self.poses(SE2.identity(), SO3.identity(), self._at_rest(joints))
        places: list[Array] = []
        velocities: list[Array] = []
        for limbs in self.wheels:
            assert limbs.hull is not None  # noqa: S101  That is how they were chosen.
            turn = SO3(here[limbs.kind].wxyz)
            spin = turn.rotate(limbs.axes * joints[self._columns[limbs.kind], None])
            # A round wheel touches with its lowest point, however it is tilted.
            up = _Z if isinstance(limbs.hull, Sphere) else turn.rotate(_Z)
            arm = limbs.hull.radius_m * np.broadcast_to(up, spin.shape)
            places.append(here[limbs.kind].position - arm)
            velocities.append(np.cross(spin, arm) * (-1.0 if self.has_ball else 1.0))
        return np.concatenate(places), np.concatenate(velocities)

    @property
    def has_ball(self) -> bool:
        """Whether it turns a ball in place, instead of driving over a floor."""
        return any(limbs.hinge is Hinge.BALL for limbs in self.tree.limbs)

    def _at_rest(self, joints: Array) -> Array:
        """Return the joints as angles, wheels as they were built in."""
        angles = joints.copy()
        for limbs in self.wheels:
            angles[self._columns[limbs.kind]] = 0.0
        return angles


def as_commanded(drive: Drive[Any], setpoint: Array, joints: Array) -> Array:
    """Return the joints (n,) that the commanded twist is in, from set-point and measured ones.

    Gimbals are told what they need at the speed that their wheels have: while that changes, it is
    not the one that the wheels are told. Wheels that are shut off give nothing.
    """
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    if not is_angle.any():
        return setpoint
    return np.where(is_angle | (setpoint == 0.0), setpoint, joints)


def joint_vector(drive: Drive[Any], state: JointState) -> Array | None:
    """Return the joint vector (n,) in a message, or None when it lacks one of our joints.

    What the message leaves open, like speeds in set-points of angles, is zero.
    """
    place = {name: i for i, name in enumerate(state.names)}
    if not all(joint.name in place for joint in drive.joints):
        return None
    rows = [place[joint.name] for joint in drive.joints]
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    return np.nan_to_num(
        np.where(is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])
    )


def _placed(limbs: Limbs, above: Poses) -> Array:
    """Return where links (..., k, 3) are that hang on others."""
    if not limbs.at_m.any():
        return above.position
    return above.position + SO3(above.wxyz).rotate(limbs.at_m)


def _turn(angle_rad: Array, axis: Array) -> SO3:
    return SO3.exp(angle_rad[..., None] * axis)


def _raised(xy: Array, z_m: float) -> Array:
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), z_m)], axis=-1)
