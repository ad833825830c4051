"""Model of a spherical platform: painted sphere, stand with motors, tree, masses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from manifold3d import Manifold

from tsd_twin.lie import SO3, Array
from tsd_twin.models import omni_wheel, solids
from tsd_twin.models.equipment import Place, board_drawings, copies, driver_case, heading_arrow
from tsd_twin.models.links import (
    Cylinder,
    JointType,
    KinematicTree,
    Link,
    LinkGroup,
    Sphere,
    alike,
    chassis_mass_kg,
    from_axes,
)
from tsd_twin.models.omni_wheel import WheelPlan, motor_drawings
from tsd_twin.models.solids import (
    Drawing,
    Parts,
    around,
    box,
    circle,
    drawn,
    grown,
    halfway_deg,
    rectangle,
    rod,
    slab,
    standing,
    union,
    wire,
)
from tsd_twin.robots import SphereDescription
from tsd_twin.robots.description import Body

_SEGMENTS = 64
_BAND = 0.035
"""Half width of the great circles, relative to the radius."""
_MARK = 0.17
"""Radius of the marks, relative to the radius."""
_THICK = 0.06
"""Thickness of the shell, relative to the radius."""


def sphere_drawings(radius: float, body: Body) -> list[Drawing]:
    """Draw the shell of a sphere, in pieces that fill it."""
    shell = Manifold.sphere(radius, _SEGMENTS) - Manifold.sphere((1.0 - _THICK) * radius, 24)
    far, thin = 2.0 * radius, _BAND * radius
    bands = union(
        [
            box((-thin, thin), (-far, far), (-far, far)),
            box((-far, far), (-thin, thin), (-far, far)),
            box((-far, far), (-far, far), (-thin, thin)),
        ]
    )
    half = {1: (0.0, far), -1: (-far, 0.0)}
    marks = {
        (axis, side): rod(_MARK * radius, span, axis)
        for axis in ("x", "y", "z")
        for side, span in half.items()
    }
    everywhere = union(marks.values())
    front, up = marks.pop(("x", 1)), marks.pop(("z", 1))
    fields = shell - (bands + everywhere)
    light = union(box(half[x], half[y], half[x * y]) for x in half for y in half)
    return [
        Drawing("fields", fields ^ light, solids.WHITE),
        Drawing("others", fields - light, solids.shell_material(body)),
        Drawing("bands", (shell ^ bands) - everywhere, solids.BLACK),
        Drawing("marks", shell ^ union(marks.values()), solids.BLUE),
        Drawing("front", shell ^ front, solids.front_material(body)),
        Drawing("up", shell ^ up, solids.YELLOW),
    ]


_STAND_MOTOR = 0.62
"""Radius of the motors, relative to the wheels."""
_TRAIN = 3.4
"""Length of motor, gearbox and encoder, in wheel radii."""
_FOOT = 9.0


@dataclass(frozen=True, slots=True, eq=False)
class WheelMount:
    """Pose of a wheel on the sphere, in `base_link`."""

    at: Array
    """(3,): centre, millimetres."""
    turn: Array
    """(3, 3): columns X, the axle Y, and Z away from the sphere."""

    def in_base(self, solid: Manifold) -> Manifold:
        """Move a solid from the wheel frame to the base."""
        return solid.transform(np.hstack([self.turn, self.at[:, None]]))

    @property
    def side(self) -> float:
        """Sign of the motor's side along the axle: the lower one, for a low motor."""
        return -1.0 if self.turn[2, 1] >= 0.0 else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class StandLayout:
    """Layout of a stand: positions and sizes of its parts."""

    plan: WheelPlan
    leans: tuple[WheelMount, ...]

    @property
    def train(self) -> float:
        """Length of motor, gearbox and encoder."""
        return _TRAIN * self.plan.radius

    @property
    def bracket(self) -> float:
        """Distance of the bracket from the middle of a wheel, along its axle."""
        return self.plan.half_width + 0.18 * self.plan.radius

    @property
    def thick(self) -> float:
        """Thickness of the brackets."""
        return 0.16 * self.plan.radius

    @property
    def deck(self) -> float:
        """Height of the plate's top, below all motors and wheels."""
        radius, lowest = self.plan.radius, 0.0
        for lean in self.leans:
            end = lean.at + lean.side * (self.bracket + self.thick + self.train) * lean.turn[:, 1]
            upright = math.hypot(lean.turn[2, 0], lean.turn[2, 2])
            tall, rim = _STAND_MOTOR * 1.2 * radius * upright, radius * upright
            lowest = min(lowest, end[2] - tall, lean.at[2] - rim - self.plan.half_width)
        return lowest - 0.2 * radius

    @property
    def floor(self) -> float:
        """Distance of the floor below the origin."""
        return -self.deck + 6.0 + _FOOT

    @property
    def reach(self) -> float:
        """Radius of the plate."""
        farthest = max(math.hypot(lean.at[0], lean.at[1]) for lean in self.leans)
        return farthest + 2.2 * self.plan.radius


