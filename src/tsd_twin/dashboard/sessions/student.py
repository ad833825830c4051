"""Figures for the Student tab: a built-in robot with modified parameters.

`solve` is pure, without bus, clock or robot. `robots` and `kinematics` provide the mathematics.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import msgspec
import numpy as np

from tsd_twin.dashboard.scene.client_nodes import StudentPose
from tsd_twin.dashboard.scene.robot_geometry import twist_axes_of
from tsd_twin.dashboard.sessions.actuator_telemetry import joint_share
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.sessions.student_equations import (
    residual_rms_mps,
    rotation_axis,
    rotation_centre,
    short,
    triple,
)
from tsd_twin.dashboard.sessions.variants import base_robot, knobs_of, variant, variant_toml
from tsd_twin.dashboard.wire.from_page import StudentRequest
from tsd_twin.dashboard.wire.student import (
    PaperFigure,
    ShippedRobot,
    StudentFigure,
    StudentFigures,
    StudentKnob,
    StudentOutline,
    StudentReply,
)
from tsd_twin.errors import RobotFileError
from tsd_twin.kinematics import Kinematics
from tsd_twin.kinematics.base import largest_twist, section, shadow
from tsd_twin.lie import SE2, Array
from tsd_twin.models import check_room
from tsd_twin.robots import RobotDescription, load_robot, robot_names

_OUTLINE_POINTS = 60
_PLANES = ((0, 1), (0, 2), (1, 2))
_DIRECTIONS = 360
"""Number of directions without turning in which the fastest and slowest are searched."""
_LARGEST = 1e6
"""Limit of twist components in m/s or rad/s, which avoids overflow."""


REBUILD_AFTER_S = 0.25
"""Meshes of a changed robot are rebuilt once its parameters have rested for this time."""


class StudentSession:
    """Per-page student requests, computed one at a time; only the latest waits.

    Event loop only; the computation runs on the planning thread.
    """

    def __init__(
        self,
        executor: RpcExecutor,
        send_message: Callable[[Any], None],
        show: Callable[[StudentPose | None], None],
    ) -> None:
        """`show` draws a robot in the scene of the page; None removes it."""
        self._executor = executor
        self._send_message = send_message
        self._show = show
        self._next: StudentRequest | None = None
        self._task: asyncio.Task[None] | None = None
        self._drawn: RobotDescription | None = None
        self._waiting: StudentPose | None = None
        self._timer: asyncio.TimerHandle | None = None

    def request(self, request: StudentRequest) -> None:
        """Answer a request, unless a newer one replaces it while it waits."""
        self._next = request
        if self._task is None:
            self._task = asyncio.create_task(self._answer())

    def close(self) -> None:
        """Stop answering requests."""
        self._next = None
        if self._task is not None:
            self._task.cancel()
        self._draw(None)

    async def _answer(self) -> None:
        try:
            while self._next is not None:
                request, self._next = self._next, None
                reply, pose = await self._executor.plan(solve, request)
                self._send_message(reply)
                if not request.show or pose is not None:  # Otherwise keep the last valid one.
                    self._draw(pose if request.show else None)
        finally:
            self._task = None

    def _draw(self, pose: StudentPose | None) -> None:
        """Show a pose, at once or, if its robot has changed, once that has rested."""
        if pose is not None and pose.robot != self._drawn:
            rests = self._waiting is not None and self._waiting.robot == pose.robot
            self._waiting = pose
            if not rests:
                self._cancel_timer()
                loop = asyncio.get_running_loop()
                self._timer = loop.call_later(REBUILD_AFTER_S, self._show_waiting)
            return
        self._cancel_timer()
        self._waiting = None
        if pose is not None or self._drawn is not None:
            self._show_now(pose)

    def _show_waiting(self) -> None:
        pose, self._waiting = self._waiting, None
        self._show_now(pose)

    def _show_now(self, pose: StudentPose | None) -> None:
        self._drawn = None if pose is None else pose.robot
        self._show(pose)

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


def solve(request: StudentRequest) -> tuple[StudentReply, StudentPose | None]:
    """Return the reply to a request, and the pose to draw if the robot is possible."""
    knobs: list[StudentKnob] = []
    figures, toml, problem, papers, pose = None, None, "", list[PaperFigure](), None
    try:
        changed = dict(request.knobs)
        knobs = _knobs(request.base, changed)
        robot = variant(request.base, changed)
        joints, figures = solution_of(robot, np.array(request.twist), request.joints)
        study = view_of(robot).study
        papers = study.papers(robot) if request.papers and study is not None else []
        check_room(robot)  # Figures do not require a valid body, but the file does.
        pose = StudentPose(robot, joints, figures.centre)
        if request.toml:
            toml = variant_toml(request.base, changed)
    except RobotFileError as error:
        problem = error.problem
    reply = StudentReply(
        number=request.number,
        base=request.base,
        bases=_bases(),
        knobs=knobs,
        figures=figures,
        problem=problem,
        toml=toml,
        papers=papers,
    )
    return reply, pose


def solution_of(
    robot: RobotDescription, twist: Array, numbers: Sequence[Sequence[float]] | None = None
) -> tuple[Array, StudentFigures]:
    """Return the joint vector (n,) and all figures, from a twist (3,) or from joint values.

    Raises:
        RobotFileError: If the robot has another number of joints.
    """
    drive, study = robot.kinematics(), view_of(robot).study
    if numbers is None or study is None:
        asked = np.clip(np.nan_to_num(twist), -_LARGEST, _LARGEST)
        share = float(drive.joint_utilization(asked))
        joints = drive.inverse(asked / max(1.0, share))
    else:
        joints = study.joints(robot, numbers)
        share = joint_share(drive, joints) or 0.0
    solution = drive.forward(joints)
    figures = StudentFigures(
        axes=twist_axes_of(drive),
        tops=triple(np.diag(largest_twist(drive, np.eye(3)))),
        figures=_figures(robot, drive),
        outlines=[_outline(drive, plane) for plane in _PLANES],
        twist=triple(solution.twist),
        utilization=short(share),
        wheels=[] if study is None else study.wheels(robot, joints, solution),
        radius_m=drive.wheel_radius_m,
        residual_mps=residual_rms_mps(solution),
        redundancy=max(0, solution.residual.size - 3),
        centre=rotation_centre(drive, solution.twist),
        axis=rotation_axis(drive, solution.twist),
        equations=[] if study is None else study.equations(drive, joints, solution),
    )
    return joints, figures


@cache
def _bases() -> list[ShippedRobot]:
    return [ShippedRobot(name, load_robot(name).title) for name in robot_names()]


def _knobs(base: str, changed: dict[str, float]) -> list[StudentKnob]:
    return [
        msgspec.structs.replace(knob, value=changed.get(key, knob.value))
        for key, knob in knobs_of(base_robot(base)).items()
    ]


def _figures(robot: RobotDescription, drive: Kinematics[Any]) -> list[StudentFigure]:
    axes = twist_axes_of(drive)
    tops = np.diag(largest_twist(drive, np.eye(3)))
    if drive.pose_type is not SE2:
        return [
            StudentFigure(f"Top rate {one.symbol}", short(top), one.unit)
            for one, top in zip(axes, tops, strict=True)
        ]
    angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    speeds: Array = np.linalg.norm(largest_twist(drive, directions), axis=-1)
    speeds = np.round(speeds, 9)  # Among equal speeds, the first one is reported.
    slow, fast = int(speeds.argmin()), int(speeds.argmax())
    figures = [
        StudentFigure("Top speed forward", short(tops[0]), "m/s"),
        StudentFigure("Top speed to the left", short(tops[1]), "m/s"),
        StudentFigure("Slowest direction", short(speeds[slow]), "m/s", _towards(slow)),
        StudentFigure("Fastest direction", short(speeds[fast]), "m/s", _towards(fast)),
        StudentFigure("Top turn rate", short(tops[2]), "rad/s"),
    ]
    if (wheel_speeds := robot.wheel_speed_range) is not None:
        rim_mps = wheel_speeds.kinematics.wheel_radius_m * wheel_speeds.kinematics.spin_rad_per_s
        step_mps = rim_mps * wheel_speeds.servo_step_rad
        turn = step_mps / float(np.max(wheel_speeds.kinematics.pivot_radius_m))
        figures += [
            StudentFigure("Speed for one servo step", short(1000.0 * step_mps), "mm/s"),
            StudentFigure("Turn rate for one servo step", short(turn), "rad/s"),
            StudentFigure("Servo steps to the top speed", short(tops[0] / step_mps), ""),
        ]
    limits = robot.limits
    return [
        *figures,
        StudentFigure("Speed limit of the description", limits.speed_mps, "m/s", "[limits]"),
        StudentFigure("Turn limit", limits.turn_rate_rad_per_s, "rad/s", "[limits]"),
    ]


def _towards(degrees: int) -> str:
    turned = degrees - 360 if degrees > 180 else degrees
    return f"towards {turned}°"


def _outline(drive: Kinematics[Any], plane: tuple[int, int]) -> StudentOutline:
    return StudentOutline(
        axes=plane,
        section=_drawn(section(drive, plane, _OUTLINE_POINTS)),
        shadow=_drawn(shadow(drive, plane, _OUTLINE_POINTS)),
    )


def _drawn(points: Array) -> list[tuple[float, float]]:
    """Round points (k, 2) to the four digits a drawing needs."""
    return [(float(f"{a:.4g}"), float(f"{b:.4g}")) for a, b in points]
