"""Motion prediction for display: pose at command arrival, and the path until standstill without
commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.client.connection import RoundTrips, SentCommand, Snapshot
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.ros import ODOM
from tsd_twin.messages.status import Status
from tsd_twin.motion.prediction import PendingCommand, Predictor
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import Mode

MIN_DELAY_S = 0.05
"""A delay shorter than this is not worth a ghost."""
TIMEOUT_MARGIN_S = 0.03
"""Commands come in every 20 ms and are looked at every 10 ms."""
_COARSE_STEP_S = 0.02
_SENDER_TIMEOUT_S = 0.5
"""Time without commands, plus a round trip, after which the operator does not drive."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Prediction in the frame of the robot at its newest state."""

    arrival_pose: Array | None
    """(3,): where it will be when a command that is sent now arrives; None when that is now."""
    path: Array | None
    """(n, 3): path to rest without further messages; None at rest."""


NO_PREDICTION = Prediction(None, None)


class MotionPredictor:
    """Motion predictor: forward simulation of one planar robot."""

    def __init__(self, kinematics: Kinematics[SE2], robot: RobotDescription) -> None:
        self._kinematics = kinematics
        self._limits = robot.limits
        self._fine = Predictor(kinematics, robot.limits, robot.lag_s)
        self._coarse = Predictor(kinematics, robot.limits, robot.lag_s, _COARSE_STEP_S)

    def predict(
        self, snapshot: Snapshot, setpoint: Array, sent: Sequence[SentCommand], trips: RoundTrips
    ) -> Prediction:
        """Prediction for a robot with joint set-points `setpoint` (n,)."""
        status, odom = snapshot.status, snapshot.odom
        if status is None or odom is None or status.mode not in (Mode.DRIVING, Mode.STOPPING):
            return NO_PREDICTION
        twist = self._kinematics.forward(setpoint).twist
        heading = float(odom.xy_heading[2])
        share = status.limits.speed_mps / self._limits.speed_mps
        if not share > 0.0:
            return NO_PREDICTION  # Anyone may put a status on a bus without access rules.
        trip_s = trips.median_s()
        arrival_pose = None
        if trip_s is not None and trip_s >= MIN_DELAY_S and status.mode == Mode.DRIVING:
            commands = _commands_in_flight(sent, snapshot.received_s, trip_s, heading)
            if commands:
                here = SE2.identity()
                arrival_pose = self._fine.after(trip_s, here, twist, commands, share).xy_heading
        path = self._path(status, twist, sent, snapshot.received_s, trips.p95_s(), heading)
        return Prediction(arrival_pose, path)

    def _path(
        self,
        status: Status,
        twist: Array,
        sent: Sequence[SentCommand],
        now_s: float,
        late_s: float | None,
        heading: float,
    ) -> Array:
        # A command moves the robot until this long after the status was sent that it echoes. From
        # here that is a status received by now; another dashboard may get one this much later.
        max_age_s = status.limits.max_command_age_s
        silence_s = 2.0 * max_age_s
        commands: list[PendingCommand] = []
        if late_s is not None and (own := _commands_in_flight(sent, now_s, late_s, heading)):
            commands = [due for due in own if due.after_s <= min(late_s, max_age_s)]
            timeout_s = self._limits.command_timeout_s + max_age_s - self._limits.max_command_age_s
            silence_s = min(late_s + timeout_s, max_age_s)
        silence_s += TIMEOUT_MARGIN_S
        if status.mode == Mode.STOPPING:
            commands, silence_s = [], 0.0
        share = status.limits.speed_mps / self._limits.speed_mps
        poses = self._coarse.until_rest(
            SE2.identity(), twist, [*commands, PendingCommand(silence_s, np.zeros(3))], share
        )
        return np.array([pose.xy_heading for pose in poses])


def _commands_in_flight(
    sent: Sequence[SentCommand], now_s: float, trip_s: float, heading: float
) -> list[PendingCommand]:
    """Commands that a state received now does not include, or has just included.

    A command that is sent now arrives a round trip after the state that has come in now was sent:
    no clocks have to agree for that.
    """
    recent = [one for one in sent if one.sent_s > now_s - trip_s - _SENDER_TIMEOUT_S]
    from_world = _WorldToBody(heading)
    return [
        PendingCommand(
            one.sent_s - now_s + trip_s, one.twist, from_world if one.frame == ODOM else None
        )
        for one in recent
    ]


@dataclass(frozen=True, slots=True)
class _WorldToBody:
    """Rotation of twists from `odom` to `base_link`; poses begin at `heading_rad`."""

    heading_rad: float

    def __call__(self, pose: SE2, twist: Array) -> Array:
        turn = SE2(np.array([0.0, 0.0, self.heading_rad + float(pose.xy_heading[2])]))
        return np.append(turn.inverse().rotate(twist[:2]), twist[2])
