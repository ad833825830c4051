"""Joints of robots for pages, by kind: gimbals, wheels, sphere and joints."""

from __future__ import annotations

import math
from typing import Any, Protocol

import msgspec
import numpy as np

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.robot_geometry import commanded_joints
from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.to_page import (
    EstimateDifference,
    GimbalPose,
    GimbalState,
    JointInfo,
    JointValue,
    LimitName,
    SphereState,
    WheelPose,
    WheelSpeedLimits,
    WheelState,
)
from tsd_twin.kinematics import (
    Joint,
    JointKind,
    Kinematics,
    OmniKinematics,
    SingularityKinematics,
    SphereKinematics,
)
from tsd_twin.lie import SO3, Array, wrap
from tsd_twin.messages.cdr import Odometry
from tsd_twin.motion import TwistLimiter
from tsd_twin.robots import (
    RPM,
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)

_UPRIGHT_RAD = 1e-6
"""Smaller tilts have no direction."""


class GimbalDisplay:
    """Computes what pages show of the joints of a singularity drive."""

    def __init__(self, drive: SingularityKinematics) -> None:
        self.drive = drive
        # From the module frame of the kinematics to the robot's: a turn by azimuth - pi/2.
        turn = drive.azimuths_rad - np.pi / 2
        c, s = np.cos(turn), np.sin(turn)
        self._base_from_module = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def axles(self, joints: Array) -> Array:
        """Return the horizontal parts (k, 2) of the unit axles in `base_link`, for joints (3k,)."""
        modules = joints.reshape(-1, 3)
        alpha, beta = modules[:, 0], modules[:, 1]
        return self._in_base(np.stack([np.cos(alpha) * np.sin(beta), np.sin(alpha)], axis=-1))

    def pushes(self, joints: Array) -> Array:
        """Return the rolling velocities (k, 2) of the pivots in `base_link`, m/s."""
        return self._in_base(self.drive.contacts(joints))

    def residuals(self, residual: Array) -> Array:
        """Return the residual (2k,) of `forward` as vectors (k, 2) in `base_link`, m/s."""
        return self._in_base(residual.reshape(-1, 2))

    def poses(self, joints: Array) -> list[GimbalPose]:
        """Return the modules for joints (3k,)."""
        limit = math.sin(self.drive.max_tilt_rad)
        axles, pushes, tilts = self.axles(joints), self.pushes(joints), self.drive.tilt(joints)
        return [
            GimbalPose(
                alpha=round(math.degrees(alpha), 2),
                beta=round(math.degrees(beta), 2),
                tilt=round(math.degrees(tilts[i]), 2),
                direction=_direction_deg(axles[i], tilts[i]),
                axle=_pair(axles[i] / limit),
                push=_pair(pushes[i]),
                rpm=round(spin / RPM),
            )
            for i, (alpha, beta, spin) in enumerate(joints.reshape(-1, 3).tolist())
        ]

    def _in_base(self, vectors: Array) -> Array:
        return (self._base_from_module @ vectors[..., None])[..., 0]


def wheel_poses(drive: OmniKinematics | SphereKinematics, joints: Array) -> list[WheelPose]:
    """Return the wheels for joints (k,)."""
    pushes = rim_velocities(drive, joints)
    return [
        WheelPose(rpm=round(speed / RPM, 1), push=_pair(pushes[i]))
        for i, speed in enumerate(joints.tolist())
    ]


def rim_velocities(drive: OmniKinematics | SphereKinematics, joints: Array) -> Array:
    """Return the rim velocities (k, 2) along the drive directions from above, m/s."""
    if isinstance(drive, SphereKinematics):
        directions = drive.actuations[:, :2]
    else:
        angles = drive.directions_rad
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return drive.wheel_radius_m * joints[:, None] * directions


def joint_share(drive: Kinematics[Any], joints: Array) -> float | None:
    """Return the fraction in use of the joint limit, sine of the tilt or speed; None if unknown."""
    if isinstance(drive, SingularityKinematics):
        return float(np.sin(drive.tilt(joints)).max() / math.sin(drive.max_tilt_rad))
    if isinstance(drive, OmniKinematics | SphereKinematics):
        return float(np.abs(joints).max() / drive.max_speed_rad_per_s)
    return None


def binding_limit(drive: Kinematics[Any], limiter: TwistLimiter, twist: Array) -> LimitName:
    """Return the limit nearest to `twist` (3,), or exceeded most by it."""
    speed, turn, joints = limiter.utilizations(twist)
    if joints >= max(speed, turn):
        tilts = any(joint.kind is JointKind.POSITION for joint in drive.joints)
        return "tilt" if tilts else "wheel_speed"
    return "speed" if speed >= turn else "turn_rate"


def _direction_deg(axle: Array, tilt_rad: float) -> float | None:
    if tilt_rad < _UPRIGHT_RAD:
        return None
    return round(math.degrees(math.atan2(axle[1], axle[0])), 1)


def _pair(vector: Array) -> tuple[float, float]:
    x, y = vector.tolist()
    return round(x, 4) + 0.0, round(y, 4) + 0.0


class ActuatorTelemetry(Protocol):
    """Telemetry of one kind of robot: fields of `RobotInfo` and `RobotState`, by name."""

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        ...

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot, /) -> dict[str, Any]:
        """Return the fields of `RobotState`, from joint vectors (n,)."""
        ...


