"""Telemetry for pages: robot info, state, and the values of gimbals, wheels and sphere."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, Protocol, TypeAlias

import numpy as np

from tsd_twin.client.connection import RobotMonitor, RoundTrips, Snapshot
from tsd_twin.dashboard.scene.robot_geometry import commanded_joints, twist_axes_of
from tsd_twin.dashboard.server.messages_from_page import Triple
from tsd_twin.dashboard.server.messages_to_page import (
    EstimateDifference,
    GimbalState,
    RobotInfo,
    RobotState,
    SpeedLimits,
    SphereState,
    TwistAxisInfo,
    WheelSpeedLimits,
    WheelState,
)
from tsd_twin.kinematics import JointKind, OmniKinematics, SphereKinematics
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.ros import ODOM, JointState, Odometry
from tsd_twin.messages.status import Status
from tsd_twin.robots import (
    RPM,
    ImportedDescription,
    OmniDescription,
    SingularityDescription,
    SphereDescription,
    implementation,
    kind_of,
)

MIN_SPIN_SHARE = 0.01
"""A wheel that turns with less than this share of its cruising speed is shown as at rest."""
_ROUNDING = 1e-6


class GimbalTelemetry:
    """Telemetry of gimbals: measured and commanded angles, tilt and axle direction."""

    def __init__(self, robot: SingularityDescription) -> None:
        self._robot = robot
        self._drive = robot.kinematics()
        # From the module frame of the kinematics to the robot's: a turn by azimuth - pi/2.
        turn = self._drive.azimuths_rad - np.pi / 2
        c, s = np.cos(turn), np.sin(turn)
        self._base_from_module = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        speeds = self._robot.wheel_speed_range
        return {
            "panel": "gimbals",
            "max_tilt_deg": self._robot.drive.max_tilt_deg,
            "modules": self._drive.actuators,
            "wheel_speed_limits": WheelSpeedLimits(
                least_rpm=math.ceil(speeds.least_rad_per_s / RPM - _ROUNDING),
                most_rpm=math.floor(speeds.most_rad_per_s / RPM + _ROUNDING),
                usual_rpm=round(self._drive.spin_rad_per_s / RPM),
                wheel_radius_m=self._drive.wheel_radius_m,
                servo_step_deg=math.degrees(speeds.servo_step_rad),
            ),
        }

    def state(self, joints: Array, setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        measured, wanted = joints.reshape(-1, 3), setpoint.reshape(-1, 3)
        degrees, wanted_degrees = np.degrees(measured), np.degrees(wanted)
        tilt = np.degrees(self._drive.tilt(joints))
        radius_mm = 1000.0 * self._drive.effective_radius_m(joints)
        axles, wanted_axles = self._axles(joints), self._axles(setpoint)
        slow = MIN_SPIN_SHARE * self._drive.spin_rad_per_s
        modules = [
            GimbalState(
                alpha=round(float(degrees[i, 0]), 2),
                beta=round(float(degrees[i, 1]), 2),
                tilt=round(float(tilt[i]), 2),
                radius_mm=round(float(radius_mm[i]), 2),
                rpm=round(float(measured[i, 2]) / RPM),
                set_alpha=round(float(wanted_degrees[i, 0]), 2),
                set_beta=round(float(wanted_degrees[i, 1]), 2),
                axle=(round(float(axles[i, 0]), 4), round(float(axles[i, 1]), 4)),
                set_axle=(round(float(wanted_axles[i, 0]), 4), round(float(wanted_axles[i, 1]), 4)),
                spinning=bool(abs(measured[i, 2]) > slow),
            )
            for i in range(len(measured))
        ]
        return {"modules": modules}

    def _axles(self, joints: Array) -> Array:
        """Return the tilt directions (k, 2) of the axles in `base_link`; length 1 is the tilt
        limit.
        """
        modules = joints.reshape(-1, 3)
        alpha, beta = modules[:, 0], modules[:, 1]
        axles = np.stack([np.cos(alpha) * np.sin(beta), np.sin(alpha)], axis=-1)
        lean = (self._base_from_module @ axles[..., None])[..., 0]
        return lean / np.sin(self._drive.max_tilt_rad)


class WheelTelemetry:
    """Telemetry of wheels: measured and commanded speed, and the consistency residual."""

    def __init__(self, robot: OmniDescription) -> None:
        self._drive = robot.kinematics()
        self._has_other_sensors = bool(robot.sensors)

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        return {
            "panel": "wheels",
            "wheels": self._drive.actuators,
            "max_rpm": round(self._drive.max_speed_rad_per_s / RPM, 1),
            "alternative_estimate": "driven wheels" if self._has_other_sensors else None,
        }

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        return {
            "wheels": wheel_states(self._drive, joints, setpoint),
            "estimate_difference": _planar_difference(snapshot),
        }


def wheel_states(
    drive: OmniKinematics | SphereKinematics, joints: Array, setpoint: Array
) -> list[WheelState]:
    """Return the states of all wheels, from the joint vectors (k,)."""
    residual = drive.forward(joints).residual
    return [
        WheelState(
            rpm=round(float(joints[i]) / RPM, 1),
            set_rpm=round(float(setpoint[i]) / RPM, 1),
            residual_mps=round(float(residual[i]), 4),
        )
        for i in range(len(joints))
    ]


def _planar_difference(snapshot: Snapshot) -> EstimateDifference | None:
    """Return how far the other estimate is from the estimate."""
    if snapshot.odom is None or snapshot.alternative is None:
        return None
    off = snapshot.alternative.xy_heading - snapshot.odom.xy_heading
    return EstimateDifference(
        metres=round(math.hypot(off[0], off[1]), 4),
        degrees=round(abs(float(np.degrees(wrap(off[2])))), 2),
    )


class TwistTelemetry:
    """Telemetry of robots that follow a twist: what cannot be promised for them."""

    def __init__(self, robot: ImportedDescription) -> None:
        self._robot = robot

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        return {"panel": "twist", "not_promised": self._robot.not_promised}

    def state(self, _joints: Array, _setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return no fields of `RobotState`: it has the twists for all robots."""
        return {}


