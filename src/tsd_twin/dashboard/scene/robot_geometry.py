"""Geometry of robots for drawing: link poses by batched forward kinematics, meshes, hull and
footprint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import manifold3d
import msgspec
import numpy as np
import numpy.typing as npt

from tsd_twin.dashboard.scene.appearance import Rgb
from tsd_twin.dashboard.scene.materials import staged, tinted
from tsd_twin.dashboard.scene.portrait import render_portrait
from tsd_twin.dashboard.wire.to_page import TwistAxisInfo
from tsd_twin.kinematics import Joint, JointKind, Kinematics
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import JointState
from tsd_twin.models import (
    JointType,
    KinematicTree,
    Link,
    LinkGroup,
    glb,
    kinematic_tree,
    load_parts,
)
from tsd_twin.models.links import Sphere
from tsd_twin.models.solids import Part
from tsd_twin.robots import RobotDescription

_W, _I, _J, _K = np.eye(4)
_HAMILTON = np.array([[_W, _I, _J, _K], [_I, -_W, _K, -_J], [_J, -_K, -_W, _I], [_K, _J, -_I, -_W]])
"""T (4, 4, 4) such that the product of a and b is the sum of a_i b_j T_ij."""
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
_PRODUCT = _HAMILTON.reshape(16, 4)


def quaternion_product(a: Array, b: Array) -> Array:
    """Multiply rotations a b (..., 4): b first, then a."""
    return pairwise_products(a, b) @ _PRODUCT


def pairwise_products(a: Array, b: Array) -> Array:
    """Return all products of the components of a and b (..., 16)."""
    both = a[..., :, None] * b[..., None, :]
    return both.reshape(*both.shape[:-2], 16)


def rotation_matrix_of_products(vectors: Array) -> Array:
    """Return M (..., 16, 3) such that `pairs(q, q) @ M` are `vectors` (..., 3) rotated by q."""
    pure = np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)
    made = np.einsum("ijk,...j,klm->...ilm", _HAMILTON, pure, _HAMILTON * _CONJUGATE[:, None])
    return made.reshape(*vectors.shape[:-1], 16, 4)[..., 1:]


_Z = np.array([0.0, 0.0, 1.0])
_ACTUATED = (JointType.ANGLE, JointType.SPIN, JointType.SLIDE)
"""Joint types with a value."""


def drawn_joints(robot: RobotDescription, tree: KinematicTree) -> tuple[Joint, ...]:
    """Return the joints required for drawing: drive joints, then measured ones in the tree."""
    drive = robot.kinematics().joints
    named = {name for group in tree.link_groups for name in group.joints}
    named -= {joint.name for joint in drive}
    return (*drive, *(sensor for sensor in robot.sensors if sensor.name in named))


class LinkPoses(NamedTuple):
    """Poses of all links of a kind, k per robot."""

    wxyz: Array
    """(..., k, 4): unit quaternions, p_world = R p_link."""
    position: Array
    """(..., k, 3): metres; z is the height above the floor."""


class Skeleton:
    """Forward kinematics of all links of a description."""

    def __init__(self, tree: KinematicTree, joints: Sequence[Joint]) -> None:
        """`joints` are the `drawn_joints`, whose values `poses` takes."""
        self.tree = tree
        places = {joint.name: i for i, joint in enumerate(joints)}
        self._columns: dict[Link, list[int]] = {
            group.kind: [places[name] for name in group.joints]
            for group in tree.link_groups
            if group.joint_type in _ACTUATED
        }
        self._mounts = [
            _LinkMount(group, self._columns.get(group.kind)) for group in tree.link_groups
        ]

    def poses(self, base: SE2, ball: SO3, angles: Array) -> dict[Link, LinkPoses]:
        """Return the poses of all links above the floor, by kind.

        Args:
            base: (...): pose of `base_link`.
            ball: (...): orientation of the robot's sphere; unused for planar robots.
            angles: (..., n): joint values in order, rad; rotation of wheels; m for sliding joints.
        """
        where = base.xy_heading[..., None, :]
        wxyz, position = np.zeros((*where.shape[:-1], 4)), np.empty(where.shape)
        half = 0.5 * where[..., 2]
        wxyz[..., 0], wxyz[..., 3] = np.cos(half), np.sin(half)
        position[..., :2], position[..., 2] = where[..., :2], self.tree.height_m
        seen: dict[Link, LinkPoses] = {"chassis": LinkPoses(wxyz, position)}
        for mount in self._mounts:
            above = seen[mount.parent]
            own = mount.turn(ball, angles)
            place = mount.place(above, angles)
            seen[mount.kind] = LinkPoses(quaternion_product(above.wxyz, own), place)
        return seen

    @property
    def wheels(self) -> tuple[LinkGroup, ...]:
        """Links that touch floor or sphere: those that spin and collide."""
        return tuple(
            group
            for group in self.tree.link_groups
            if group.joint_type is JointType.SPIN and group.collision is not None
        )

    def contacts(self, joints: Array) -> tuple[Array, Array]:
        """Return the wheel contacts (k, 3) and their rolling velocities (k, 3), m/s.

        Both are in the frame on the floor below `base_link`, for a joint vector (n,). A velocity
        describes the motion of the robot over the floor, or of the sphere over the robot, along the
        wheel's circle; rollers leave the other directions free. This makes contradicting wheels
        visible.
        """
        if not self.wheels:
            return np.zeros((0, 3)), np.zeros((0, 3))
        here = self.poses(SE2.identity(), SO3.identity(), self.at_rest(joints))
        places: list[Array] = []
        velocities: list[Array] = []
        for group in self.wheels:
            assert group.collision is not None  # noqa: S101  That is how they were chosen.
            turn = SO3(here[group.kind].wxyz)
            spin = turn.rotate(group.axes * joints[self._columns[group.kind], None])
            # A spherical wheel touches at its lowest point, regardless of its tilt.
            up = _Z if isinstance(group.collision, Sphere) else turn.rotate(_Z)
            arm = group.collision.radius_m * np.broadcast_to(up, spin.shape)
            places.append(here[group.kind].position - arm)
            velocities.append(np.cross(spin, arm) * (-1.0 if self.has_ball else 1.0))
        return np.concatenate(places), np.concatenate(velocities)

    @property
    def has_ball(self) -> bool:
        """Whether the robot turns a sphere in place instead of driving on the floor."""
        return any(group.joint_type is JointType.BALL for group in self.tree.link_groups)

    def at_rest(self, joints: Array) -> Array:
        """Return the joints as angles, with wheels at zero."""
        angles = joints.copy()
        for group in self.wheels:
            angles[self._columns[group.kind]] = 0.0
        return angles


class _LinkMount:
    """Mounting of the links of a kind on their parents, with precomputed constants."""

    def __init__(self, group: LinkGroup, columns: list[int] | None) -> None:
        self.kind, self.parent = group.kind, group.parent
        self._columns = columns
        self._ball = group.joint_type is JointType.BALL
        self._slides = group.joint_type is JointType.SLIDE
        self._at_zero = group.turn.wxyz
        axes = np.concatenate([np.zeros((group.count, 1)), group.axes], axis=-1)
        self._at_half_turn = quaternion_product(self._at_zero, axes)
        self._offset = rotation_matrix_of_products(group.at_m) if group.at_m.any() else None
        self._way = rotation_matrix_of_products(group.turn.rotate(group.axes))

    def turn(self, ball: SO3, angles: Array) -> Array:
        """Return the orientations (..., k, 4) relative to the parent."""
        if self._ball:
            return quaternion_product(self._at_zero, ball.wxyz[..., None, :])
        if self._columns is None or self._slides:
            return self._at_zero
        half = 0.5 * angles[..., self._columns, None]
        return np.cos(half) * self._at_zero + np.sin(half) * self._at_half_turn

    def place(self, above: LinkPoses, angles: Array) -> Array:
        """Return the positions (..., k, 3)."""
        offset: Array | None = self._offset
        if self._slides and self._columns is not None:
            way = angles[..., self._columns, None, None] * self._way
            offset = way if offset is None else offset + way
        if offset is None:
            return above.position
        turned = pairwise_products(above.wxyz, above.wxyz)[..., None, :] @ offset
        return above.position + turned[..., 0, :]


class JointReader:
    """Reads joint vectors from messages; caches the order of joint names."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._names = [joint.name for joint in joints]
        self._is_angle = np.array([joint.kind is JointKind.POSITION for joint in joints])
        self._order: Sequence[str] | None = None
        self._rows: list[int] | None = None

    def read(self, state: JointState) -> Array | None:
        """Return the joint vector (n,) in a message, NaN where a value is missing, or None if a
        joint is missing.
        """
        if (names := tuple(state.names)) != self._order:
            self._order, self._rows = names, self._find(names)
        if self._rows is None:
            return None
        angles, speeds = state.position_rad[self._rows], state.velocity_rad_per_s[self._rows]
        return np.where(self._is_angle, angles, speeds)

    def vector(self, state: JointState, otherwise: Array | None = None) -> Array | None:
        """Return the joint vector (n,) in a message, or None if a joint is missing.

        Values missing in the message, such as speeds in setpoints of angles, are taken from
        `otherwise` (n,), or zero.
        """
        vector = self.read(state)
        if vector is None or (known := np.isfinite(vector)).all():
            return vector
        return np.where(known, vector, 0.0 if otherwise is None else otherwise)

    def _find(self, names: Sequence[str]) -> list[int] | None:
        place = {name: i for i, name in enumerate(names)}
        return [place[name] for name in self._names] if place.keys() >= {*self._names} else None