MIN_SPEED_FRACTION = 0.01
"""A wheel below this fraction of its cruising speed is shown at rest."""
_ROUNDING = 1e-6


class GimbalTelemetry:
    """Telemetry of gimbals: measured and commanded angles, tilt and axle direction."""

    def __init__(self, robot: SingularityDescription) -> None:
        self._robot = robot
        self._drive = robot.kinematics()
        self._display = GimbalDisplay(self._drive)

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
                default_rpm=round(self._drive.spin_rad_per_s / RPM),
                wheel_radius_m=self._drive.wheel_radius_m,
                servo_step_deg=math.degrees(speeds.servo_step_rad),
            ),
        }

    def state(self, joints: Array, setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        radius_mm = 1000.0 * self._drive.effective_radius_m(joints)
        slow_rpm = MIN_SPEED_FRACTION * self._drive.spin_rad_per_s / RPM
        # Gimbal setpoints match the measured wheel speeds.
        commanded = commanded_joints(self._drive, setpoint, joints)
        modules = [
            GimbalState(
                **msgspec.structs.asdict(now),
                radius_mm=round(float(radius_mm[i]), 2),
                spinning=abs(float(joints[3 * i + 2]) / RPM) > slow_rpm,
                setpoint=msgspec.structs.replace(goal, rpm=round(float(setpoint[3 * i + 2]) / RPM)),
            )
            for i, (now, goal) in enumerate(
                zip(self._display.poses(joints), self._display.poses(commanded), strict=True)
            )
        ]
        return {"modules": modules}


class WheelTelemetry:
    """Telemetry of wheels: measured and commanded speed, and the consistency residual."""

    def __init__(self, robot: OmniDescription) -> None:
        self._drive = robot.kinematics()
        self._has_other_sensors = bool(robot.sensors)

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        alternative = "driven wheels" if self._has_other_sensors else None
        return _wheels_info(self._drive, "wheels", alternative)

    def state(self, joints: Array, setpoint: Array, snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        return {
            "wheels": wheel_states(self._drive, joints, setpoint),
            "estimate_difference": _planar_difference(snapshot),
        }


def _wheels_info(
    drive: OmniKinematics | SphereKinematics, panel: str, alternative: str | None
) -> dict[str, Any]:
    return {
        "panel": panel,
        "wheels": drive.actuators,
        "alternative_estimate": alternative,
    }


def wheel_states(
    drive: OmniKinematics | SphereKinematics, joints: Array, setpoint: Array
) -> list[WheelState]:
    """Return the states of all wheels, from the joint vectors (k,)."""
    residual = drive.forward(joints).residual
    poses = zip(wheel_poses(drive, joints), wheel_poses(drive, setpoint), strict=True)
    return [
        WheelState(
            **msgspec.structs.asdict(now),
            rpm_setpoint=goal.rpm,
            push_setpoint=goal.push,
            residual_mps=round(float(residual[i]), 4),
        )
        for i, (now, goal) in enumerate(poses)
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

    def __init__(self, robot: ExternalDescription) -> None:
        self._robot = robot

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        return {"panel": "twist", "not_promised": self._robot.not_promised}

    def state(self, _joints: Array, _setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return nothing: `RobotState` has the twists of all robots."""
        return {}


class JointTelemetry:
    """Telemetry of kinds without a separate panel: measured and commanded value of each joint."""

    def __init__(self, robot: RobotDescription) -> None:
        self._joints: tuple[Joint, ...] = robot.kinematics().joints
        self._scale = _units_per_si(self._joints)

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        rows = [JointInfo(each.name, "°" if _is_angle(each) else "rpm") for each in self._joints]
        return {"panel": "joints", "joints": rows}

    def state(self, joints: Array, setpoint: Array, _snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of `RobotState`."""
        rows = zip((joints * self._scale).tolist(), (setpoint * self._scale).tolist(), strict=True)
        return {"joints": [JointValue(round(now, 2), round(goal, 2)) for now, goal in rows]}


def joint_rows(drive: Kinematics[Any], joints: Array) -> dict[str, Any]:
    """Return the rows `joints` of a joint vector (n,), as fields of `JointPreview`."""
    values = (joints * _units_per_si(drive.joints)).tolist()
    return {"joints": [JointValue(round(value, 2)) for value in values]}


def _units_per_si(joints: tuple[Joint, ...]) -> Array:
    return np.array([180.0 / math.pi if _is_angle(joint) else 1.0 / RPM for joint in joints])


def _is_angle(joint: Joint) -> bool:
    return joint.kind is JointKind.POSITION


_MIN_RATE_RAD_PER_S = 0.02
"""Below this, directions of two angular velocities say nothing."""


class SphereTelemetry:
    """Telemetry of spheres: wheels, orientation, and angular velocity by both contact models."""

    def __init__(self, robot: SphereDescription) -> None:
        self._drive = robot.kinematics()
        self._dual_first = robot.estimate.model == "dual"

    def info(self) -> dict[str, Any]:
        """Return the fields of `RobotInfo`."""
        alternative = "ideal model" if self._dual_first else "dual-row model"
        return _wheels_info(self._drive, "sphere", alternative)

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
            ideal=rounded(ideal),
            dual=None if dual is None else rounded(dual.twist),
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


def rounded(values: Array) -> Triple:
    """Return three numbers with five decimals."""
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c