_MIN_RATE_RAD_PER_S = 0.02
"""Below this, directions of two angular velocities say nothing."""


class SphereTelemetry:
    """Telemetry of spheres: wheels, orientation, and angular velocity by both contact models."""

    def __init__(self, robot: SphereDescription) -> None:
        self._drive = robot.kinematics()
        self._dual_first = robot.estimate.model == "dual"

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        return {
            "panel": "sphere",
            "wheels": self._drive.actuators,
            "max_rpm": round(self._drive.max_speed_rad_per_s / RPM, 1),
            "alternative_estimate": "ideal model" if self._dual_first else "dual-row model",
        }

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        return {
            "wheels": wheel_states(self._drive, joints, setpoint),
            "sphere": self._ball(snapshot, joints),
            "estimate_difference": _orientation_difference(snapshot),
        }

    def _ball(self, snapshot: Snapshot, joints: Array) -> SphereState | None:
        odom, other = snapshot.odom, snapshot.alternative
        if odom is None or odom.wxyz is None:
            return None
        dual = odom if self._dual_first else other
        ideal = self._drive.forward(joints).twist
        w, x, y, z = (round(float(part), 5) for part in odom.wxyz)
        return SphereState(
            wxyz=(w, x, y, z),
            ideal=_triple(ideal),
            dual=None if dual is None else _triple(dual.twist),
            angle_deg=None if dual is None else _angle_deg(ideal, dual.twist),
            magnitude_percent=None if dual is None else _magnitude_percent(ideal, dual.twist),
            rows=self._rows(joints, dual),
        )

    def _rows(self, joints: Array, dual: Odometry | None) -> list[int]:
        """Return the row of rollers in contact of each wheel, 1 or 2; 0 when it cannot be
        determined.

        A wheel's speed is (R / r) (cos Omega_i + side sin R_i) . w: what is not explained by the
        ideal contact is the side, -1 on the first row.
        """
        drive = self._drive
        if dual is None or drive.row_offset_rad == 0.0:
            return [0] * drive.wheels
        scaled = joints * drive.wheel_radius_m / drive.sphere_radius_m
        rest = scaled - math.cos(drive.row_offset_rad) * (drive.axes @ dual.twist)
        lever = math.sin(drive.row_offset_rad) * (drive.contacts @ dual.twist)
        clear = np.abs(lever) > math.sin(drive.row_offset_rad) * _MIN_RATE_RAD_PER_S
        side = np.where(clear, rest / np.where(clear, lever, 1.0), 0.0)
        return [0 if abs(one) < 0.5 else (1 if one < 0.0 else 2) for one in side]


