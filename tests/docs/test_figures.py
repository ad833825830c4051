"""Equations and numbers of docs/kinematics.md, computed again."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from tsd_twin.kinematics import TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import RPM, load_robot

PAGE = Path("docs/kinematics.md")
TEXT = (Path(__file__).parents[2] / PAGE).read_text(encoding="utf-8")
ROBOT = load_robot("tsd")
DRIVE = ROBOT.kinematics()
R, RW, SPIN = DRIVE.pivot_radius_m, DRIVE.wheel_radius_m, DRIVE.spin_rad_per_s
FORWARD, LEFT, TURN = np.eye(3)
FLAT = DRIVE.contact_from_twist.reshape(-1, 3)


def row(begin: str) -> str:
    """Return the only line of the page that starts with `begin`."""
    (line,) = [line for line in TEXT.splitlines() if line.startswith(begin)]
    return line


def test_the_matrix_of_the_page_is_that_of_the_code() -> None:
    for theta, h in zip(DRIVE.azimuths_rad, DRIVE.contact_from_twist, strict=True):
        s, c = np.sin(theta), np.cos(theta)
        np.testing.assert_allclose([[s, -c, -R], [c, s, 0.0]], h, atol=1e-15)
    np.testing.assert_allclose(FLAT.T @ FLAT, np.diag([3.0, 3.0, 3.0 * R**2]), atol=1e-14)
    np.testing.assert_allclose(
        np.linalg.inv(FLAT.T @ FLAT) @ FLAT.T, DRIVE.twist_from_contacts, atol=1e-14
    )


def test_the_rolling_equations_of_the_page_are_those_of_the_code() -> None:
    random = np.random.default_rng(0)
    for _ in range(100):
        joints, rates = random.uniform(-0.5, 0.5, (2, 3, 3)) * [1.0, 1.0, 600.0]
        (a, b, spin), (a_rate, b_rate, _) = joints.T, rates.T
        v = RW * np.stack(
            [spin * np.sin(a) + b_rate, -spin * np.cos(a) * np.sin(b) + a_rate * np.cos(b)], axis=-1
        )
        found = DRIVE.contacts(joints.reshape(-1), rates.reshape(-1))
        np.testing.assert_allclose(found, v, rtol=1e-12, atol=1e-15)


def test_the_inverse_of_the_page_is_that_of_the_code() -> None:
    random = np.random.default_rng(0)
    twists = DRIVE.limit(random.normal(size=(1000, 3)))
    v = np.einsum("kij,nj->nki", DRIVE.contact_from_twist, twists)
    lx, ly = -v[..., 1] / (RW * SPIN), v[..., 0] / (RW * SPIN)
    joints = DRIVE.inverse(twists).reshape(1000, 3, 3)
    np.testing.assert_allclose(joints[..., 0], np.arcsin(ly), atol=1e-15)
    beta = np.arctan2(lx, np.sqrt(1.0 - lx**2 - ly**2))
    np.testing.assert_allclose(joints[..., 1], beta, atol=1e-15)
    left_over = DRIVE.contacts(joints.reshape(1000, 9)) - v
    assert "2e-15 m/s are left" in TEXT
    assert np.abs(left_over).max() < 2e-15


def test_leaning_is_to_the_left_of_the_way_and_inward_for_a_left_turn() -> None:
    for twist in (FORWARD, LEFT, np.array([0.6, -0.8, 0.0])):
        for theta, axle in zip(DRIVE.azimuths_rad, DRIVE.axles(twist), strict=True):
            to_robot = turn(theta - np.pi / 2)
            left_of_way = turn(np.pi / 2) @ twist[:2]
            np.testing.assert_allclose(to_robot @ axle, left_of_way / (RW * SPIN), atol=1e-15)
    assert (DRIVE.inverse(TURN).reshape(3, 3)[:, 0] < 0.0).all()


def test_the_figures_of_the_drive() -> None:
    joints = DRIVE.inverse(FORWARD)
    (tilt, *_), (radius, *_) = (
        np.degrees(DRIVE.tilt(joints)),
        1000 * DRIVE.effective_radius_m(joints),
    )
    motor, servo = ROBOT.motor, ROBOT.servo
    assert np.abs(joints.reshape(3, 3)[0, :2]).max() * 1000 * RW == pytest.approx(3.8, abs=0.05)
    assert "3.8 mm between rest and 1 m/s" in TEXT
    assert f"{RW * SPIN:.2f} m/s" in row("| wheels at 2,500 rpm")
    assert f"{tilt:.1f}° of tilt, effective radius {radius:.1f} mm" in row("| 1 m/s |")
    assert f"| {1 / DRIVE.joint_utilization(FORWARD):.1f} m/s |" in row("| 30° of tilt")
    step = 2 * np.pi / servo.steps_per_turn
    assert f"{np.degrees(step):.3f}° | {1000 * step * RW * SPIN:.0f} mm/s" in row(
        "| one servo step"
    )
    speed = servo.no_load_speed_rpm
    assert f"{speed:.0f} rpm = {np.degrees(speed * RPM):.0f} °/s" in row("| servo")
    lowest, highest = motor.start_speed_rpm, min(curve[-1] for curve in motor.speed_rpm)
    ends = f"about {lowest:,.0f} and {round(highest, -2):,.0f} rpm"
    assert ends in row("| drive motors")
    assert f"{1 / DRIVE.rate_utilization(FORWARD, 1.0):.0f} m/s²" in TEXT
    growth = DRIVE.rate_utilization(FORWARD, 1.0) * speed * RPM / np.hypot(*DRIVE.axles(FORWARD)[0])
    assert growth == pytest.approx(7 / 6)
    assert "(7/6 for 30°)" in TEXT


@pytest.mark.parametrize(("first", "begin"), [(0, "| straight line"), (2, "| the same without")])
def test_the_lines_through_the_motor_table(first: int, begin: str) -> None:
    signal = ROBOT.motor.signal[first:]
    fits = [np.polyfit(signal, curve[first:], 1) for curve in ROBOT.motor.speed_rpm]
    # Exact ties, such as 563.25, may be rounded either way.
    printed = [float(n) for n in re.findall(r"\d+\.\d+", row(begin))]
    np.testing.assert_allclose(printed, np.ravel([[a, -b] for a, b in fits]), atol=0.0501)


def test_the_residuals_of_one_module_that_is_off() -> None:
    joints = DRIVE.inverse(FORWARD).reshape(3, 3)

    def rms_mm(motion: TwistSolution) -> float:
        return 1000.0 * float(np.sqrt(np.mean(motion.residual**2)))

    def off(module: int, part: int, by: Callable[[float], float]) -> float:
        wrong = joints.copy()
        wrong[module, part] = by(wrong[module, part])
        return rms_mm(DRIVE.forward(wrong.reshape(-1)))

    tilted, slow = [], []
    for module in range(3):
        tilted += [off(module, part, lambda angle: angle + np.radians(1.0)) for part in (0, 1)]
        slow.append(off(module, 2, lambda spin: 0.9 * spin))
    assert f"| {min(tilted):.0f} to {max(tilted):.0f} mm/s |" in row("| 1° of")
    assert f"| {min(slow):.0f} to {max(slow):.0f} mm/s |" in row("| 10 % of its measured spin")
    slowed = joints.copy()
    slowed[0, 2] *= 0.9
    assert f"{DRIVE.forward(slowed.reshape(-1)).twist[2]:.2f} rad/s unseen" in TEXT
    noise = ROBOT.noise
    sigma = np.tile([np.radians(noise.gimbal_angle_deg)] * 2 + [noise.speed_scale_sigma * SPIN], 3)
    nudge = 1e-6 * np.eye(9)
    ends = [DRIVE.forward(joints.reshape(-1) + sign * nudge).residual for sign in (1.0, -1.0)]
    shift = sigma[:, None] * (ends[0] - ends[1]) / 2e-6
    beyond = chi2.isf(1e-4, 3)
    assert f"above {beyond:.1f}," in row("| evidence")
    least, _, most = 1000.0 * np.sqrt(beyond * np.linalg.eigvalsh(shift.T @ shift)[-3:] / 6.0)
    assert f"| {least:.0f} to {most:.0f} mm/s, by direction |" in row("| evidence")


def turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def astray(printed: Callable[[float], Array], twist: Array) -> tuple[float, float]:
    """Minimum and maximum deviation of rolling velocity from the twist, for a printed matrix."""
    by_module = [
        np.linalg.norm((printed(theta) - h) @ twist)
        for theta, h in zip(DRIVE.azimuths_rad, DRIVE.contact_from_twist, strict=True)
    ]
    return min(by_module), max(by_module)


def body(theta: float) -> Array:
    return np.array([[1.0, 0.0, -R * np.sin(theta)], [0.0, 1.0, R * np.cos(theta)]])


def eq_3(theta: float) -> Array:
    printed = np.array([[1.0, 0.0, np.sin(theta) / R], [0.0, 1.0, np.cos(theta) / R]])
    return turn(np.pi / 2 - theta) @ printed


def eq_4(theta: float) -> Array:
    printed = body(theta)
    printed[:, :2] = 1.0
    return turn(np.pi / 2 - theta) @ printed


def eq_7(theta: float) -> Array:
    return turn(-theta) @ body(theta)


def eq_9(theta: float) -> Array:
    return turn(-theta) @ np.array([[1, 1, np.sin(theta) / R], [1, 1, np.cos(theta) / R]])


@pytest.mark.parametrize(
    ("begin", "printed", "twist", "figure"),
    [
        ("| 2, 3 |", eq_3, TURN, "turn: 6.6 to 6.8 m/s"),
        ("| 4 |", eq_4, FORWARD, "forward, left: 1.0 m/s"),
        ("| 4 |", eq_4, LEFT, "forward, left: 1.0 m/s"),
        ("| 7 |", eq_7, FORWARD, "forward, left: 1.4 m/s"),
        ("| 7 |", eq_7, LEFT, "forward, left: 1.4 m/s"),
        ("| 7 |", eq_7, TURN, "turn: 0.2 m/s"),
        ("| 6, 9 |", eq_9, FORWARD, "forward: 1.0 m/s"),
        ("| 6, 9 |", eq_9, LEFT, "left: 2.2 m/s"),
        ("| 6, 9 |", eq_9, TURN, "turn: 6.5 to 6.8 m/s"),
    ],
)
def test_what_the_printed_equations_would_do(
    begin: str, printed: Callable[[float], Array], twist: Array, figure: str
) -> None:
    assert figure in row(begin)
    stated = [float(n) for n in re.findall(r"\d+\.\d", figure)]
    np.testing.assert_allclose(astray(printed, twist), (stated[0], stated[-1]), atol=0.05)


def test_the_other_misprints() -> None:
    gamma = np.radians(30.0)
    assert np.sqrt(np.cos(gamma) + np.sin(gamma) ** 2) == pytest.approx(1.056, abs=0.0005)
    assert "1.056, a cosine above one" in row("| 19, 21 |")
    back = np.array([-1.0, 0.0])
    angle = np.arctan(back[1] / back[0])
    reversed_by = np.linalg.norm(np.array([np.cos(angle), np.sin(angle)]) - back)
    assert f"{reversed_by:.1f} m/s at 1 m/s" in row("| 28 |")
    with pytest.raises(ValueError, match="broadcast"):
        FLAT.T + FLAT