def commanded_joints(drive: Kinematics[Any], setpoint: Array, joints: Array) -> Array:
    """Return the joints (n,) of the commanded twist, from setpoint and measured ones.

    Gimbal setpoints match the measured wheel speeds, which differ from the wheel setpoints while
    the speed changes. Wheels that are shut off contribute nothing.
    """
    is_angle = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
    if not is_angle.any():
        return setpoint
    return np.where(is_angle | (setpoint == 0.0), setpoint, joints)


_MANIFOLD: Any = manifold3d.Manifold  # The stubs do not specify array shapes.
_OUTLINE: Any = manifold3d.CrossSection

BASE_LINK_KIND: Link = "chassis"
"""Kind of the link that is fixed in the base frame; all others move."""


class Surface(NamedTuple):
    """Triangle mesh."""

    vertices: npt.NDArray[np.float32]
    """(n, 3): metres."""
    faces: npt.NDArray[np.uint32]
    """(m, 3)."""

    @classmethod
    def of(cls, solid: Any) -> Surface:
        """Copy the surface of a Manifold; a view would keep the solid alive."""
        mesh = solid.to_mesh()
        return cls(
            np.array(mesh.vert_properties[:, :3], np.float32), np.array(mesh.tri_verts, np.uint32)
        )


class RobotShape:
    """Parts of a robot as meshes for viewers; created once per description."""

    def __init__(self, robot: RobotDescription) -> None:
        self.kinematics = robot.kinematics()
        tree = kinematic_tree(robot)
        self.joints = drawn_joints(robot, tree)
        """Joints required for drawing, beginning with the drive joints."""
        self.rolls = np.array([joint.kind is JointKind.VELOCITY for joint in self.joints])
        """(n,): whether each of them turns without end."""
        self.skeleton = Skeleton(tree, self.joints)
        self._parts = {
            kind: [staged(part) for part in drawn] for kind, drawn in load_parts(robot).items()
        }
        self.glbs: dict[Link, bytes] = {kind: glb(drawn) for kind, drawn in self._parts.items()}
        """Binary glTF per kind of link, metres, in the frame of the link."""
        self._poses = self.skeleton.poses(
            SE2.identity(), SO3.identity(), np.zeros(len(self.joints))
        )

    @property
    def moving(self) -> tuple[Link, ...]:
        """Kinds of links that move in the base frame."""
        return tuple(kind for kind in self._parts if kind != BASE_LINK_KIND)

    def count(self, kind: Link) -> int:
        """Return the number of links of a kind per robot."""
        return len(self._poses[kind].wxyz)

    def tinted(self, kind: Link, colour: Rgb) -> bytes:
        """Return the binary glTF of a kind of link with all parts tinted."""
        return glb(tinted(self._parts[kind], colour))

    @property
    def tilts(self) -> bool:
        """Whether joints have position setpoints, as gimbals do."""
        return any(joint.kind is JointKind.POSITION for joint in self.kinematics.joints)

    @property
    def ball_radius_m(self) -> float | None:
        """Radius of the sphere that the robot turns in place, or None for a planar robot."""
        for group in self.skeleton.tree.link_groups:
            if group.joint_type is JointType.BALL and group.collision is not None:
                return group.collision.radius_m
        return None

    @cached_property
    def collision(self) -> Surface:
        """Convex hull of all parts with joints at zero; origin on the floor below `base_link`."""
        points = [vertices for vertices, _ in self._placed_parts()]
        return Surface.of(_MANIFOLD.hull_points(np.concatenate(points)))

    @cached_property
    def portrait(self) -> bytes:
        """Picture of the robot with joints at zero, as `render_portrait` returns it."""
        return render_portrait(self._placed_parts())

    def _placed_parts(self) -> Iterator[tuple[Array, Part]]:
        """Yield the vertices of each part with joints at zero, and the part."""
        for kind, drawn in self._parts.items():
            for wxyz, position in zip(*self._poses[kind], strict=True):
                for part in drawn:
                    yield SO3(wxyz).rotate(np.asarray(part.mesh.vertices)) + position, part

    @cached_property
    def footprint(self) -> Array:
        """(n, 2): outline of the hull from above, counter-clockwise, metres."""
        seen = self.collision.vertices[:, :2].astype(np.float64)
        return np.asarray(_OUTLINE.hull_points(seen).to_polygons()[0])

    @cached_property
    def height_m(self) -> float:
        """Height above the floor."""
        return float(self.collision.vertices[:, 2].max())

    @cached_property
    def reach_m(self) -> float:
        """Planar radius of the robot about its centre."""
        return float(np.hypot(*self.footprint.T).max())