def _orientation_difference(snapshot: Snapshot) -> EstimateDifference | None:
    """Return the rotation between the alternative estimate and the estimate."""
    odom, other = snapshot.odom, snapshot.alternative
    if odom is None or other is None or odom.wxyz is None or other.wxyz is None:
        return None
    between = SO3(odom.wxyz).inverse() @ SO3(other.wxyz)
    return EstimateDifference(
        metres=0.0, degrees=round(float(np.degrees(np.linalg.norm(between.log()))), 2)
    )


def _angle_deg(a: Array, b: Array) -> float | None:
    """Return the angle between two angular velocities; None when one is too small."""
    lengths = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(lengths) < _MIN_RATE_RAD_PER_S:
        return None
    return round(math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))), 2)


def _magnitude_percent(ideal: Array, dual: Array) -> float | None:
    """Return 1 - |ideal| / |dual| in percent, as in Fig. 7 of the paper."""
    length = float(np.linalg.norm(dual))
    if length < _MIN_RATE_RAD_PER_S:
        return None
    return round(100.0 * (1.0 - float(np.linalg.norm(ideal)) / length), 2)


def _triple(values: Array) -> Triple:
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c


SPEED_LEVELS_PERCENT = (20, 50, 80, 100)
"""Selectable speeds in percent of the limits."""


class ActuatorTelemetry(Protocol):
    """Telemetry of one kind of robot: fields of `RobotInfo` and `RobotState`, by name."""

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        ...

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot, /) -> dict[str, Any]:
        """Return the fields of `RobotState`, from joint vectors (n,)."""
        ...


class RobotTelemetry:
    """Telemetry of a robot: `RobotInfo` and `RobotState` of its client."""

    def __init__(self, link: RobotMonitor) -> None:
        self.link = link
        self._kinematics = link.kinematics
        self._order = [joint.name for joint in link.kinematics.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in link.kinematics.joints])
        self._actuators: ActuatorTelemetry = implementation(kind_of(link.robot).telemetry)(
            link.robot
        )
        has_alternative = self._actuators.info().get("alternative_estimate") is not None
        self.plot_fields = PlotFields(link, has_alternative=has_alternative)
        """Values for plots, on request."""

    def info(self) -> RobotInfo:
        """Return the constant data."""
        robot = self.link.robot
        return RobotInfo(
            id=self.link.id,
            title=robot.title,
            limits=SpeedLimits(robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s),
            levels=SPEED_LEVELS_PERCENT,
            space="floor" if self._kinematics.pose_type is SE2 else "sphere",
            twist_axes=[
                TwistAxisInfo(one.name, one.symbol, one.unit)
                for one in twist_axes_of(self._kinematics)
            ],
            twist_scale_m=self._kinematics.twist_scale_m,
            plot_fields=self.plot_fields.names,
            **self._actuators.info(),
        )

    def state(
        self,
        snapshot: Snapshot,
        status: Status,
        now_s: float,
        *,
        mode_age_s: float,
        round_trips: RoundTrips,
    ) -> RobotState:
        """Return the latest state; null for messages not yet received."""
        typical_s, jitter_s = round_trips.median_s(), round_trips.jitter_s()
        joints = self._joint_vector(snapshot.joints)
        setpoint = self._joint_vector(snapshot.setpoint)
        odom, truth = snapshot.odom, snapshot.truth
        figures: dict[str, Any] = {}
        if joints is not None and setpoint is not None:
            figures = self._actuators.state(joints, setpoint, snapshot)
        return RobotState(
            seen=snapshot.status_seq,
            robot_s=round(snapshot.status_robot_s, 6),
            age_ms=round(1000.0 * (now_s - snapshot.received_s), 1),
            source=snapshot.source,
            status=status,
            mode_age_s=round(mode_age_s, 1),
            you=False,
            robot_ms=_milliseconds(typical_s),
            robot_jitter_ms=_milliseconds(jitter_s),
            pose=self._planar_pose(odom),
            twist=_rounded(odom.twist) if odom else None,
            commanded=self._commanded(setpoint, joints),
            truth=self._planar_pose(truth),
            **figures,
        )

    def _commanded(self, setpoint: Array | None, joints: Array | None) -> Triple | None:
        if setpoint is None:
            return None
        if joints is not None:
            setpoint = commanded_joints(self._kinematics, setpoint, joints)
        return _rounded(self._kinematics.forward(setpoint).twist)

    def _planar_pose(self, said: Odometry | None) -> Triple | None:
        """Return the planar pose of a robot, or None for a sphere."""
        return None if said is None or said.wxyz is not None else _rounded(said.xy_heading)

    def _joint_vector(self, state: JointState | None) -> Array | None:
        """Return a joint vector (n,), or None if a joint of this robot is missing."""
        if state is None:
            return None
        place = {name: i for i, name in enumerate(state.names)}
        if not all(name in place for name in self._order):
            return None
        rows = [place[name] for name in self._order]
        joints = np.where(self._is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])
        return joints if np.isfinite(joints).all() else None


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 2)


