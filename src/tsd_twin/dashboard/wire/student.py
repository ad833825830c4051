"""Messages to the page for the Student tab, specified in `docs/teleop.md`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

from tsd_twin.dashboard.wire.from_page import Message, Triple
from tsd_twin.dashboard.wire.to_page import TwistAxisInfo


class StudentKnob(msgspec.Struct, frozen=True):
    """Adjustable number of a description."""

    key: str
    label: str
    unit: str
    value: float
    usual: float
    """Value in the built-in description."""
    least: float
    most: float
    step: float


class StudentFigure(msgspec.Struct, frozen=True):
    """Number derived from the description."""

    name: str
    value: float
    unit: str
    note: str = ""


class StudentOutline(msgspec.Struct, frozen=True):
    """Outline of the reachable twists in two of their components."""

    axes: tuple[int, int]
    """Indices of the components."""
    section: Sequence[tuple[float, float]]
    """Boundary of the twists whose third component is zero."""
    shadow: Sequence[tuple[float, float]]
    """Boundary of the projection of all twists."""


class StudentWheel(msgspec.Struct, frozen=True):
    """Wheel of a variant at the requested twist, along the axes of the robot."""

    at: tuple[float, float]
    """Contact point, metres."""
    push: tuple[float, float]
    """Velocity of the contact point, m/s; for wheels on gimbals, as they roll."""
    direction_deg: float | None
    """Drive direction of a forward-turning wheel; None for wheels on gimbals."""
    rpm: float
    gimbal: Triple | None = None
    """alpha, beta and tilt in degrees."""
    axle: tuple[float, float] | None = None
    """Horizontal part of the unit vector along the axle."""


class MathToken(msgspec.Struct, frozen=True, omit_defaults=True):
    """Part of a formula, with the name of its MathML element."""

    kind: Literal["mi", "mo", "mn", "mfrac", "msqrt"]
    """Identifier, operator, number, fraction of two rows, or root of a row."""
    text: str = ""
    sub: str = ""
    """Subscript."""
    sup: str = ""
    """Superscript."""
    rows: Sequence[Sequence[MathToken]] = ()
    """Numerator and denominator of a fraction, or the radicand."""


class Equation(msgspec.Struct, frozen=True):
    """Equation with its current values."""

    name: str
    """Code of the equation."""
    formula: Sequence[MathToken]
    values: Sequence[float | None]
    """Values of the left side; None where it is undefined."""
    units: Sequence[str]
    """Unit of each value."""
    paper: str = ""
    """Source, or "" if it is derived in `docs/kinematics.md` only."""
    equation: str = ""
    """Number of the equation in the paper."""
    corrected: bool = False
    """Whether a misprint of the paper is corrected."""


class PaperCurve(msgspec.Struct, frozen=True):
    """Data series of a figure."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    points: bool = False
    """Whether it consists of separate measurements instead of a line."""


class PaperFigure(msgspec.Struct, frozen=True):
    """Figure of a paper, computed for the variant."""

    name: str
    """Code of the figure."""
    paper: str
    figure: str
    """Number of the figure, table or equation in the paper."""
    x: str
    """Label of the horizontal axis."""
    x_unit: str
    y: str
    """Label of the vertical axis."""
    y_unit: str
    curves: Sequence[PaperCurve]


class StudentFigures(msgspec.Struct, frozen=True):
    """All figures derived from a description and a twist."""

    axes: Sequence[TwistAxisInfo]
    tops: Triple
    """Maximum of each component alone."""
    figures: Sequence[StudentFigure]
    outlines: Sequence[StudentOutline]
    twist: Triple
    """Requested twist, scaled down to the joint limits if necessary, or the twist of the joints."""
    utilization: float
    """Fraction of the joint limits needed by the request; above 1 a requested twist is scaled."""
    wheels: Sequence[StudentWheel]
    radius_m: float
    """Wheel radius."""
    residual_mps: float
    """Root mean square of the least-squares residual at the contacts; zero if the joints agree."""
    redundancy: int
    """Number of equations beyond three; without any, joints never contradict each other."""
    centre: tuple[float, float] | None
    """Instantaneous centre of rotation in `base_link`, metres; None if the robot does not turn."""
    axis: Triple | None
    """Unit vector along the rotation axis of a sphere; None for other robots and at rest."""
    equations: Sequence[Equation]


class ShippedRobot(msgspec.Struct, frozen=True):
    """Entry of the robot menu of the Student tab."""

    id: str
    title: str


class StudentReply(Message, frozen=True, tag="student"):
    """Reply to `StudentRequest`; an impossible description has a problem and usually no figures."""

    number: int
    base: str
    bases: Sequence[ShippedRobot]
    knobs: Sequence[StudentKnob]
    figures: StudentFigures | None
    problem: str
    toml: str | None
    papers: Sequence[PaperFigure] = ()
    """On request."""
