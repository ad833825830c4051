"""What a page is told about one robot."""

from __future__ import annotations

import numpy as np

from tsd_twin.dashboard.link import RobotLink, Snapshot
from tsd_twin.dashboard.protocol import Card, Limits, Module, State, Triple
from tsd_twin.dashboard.trips import RoundTrips
from tsd_twin.drives import JointKind
from tsd_twin.lie import Array
from tsd_twin.messages.ros import JointState
from tsd_twin.messages.status import Status
from tsd_twin.robots import RPM

LEVELS = (20, 50, 80, 100)
"""Speeds that can be chosen, in percent of the limits."""
SPINNING = 0.01
"""A wheel that turns with less than this share of its cruising speed is shown as at rest."""


class RobotView:
    """Description and state of a robot, in the numbers that are shown."""

    def __init__(self, link: RobotLink) -> None:
        self.link = link
        self._drive = link.drive
        self._order = [joint.name for joint in link.drive.joints]
        self._is_angle = np.array([j.kind is JointKind.POSITION for j in link.drive.joints])
        # From the module frame of the kinematics to the robot's: a turn by azimuth - pi/2.
        turn = link.drive.azimuths_rad - np.pi / 2
        c, s = np.cos(turn), np.sin(turn)
        self._base_from_module = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def card(self) -> Card:
        """Return what does not change."""
        robot = self.link.robot
        return Card(
            id=self.link.id,
            title=robot.title,
            limits=Limits(robot.limits.speed_mps, robot.limits.turn_rate_rad_per_s),
            levels=LEVELS,
            wheel_radius_mm=round(1000.0 * robot.drive.wheel_radius_m, 2),
            max_tilt_deg=robot.drive.max_tilt_deg,
            modules=self._drive.actuators,
        )

    def state(
        self,
        snapshot: Snapshot,
        status: Status,
        now_s: float,
        *,
        mode_age_s: float,
        trips: RoundTrips,
    ) -> State:
        """Return the newest of everything; null where the robot has not said it yet."""
        typical_s, jitter_s = trips.typical_s(), trips.jitter_s()
        joints = self._vector(snapshot.joints)
        setpoint = self._vector(snapshot.setpoint)
        odom, truth = snapshot.odom, snapshot.truth
        return State(
            seen=snapshot.status_seq,
            age_ms=round(1000.0 * (now_s - snapshot.received_s), 1),
            status=status,
            mode_age_s=round(mode_age_s, 1),
            you=False,
            robot_ms=_ms(typical_s),
            robot_jitter_ms=_ms(jitter_s),
            pose=_rounded(odom.xy_heading) if odom else None,
            twist=_rounded(odom.twist) if odom else None,
            commanded=None if setpoint is None else _rounded(self._drive.forward(setpoint).twist),
            truth=_rounded(truth.xy_heading) if truth else None,
            modules=[] if joints is None or setpoint is None else self._modules(joints, setpoint),
        )

    def _vector(self, state: JointState | None) -> Array | None:
        """Return a joint vector (n,), or None when it lacks one of our joints."""
        if state is None:
            return None
        place = {name: i for i, name in enumerate(state.names)}
        if not all(name in place for name in self._order):
            return None
        rows = [place[name] for name in self._order]
        joints = np.where(self._is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])
        return joints if np.isfinite(joints).all() else None

    def _axles(self, joints: Array) -> Array:
        """Return where the axles (k, 2) lean in `base_link`; length 1 is the tilt limit."""
        modules = joints.reshape(-1, 3)
        alpha, beta = modules[:, 0], modules[:, 1]
        axles = np.stack([np.cos(alpha) * np.sin(beta), np.sin(alpha)], axis=-1)
        lean = (self._base_from_module @ axles[..., None])[..., 0]
        return lean / np.sin(self._drive.max_tilt_rad)

    def _modules(self, joints: Array, setpoint: Array) -> list[Module]:
        measured, wanted = joints.reshape(-1, 3), setpoint.reshape(-1, 3)
        degrees, wanted_degrees = np.degrees(measured), np.degrees(wanted)
        tilt = np.degrees(self._drive.tilt(joints))
        radius_mm = 1000.0 * self._drive.effective_radius_m(joints)
        axles, wanted_axles = self._axles(joints), self._axles(setpoint)
        slow = SPINNING * self._drive.spin_rad_per_s
        return [
            Module(
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


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000.0 * seconds, 2)


def _rounded(values: Array) -> Triple:
    a, b, c = (round(float(value), 5) for value in values)
    return a, b, c