def _rounded(values: Array) -> Triple:
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c


REQUEST_TIMEOUT_S = 0.25
"""Maximum age of an active drive command."""
_SUFFIXES = {"m/s": "mps", "rad/s": "rad_per_s"}
_POSE = ("x_m", "y_m", "heading_rad")

_Reader: TypeAlias = Callable[[Snapshot], float | None]


class PlotFields:
    """Plot fields of a robot by name, such as `joints.wheel1.velocity_rad_per_s`.

    The last part of a name ends with the unit. `requested` is the twist commanded by this dashboard
    before the robot's limits.
    """

    def __init__(self, link: RobotMonitor, *, has_alternative: bool) -> None:
        """List the fields of a robot, which may have an alternative estimate."""
        self._link = link
        self._readers: dict[str, _Reader] = {}
        robot, kinematics = link.robot, link.kinematics
        axes = [f"{axis.name}_{_SUFFIXES[axis.unit]}" for axis in twist_axes_of(kinematics)]
        for stream, joints in (
            ("setpoint", kinematics.joints),
            ("joints", [*kinematics.joints, *robot.sensors]),
        ):
            for joint in joints:
                is_angle = joint.kind is JointKind.POSITION
                value = "position_rad" if is_angle else "velocity_rad_per_s"
                self._readers[f"{stream}.{joint.name}.{value}"] = partial(
                    _joint_value, stream, joint.name, value
                )
        for i, axis in enumerate(axes):
            self._readers[f"requested.{axis}"] = lambda _, i=i: self._requested(i)
        is_planar = kinematics.pose_type is SE2
        for stream in ("odom", *(["alternative"] if has_alternative else []), "truth"):
            self._add_odometry(stream, "twist", "twist", axes)
            if is_planar:
                self._add_odometry(stream, "pose", "xy_heading", _POSE)
        if is_planar:
            for i, name in enumerate(_POSE):
                self._readers[f"odom.sigma.{name}"] = partial(_sigma, i)

    @property
    def names(self) -> list[str]:
        """Names of all fields that a page can request."""
        return list(self._readers)

    def values(self, names: Iterable[str], snapshot: Snapshot) -> dict[str, float | None]:
        """Return fields by name, None if not received; unknown names are ignored."""
        return {
            name: read(snapshot) for name in names if (read := self._readers.get(name)) is not None
        }

    def _add_odometry(self, stream: str, group: str, part: str, names: Sequence[str]) -> None:
        for i, name in enumerate(names):
            self._readers[f"{stream}.{group}.{name}"] = partial(_odometry_value, stream, part, i)

    def _requested(self, i: int) -> float:
        """Return a component of the latest command in the robot's axes, or 0 if it has expired."""
        commands = self._link.sent_commands
        if not commands or time.monotonic() - commands[-1].sent_s > REQUEST_TIMEOUT_S:
            return 0.0
        twist, odom = commands[-1].twist, self._link.snapshot.odom
        if commands[-1].frame == ODOM and odom is not None:
            twist = _turned(twist, -float(odom.xy_heading[2]))
        return float(twist[i])


def _joint_value(stream: str, joint: str, value: str, snapshot: Snapshot) -> float | None:
    state: JointState | None = getattr(snapshot, stream)
    if state is None or joint not in state.names:
        return None
    return float(getattr(state, value)[list(state.names).index(joint)])


def _odometry_value(stream: str, part: str, i: int, snapshot: Snapshot) -> float | None:
    odom: Odometry | None = getattr(snapshot, stream)
    return None if odom is None else float(getattr(odom, part)[i])


def _sigma(i: int, snapshot: Snapshot) -> float | None:
    odom = snapshot.odom
    return None if odom is None else math.sqrt(max(0.0, float(odom.pose_covariance[i, i])))


def _turned(twist: Array, angle_rad: float) -> Array:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]])
