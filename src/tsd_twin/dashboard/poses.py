"""Where the links of robots are: forward kinematics for drawing, any number at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tsd_twin.dashboard.quaternions import pairs, product, turner
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
        self._mounts = [_Mount(limbs, self._columns.get(limbs.kind)) for limbs in tree.limbs]

    def poses(self, base: SE2, ball: SO3, angles: Array) -> dict[Link, Poses]:
        """Return the poses of all links above the floor, by their kind.

        `base` (...) is where `base_link` stands, `ball` (...) how a ball in it is turned, which
        means nothing to a robot without one. `angles` (..., n) are those of the joints of the
        drive, in its order, radians: for a wheel the angle that it has turned by.
        """
        where = base.xy_heading[..., None, :]
        wxyz, position = np.zeros((*where.shape[:-1], 4)), np.empty(where.shape)
        half = 0.5 * where[..., 2]
        wxyz[..., 0], wxyz[..., 3] = np.cos(half), np.sin(half)
        position[..., :2], position[..., 2] = where[..., :2], self.tree.height_m
        seen: dict[Link, Poses] = {"chassis": Poses(wxyz, position)}
        for mount in self._mounts:
            above = seen[mount.parent]
            own = mount.turn(ball, angles)
            seen[mount.kind] = Poses(product(above.wxyz, own), mount.place(above))
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


class _Mount:
    """How links of one kind hang on others; what stays as it is, is computed once."""

    def __init__(self, limbs: Limbs, columns: list[int] | None) -> None:
        self.kind, self.parent = limbs.kind, limbs.parent
        self._columns = columns
        self._ball = limbs.hinge is Hinge.BALL
        self._at_zero = limbs.turn.wxyz
        axes = np.concatenate([np.zeros((limbs.count, 1)), limbs.axes], axis=-1)
        self._at_half_turn = product(self._at_zero, axes)
        self._offset = turner(limbs.at_m) if limbs.at_m.any() else None

    def turn(self, ball: SO3, angles: Array) -> Array:
        """Return how they are turned (..., k, 4) against what they hang on."""
        if self._columns is not None:
            half = 0.5 * angles[..., self._columns, None]
            return np.cos(half) * self._at_zero + np.sin(half) * self._at_half_turn
        return product(self._at_zero, ball.wxyz[..., None, :]) if self._ball else self._at_zero

    def place(self, above: Poses) -> Array:
        """Return where they are (..., k, 3)."""
        if self._offset is None:
            return above.position
        turned = pairs(above.wxyz, above.wxyz)[..., None, :] @ self._offset
        return above.position + turned[..., 0, :]


class JointReader:
    """Reads joint vectors of one robot, whose messages are all in one order as a rule."""

    def __init__(self, drive: Drive[Any]) -> None:
        joints = drive.joints
        self._names = [joint.name for joint in joints]
        self._is_angle = np.array([joint.kind is JointKind.POSITION for joint in joints])
        self._order: Sequence[str] | None = None
        self._rows: list[int] | None = None

    def vector(self, state: JointState) -> Array | None:
        """Return the joint vector (n,) in a message, or None when it lacks one of our joints.

        What the message leaves open, like speeds in set-points of angles, is zero.
        """
        if (names := tuple(state.names)) != self._order:
            self._order, self._rows = names, self._find(names)
        if self._rows is None:
            return None
        angles, speeds = state.position_rad[self._rows], state.velocity_rad_per_s[self._rows]
        vector = np.where(self._is_angle, angles, speeds)
        return vector if np.isfinite(vector).all() else np.nan_to_num(vector)

    def _find(self, names: Sequence[str]) -> list[int] | None:
        place = {name: i for i, name in enumerate(names)}
        return [place[name] for name in self._names] if place.keys() >= {*self._names} else None


def as_commanded(drive: Drive[Any], setpoint: Array, joints: Array) -> Array:
    """Return the joints (n,) that the commanded twist is in, from set-point and measured ones.

    Gimbals are told what they need at the speed that their wheels have: while that changes, it is
    not the one that the wheels are told. Wheels that are shut off give nothing.
    """
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    if not is_angle.any():
        return setpoint
    return np.where(is_angle | (setpoint == 0.0), setpoint, joints)
