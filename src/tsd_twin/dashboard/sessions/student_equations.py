"""Wheels and equations with their current values by robot kind, for the Student tab.

Symbols as in `docs/kinematics.md`, which derives the corrections of the papers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from tsd_twin.dashboard.sessions.actuator_telemetry import GimbalDisplay
from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.student import Equation, MathToken, StudentWheel
from tsd_twin.kinematics import (
    Kinematics,
    OmniKinematics,
    SingularityKinematics,
    SphereKinematics,
    TwistSolution,
)
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import (
    RPM,
    OmniDescription,
    SingularityDescription,
    SphereDescription,
)


def gimbal_wheels(
    robot: SingularityDescription,
    joints: Array,
    solution: TwistSolution,  # noqa: ARG001  Common signature.
) -> list[StudentWheel]:
    """Return the modules of a singularity drive at joints (3k,), as they roll."""
    drive = robot.kinematics()
    display = GimbalDisplay(drive)
    tilts, axles, pushes = drive.tilt(joints), display.axles(joints), display.pushes(joints)
    return [
        StudentWheel(
            at=pair(drive.pivots_m[i]),
            push=pair(pushes[i]),
            direction_deg=None,
            rpm=short(spin / RPM),
            gimbal=(degrees(alpha), degrees(beta), degrees(tilts[i])),
            axle=pair(axles[i]),
        )
        for i, (alpha, beta, spin) in enumerate(joints.reshape(-1, 3).tolist())
    ]


def roller_wheels(
    robot: OmniDescription, joints: Array, solution: TwistSolution
) -> list[StudentWheel]:
    """Return the wheels of a platform on rollers at joints (k,)."""
    drive = robot.kinematics()
    pushes = pivot_velocities(drive.positions_m, solution.twist)
    return _rolling_wheels(joints, drive.positions_m, pushes, drive.directions_rad)


def sphere_wheels(
    robot: SphereDescription, joints: Array, solution: TwistSolution
) -> list[StudentWheel]:
    """Return the wheels below a sphere at joints (k,), seen from above."""
    drive = robot.kinematics()
    contacts = drive.sphere_radius_m * drive.contacts
    directions_rad = np.arctan2(drive.actuations[:, 1], drive.actuations[:, 0])
    pushes = np.cross(solution.twist, contacts)
    return _rolling_wheels(joints, contacts, pushes, directions_rad)


def _rolling_wheels(
    spins: Array, at_m: Array, pushes: Array, directions_rad: Array
) -> list[StudentWheel]:
    return [
        StudentWheel(
            at=pair(at_m[i]),
            push=pair(pushes[i]),
            direction_deg=degrees(directions_rad[i]),
            rpm=short(float(spins[i]) / RPM),
        )
        for i in range(len(spins))
    ]


def pivot_velocities(at_m: Array, twist: Array) -> Array:
    """Return the velocities (k, 2) of points (k, 2) on a body that moves at `twist` (3,)."""
    vx, vy, omega = (float(part) for part in twist)
    return np.stack([vx - omega * at_m[:, 1], vy + omega * at_m[:, 0]], axis=-1)


def short(value: float) -> float:
    """Round a number to six digits, and tiny numbers to zero."""
    return float(f"{round(float(value), 12):.6g}") + 0.0


def degrees(angle_rad: float) -> float:
    """Return an angle in degrees, with six digits."""
    return short(math.degrees(float(angle_rad)))


def pair(point: Array) -> tuple[float, float]:
    """Return a point with six digits."""
    return short(point[0]), short(point[1])


def triple(values: Array) -> Triple:
    """Return three numbers with six digits."""
    a, b, c = (short(value) for value in values)
    return a, b, c


THESIS = "Carothers 2014"
OMNI_PAPER = "Savnani et al. 2019"
ATLAS_PAPER = "Weiss et al. 2008"
_OPERATORS = frozenset("=+−·(),|") | {"sin", "cos", "asin", "atan2"}
_SCRIPTED = re.compile(r"([^_^]+)(?:_([^^]+))?(?:\^(.+))?")
_TURNING = 1e-9
"""Smaller turn rates, in rad/s, have no centre of rotation."""


def math_tokens(text: str) -> list[MathToken]:
    """Parse a formula of words separated by spaces, such as `v_i = r_w · ω_d`.

    `a_b^c` has subscript b and superscript c. `{ … }` is a root, `{ … ; … }` a fraction.
    """
    return _parse(text.split(), [])


def _parse(words: list[str], end: Sequence[str]) -> list[MathToken]:
    """Parse and remove the first `words`, up to one in `end`."""
    tokens: list[MathToken] = []
    while words and words[0] not in end:
        word = words.pop(0)
        if word == "{":
            rows = [_parse(words, ("}", ";"))]
            while words.pop(0) == ";":
                rows.append(_parse(words, ("}", ";")))
            tokens.append(MathToken("msqrt" if len(rows) == 1 else "mfrac", rows=rows))
        elif word in _OPERATORS:
            tokens.append(MathToken("mo", word))
        elif (found := _SCRIPTED.fullmatch(word)) is not None:
            kind: Literal["mn", "mi"] = "mn" if found[1].isdecimal() else "mi"
            tokens.append(MathToken(kind, found[1], found[2] or "", found[3] or ""))
    return tokens


def gimbal_equations(
    drive: SingularityKinematics, joints: Array, solution: TwistSolution
) -> list[Equation]:
    """Return the equations of a singularity drive at joints (3k,)."""
    alpha, beta, spins = joints.reshape(-1, 3).T
    pivot_speeds = np.linalg.norm(pivot_velocities(drive.pivots_m, solution.twist), axis=-1)
    rims_mps, rolling = drive.wheel_radius_m * spins, drive.contacts(joints)
    by = _Source(THESIS)
    return [
        _each("pivot_speed", "| v_i | = | H_i · ξ |", pivot_speeds, "m/s", by.fixed("9")),
        _each("rim_speed", "u_i = r_w · ω_i", rims_mps, "m/s"),
        _each("axle_x", "l_x = cos α_i · sin β_i", np.cos(alpha) * np.sin(beta), "", by("24, 25")),
        _each("axle_y", "l_y = sin α_i", np.sin(alpha), "", by("24, 25")),
        _each("tilt", "sin γ_i = { l_x^2 + l_y^2 }", np.degrees(drive.tilt(joints)), "°"),
        _each("alpha", "α_i = asin { v_x ; r_w · ω_i }", np.degrees(alpha), "°", by("24, 25")),
        _each(
            "beta",
            "β_i = atan2 ( { − v_y ; r_w · ω_i } , { 1 − l_x^2 − l_y^2 } )",
            np.degrees(beta),
            "°",
            by("24, 25"),
        ),
        _each("contact_x", "v_x = r_w · ω_i · sin α_i", rolling[:, 0], "m/s"),
        _each("contact_y", "v_y = − r_w · ω_i · cos α_i · sin β_i", rolling[:, 1], "m/s"),
        _each(
            "contact_speed",
            "| v_i | = r_w · | ω_i | · sin γ_i",
            np.linalg.norm(rolling, axis=-1),
            "m/s",
        ),
        _twist("ξ = ( H^T · H )^−1 · H^T · v", solution, ("m/s", "m/s", "rad/s"), by.fixed("33")),
        _residual("ρ = v − H · ξ", solution),
        _centre_equation(solution.twist),
    ]


def roller_equations(
    drive: OmniKinematics, joints: Array, solution: TwistSolution
) -> list[Equation]:
    """Return the equations of a platform on wheels with rollers at joints (k,)."""
    explained = drive.speeds_from_twist @ solution.twist
    return [
        _each(
            "wheel_speed",
            "φ̇_i = { sin ( λ_i + α_i + ψ_i ) · v_x − cos ( λ_i + α_i + ψ_i ) · v_y"
            " − l_i · cos ( α_i + ψ_i ) · ω ; r · cos ψ_i }",
            explained / RPM,
            "rpm",
            _Source(OMNI_PAPER)("4"),
        ),
        _each("rim_speed", "u_i = r · φ̇_i", drive.wheel_radius_m * joints, "m/s"),
        _twist("ξ = ( J^T · J )^−1 · J^T · φ̇", solution, ("m/s", "m/s", "rad/s")),
        _residual("ρ = r · ( φ̇ − J · ξ )", solution),
        _centre_equation(solution.twist),
    ]


def sphere_equations(
    drive: SphereKinematics, joints: Array, solution: TwistSolution
) -> list[Equation]:
    """Return the equations of a sphere on omni wheels at joints (k,)."""
    explained = drive.speeds_from_twist @ solution.twist
    axis = rotation_axis(drive, solution.twist)
    by, units = _Source(ATLAS_PAPER), ("rad/s", "rad/s", "rad/s")
    return [
        _each("wheel_speed", "φ̇_i = { R ; r } · Ω_i · ω", explained / RPM, "rpm", by("5, 26")),
        _each("rim_speed", "u_i = r · φ̇_i", drive.wheel_radius_m * joints, "m/s"),
        _twist("ω = ( J^T · J )^−1 · J^T · φ̇", solution, units),
        _residual("ρ = r · ( φ̇ − J · ω )", solution),
        _equation("axis", "n = { ω ; | ω | }", axis or (None,) * 3, ("",) * 3),
        _equation(
            "row_offset",
            "sin Δθ = { d ; 2 · ( R + r_r ) }",
            [short(math.degrees(drive.row_offset_rad))],
            ["°"],
            by("12"),
        ),
    ]


def rotation_centre(drive: Kinematics[Any], twist: Array) -> tuple[float, float] | None:
    """Return the instantaneous centre of rotation in `base_link`, m; None for a translation."""
    vx, vy, omega = twist.tolist()
    if drive.pose_type is not SE2 or abs(omega) < _TURNING:
        return None
    return short(-vy / omega), short(vx / omega)


def rotation_axis(drive: Kinematics[Any], twist: Array) -> tuple[float, float, float] | None:
    """Return the unit vector along the axis that a sphere turns about; None at rest."""
    rate = float(np.linalg.norm(twist))
    return None if drive.pose_type is SE2 or rate < _TURNING else triple(twist / rate)


class _Source:
    """Paper of an equation; called with the equation number."""

    def __init__(self, paper: str) -> None:
        self.paper = paper

    def __call__(self, equation: str) -> tuple[str, str, bool]:
        return self.paper, equation, False

    def fixed(self, equation: str) -> tuple[str, str, bool]:
        """Return the source of an equation whose misprint is corrected."""
        return self.paper, equation, True


_OWN = "", "", False
"""Derived in `docs/kinematics.md`."""


def _equation(
    name: str,
    formula: str,
    values: Sequence[float | None],
    units: Sequence[str],
    source: tuple[str, str, bool] = _OWN,
) -> Equation:
    return Equation(name, math_tokens(formula), values, units, *source)


def _each(
    name: str, formula: str, values: Array, unit: str, source: tuple[str, str, bool] = _OWN
) -> Equation:
    numbers = [short(value) for value in values]
    return _equation(name, formula, numbers, [unit] * len(numbers), source)


def _twist(
    formula: str,
    solution: TwistSolution,
    units: Sequence[str],
    source: tuple[str, str, bool] = _OWN,
) -> Equation:
    return _equation("twist", formula, triple(solution.twist), units, source)


def residual_rms_mps(solution: TwistSolution) -> float:
    """Return the root mean square of the residual, m/s."""
    residual = solution.residual
    return short(math.sqrt(float(np.mean(residual * residual)))) if residual.size else 0.0


def _residual(formula: str, solution: TwistSolution) -> Equation:
    return _equation("residual", formula, [short(1000.0 * residual_rms_mps(solution))], ["mm/s"])


def _centre_equation(twist: Array) -> Equation:
    vx, vy, omega = twist.tolist()
    still = abs(omega) < _TURNING
    values = (None, None) if still else (short(-vy / omega), short(vx / omega))
    return _equation("centre", "c = { ( − v_y , v_x ) ; ω }", values, ("m", "m"))