def stand_drawings(stand: StandLayout, body: Body) -> list[Drawing]:
    """Draw the stand and everything fixed to it."""
    radius, deck, reach = stand.plan.radius, stand.deck, stand.reach
    hole = circle(0.3 * reach) - rectangle((-reach, reach), (-0.1 * reach, 0.1 * reach))
    plate = slab(circle(reach) - hole, (deck - 6.0, deck))
    lip = slab(circle(reach) - circle(reach - 4.0), (deck - 6.0, deck + 5.0))
    feet = around(rod(12.0, (deck - 6.0 - _FOOT, deck - 6.0), at=(0.86 * reach, 0.0, 0.0)), 3, 60.0)
    brackets = union(_bracket(stand, lean) for lean in stand.leans)
    return [
        Drawing("plate", plate + lip, solids.acrylic_material(body)),
        Drawing("feet", feet, solids.RUBBER),
        Drawing("brackets", brackets, solids.frame_material(body)),
        *motor_drawings(_STAND_MOTOR * radius, stand.train, partial(_behind_brackets, stand)),
        *_electronics(stand),
        heading_arrow(body, (reach - 6.0, 0.0, deck), reach / 150.0, (24.0, 15.0, 17.0, 3.0), 0.0),
    ]


def _behind_brackets(stand: StandLayout, solid: Manifold) -> Manifold:
    """Copy a motor to every bracket."""
    behind = stand.bracket + stand.thick
    placed: list[Manifold] = []
    for lean in stand.leans:
        turned = solid if lean.side < 0.0 else solid.rotate((0.0, 0.0, 180.0))
        placed.append(lean.in_base(turned.translate((0.0, lean.side * behind, 0.0))))
    return union(placed)


def _bracket(stand: StandLayout, lean: WheelMount) -> Manifold:
    """Draw the plate for the gearbox, and its vertical legs on the stand."""
    m, thick = _STAND_MOTOR * stand.plan.radius, stand.thick
    near = stand.bracket if lean.side > 0.0 else -stand.bracket - thick
    y = (near, near + thick)
    face = rectangle((-1.32 * m, 1.32 * m), (-m, m), 0.3 * m) - circle(0.4 * m)
    pieces = [lean.in_base(standing(face, y))]
    for x in ((-1.3 * m, -1.07 * m), (1.07 * m, 1.3 * m)):
        inside = (y[0] + 0.1 * thick, y[1] - 0.1 * thick)
        shoulder = lean.in_base(box(x, inside, (-0.5 * m, 0.5 * m)))
        shade = shoulder.project()
        foot = slab(shade, (stand.deck + 0.4, stand.deck + 1.4))
        pieces.append(Manifold.batch_hull([shoulder, foot]))
        pieces.append(slab(grown(shade, 0.25 * m), (stand.deck, stand.deck + 3.0)))
    return union(pieces)