@dataclass(frozen=True)
class _Drawing:
    """Description compared by its encoding, because descriptions are not hashable."""

    encoding: bytes
    robot: RobotDescription = field(compare=False)


@lru_cache(maxsize=8)
def _shape_of(drawing: _Drawing) -> RobotShape:
    return RobotShape(drawing.robot)


def robot_shape(robot: RobotDescription) -> RobotShape:
    """Return the shape of a robot, shared by all scenes; building a new one takes a second.

    Raises:
        RobotFileError: As in `load_parts`.
        MeshError: As in `load_parts`.
    """
    return _shape_of(_Drawing(msgspec.json.encode(robot), robot))


_FLOOR_AXES = (
    TwistAxisInfo("vx", "vx", "m/s"),
    TwistAxisInfo("vy", "vy", "m/s"),
    TwistAxisInfo("omega", "ω", "rad/s"),
)
_SPHERE_AXES = tuple(TwistAxisInfo(f"w{axis}", f"ω{axis}", "rad/s") for axis in "xyz")
_TWIST_AXES = {(0, 1, 5): _FLOOR_AXES, (3, 4, 5): _SPHERE_AXES}
"""Twist axes by their indices in a spatial twist."""


def twist_axes_of(kinematics: Kinematics[Any]) -> tuple[TwistAxisInfo, ...]:
    """Return the three components of a twist, in order."""
    return _TWIST_AXES[kinematics.twist_axes]