def _electronics(stand: StandLayout) -> list[Drawing]:
    """Draw the board in the middle of the plate, and a driver between each two wheels."""
    deck, reach = stand.deck, stand.reach
    directions = [math.degrees(math.atan2(lean.at[1], lean.at[0])) for lean in stand.leans]
    wires = [
        wire([(-9.0, y, 0.4), (-18.0, y, 7.0), (-15.0, y, 8.0)], 1.4) for y in (-16.0, -10.0, -4.0)
    ]
    driver = [
        Drawing("drivers", driver_case(16.0, 26.0, 15.0), solids.ANODISED),
        Drawing("supply", wires[0], solids.RED),
        Drawing("phases", union(wires[1:]), solids.BLUE),
    ]
    places = [Place(at, 0.7 * reach, reach / 150.0) for at in halfway_deg(directions)]
    return [*board_drawings(deck, 0.3 * reach), *copies(driver, places, deck)]


def draw(robot: SphereDescription) -> Parts:
    """Draw the parts of stand, sphere and wheel."""
    stand = _stand(robot)
    return {
        "chassis": drawn("chassis", stand_drawings(stand, robot.body)),
        "sphere": drawn("sphere", sphere_drawings(1e3 * robot.drive.sphere_radius_m, robot.body)),
        "wheel": drawn("wheel", omni_wheel.omni_wheel_drawings(stand.plan, robot.body)),
    }


def tree(robot: SphereDescription) -> KinematicTree:
    """Return the sphere about the base origin, and the wheels on it, with Z away from the sphere.

    A wheel and the sphere rotate in opposite directions, like two gears: the wheel about -Omega_i,
    which is its Y. Sphere and wheels collide with their exact shapes; the stand does not collide.
    """
    at, turn = _wheels(robot)
    k, g = len(at), robot.drive
    names = tuple(f"wheel{i + 1}" for i in range(k))
    return KinematicTree(
        1e-3 * _stand(robot).floor,
        (
            LinkGroup(
                "sphere",
                ("sphere",),
                ("sphere_turn",),
                "chassis",
                np.zeros((1, 3)),
                SO3.identity((1,)),
                JointType.BALL,
                alike((0.0, 0.0, 1.0), 1),
                collision=Sphere(g.sphere_radius_m),
            ),
            LinkGroup(
                "wheel",
                tuple(f"{name}_link" for name in names),
                names,
                "chassis",
                at,
                turn,
                JointType.SPIN,
                alike((0.0, 1.0, 0.0), k),
                collision=Cylinder(g.wheel_radius_m, 2e-3 * _plan(robot).half_width),
            ),
        ),
        0.0,
    )


def masses_kg(robot: SphereDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the stand has the remainder."""
    mass = robot.mass
    others = mass.sphere_kg + len(robot.drive.wheels) * mass.wheel_kg
    needed = "mass.sphere_kg, and mass.wheel_kg for each wheel"
    return {
        "chassis": chassis_mass_kg(robot, mass.total_kg, others, "sphere and wheels", needed),
        "sphere": mass.sphere_kg,
        "wheel": mass.wheel_kg,
    }


def _plan(robot: SphereDescription) -> WheelPlan:
    """Return the wheels as described; single-row wheels are drawn with two touching rows."""
    g = robot.drive
    apart = 500.0 * max(g.row_distance_m, 2.0 * g.roller_radius_m)
    return WheelPlan(
        1e3 * g.wheel_radius_m, 0.0, g.rollers // 2, 1e3 * g.roller_radius_m, (-apart, apart), 8
    )


def _wheels(robot: SphereDescription) -> tuple[Array, SO3]:
    """Return the wheel positions (k, 3), metres, and the rotations (k, 4) of their frames."""
    drive = robot.kinematics()
    out, axle = drive.contacts, -drive.axes
    at = (drive.sphere_radius_m + drive.wheel_radius_m) * out
    return at, from_axes(np.cross(axle, out), axle, out)


def _stand(robot: SphereDescription) -> StandLayout:
    at, turn = _wheels(robot)
    matrices = turn.as_matrix()
    leans = tuple(WheelMount(1e3 * at[i], matrices[i]) for i in range(len(at)))
    return StandLayout(_plan(robot), leans)
