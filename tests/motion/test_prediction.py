"""Predictions against the motion of a simulated robot, over a link with delay."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.controller_harness import PERIOD_S, ROBOT, ControllerHarness, HarnessOperator
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.prediction import PendingCommand, Predictor
from tsd_twin.simulation import SimRobot

LAG_S = 1.0 / ROBOT.servo.approach_rate_per_s
DRIVE = ROBOT.kinematics()


class FarPilot:
    """A robot behind a link that delays states and commands, in virtual time."""

    def __init__(self, delay_s: float, **lease: float) -> None:
        self.rig = ControllerHarness(SimRobot(ROBOT))
        self.pilot: HarnessOperator = self.rig.get_ready(**lease)
        self._late = round(delay_s / PERIOD_S)
        """Delay of each direction, in periods."""
        self._up: deque[Array | None] = deque([None] * self._late)
        self.states: deque[tuple[float, Array, Array]] = deque(maxlen=self._late + 1)
        self.sent: list[tuple[float, Array]] = []
        self.truths: list[Array] = []

    def tick(self, twist: Array | None) -> None:
        """Run one period, with or without a command."""
        self._up.append(twist)
        if twist is not None:
            self.sent.append((self.rig.now_s, twist))
        arrived = self._up.popleft()
        if arrived is not None:
            self.rig.send(self.pilot, arrived.tolist())
        self.rig.tick()
        self.states.append((self.rig.now_s, self.rig.pose, self.rig.twist))
        self.truths.append(self.rig.truth())

    def seen(self) -> tuple[SE2, Array, list[PendingCommand]]:
        """Return the pilot's knowledge: an old state, and the commands sent."""
        state_s, pose, twist = self.states[0]
        late_s = self._late * PERIOD_S
        commands = [
            PendingCommand(sent_s + late_s - state_s, told) for sent_s, told in self.sent[-60:]
        ]
        return SE2(pose), twist, commands


def wild(now_s: float) -> Array:
    """Full speed, with turns to both sides."""
    return np.array([0.8, 0.5 * math.sin(2.0 * now_s), 2.0 * math.sin(3.0 * now_s)])


@pytest.mark.parametrize(("round_trip_s", "times_better"), [(0.06, 3.0), (0.15, 5.0), (0.3, 5.0)])
def test_the_prediction_is_much_nearer_than_what_is_seen(
    round_trip_s: float, times_better: float
) -> None:
    """Error of the robot's pose when a command sent now arrives, at 1 m/s with turns."""
    far = FarPilot(round_trip_s / 2, max_age_s=0.25)
    predictor = Predictor(DRIVE, ROBOT.limits, LAG_S)
    ahead = round(round_trip_s / PERIOD_S)
    predicted: dict[int, tuple[Array, Array]] = {}
    for step in range(400):
        far.tick(wild(far.rig.now_s))
        if step > 60:
            pose, twist, commands = far.seen()
            ghost = predictor.after(round_trip_s, pose, twist, commands).xy_heading
            predicted[len(far.truths) - 1 + ahead // 2] = (ghost, pose.xy_heading)
    errors, unpredicted = [], []
    for at, (ghost, seen) in predicted.items():
        if at < len(far.truths):
            errors.append(math.dist(ghost[:2], far.truths[at][:2]))
            unpredicted.append(math.dist(seen[:2], far.truths[at][:2]))
    assert len(errors) > 200
    assert np.mean(unpredicted) > 0.5 * round_trip_s, "it has moved meanwhile"
    assert np.mean(errors) * times_better < np.mean(unpredicted)
    assert max(errors) < 0.5 * max(unpredicted)


@given(
    twist=st.tuples(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(-3.0, 3.0)),
    ahead=st.integers(0, 100),
)
def test_without_news_the_robot_goes_on_along_its_twist(
    twist: tuple[float, float, float], ahead: int
) -> None:
    start = SE2(np.array([0.3, -0.2, 1.0]))
    ahead_s = ahead * 0.01
    predicted = Predictor(DRIVE, ROBOT.limits).after(ahead_s, start, np.array(twist), [])
    exact = start @ SE2.exp(np.array(twist) * ahead_s)
    np.testing.assert_allclose(predicted.xy_heading, exact.xy_heading, atol=1e-9)


def test_a_command_counts_from_when_it_arrives_and_within_the_limits() -> None:
    start, still = SE2.identity(), np.zeros(3)
    forward = PendingCommand(0.1, np.array([1e9, 0.0, 0.0]))
    predictor = Predictor(DRIVE, ROBOT.limits)
    assert not predictor.after(0.1, start, still, [forward]).xy_heading.any()
    # 0.25 s to 1 m/s at 4 m/s^2, then constant speed.
    x, y, heading = predictor.after(1.1, start, still, [forward]).xy_heading
    assert x == pytest.approx(0.125 + 0.75, abs=0.01)
    assert (y, heading) == (0.0, 0.0)
    x, _, _ = predictor.after(1.1, start, still, [forward], share=0.5).xy_heading
    assert x < 0.5


def test_the_way_to_rest_is_that_of_braking() -> None:
    stop = PendingCommand(0.2, np.zeros(3))
    path = Predictor(DRIVE, ROBOT.limits).until_rest(
        SE2.identity(), np.array([1.0, 0.0, 0.0]), [stop]
    )
    assert path[-1].xy_heading[0] == pytest.approx(0.2 + 1.0 / 12.0, abs=0.011)
    at_rest = Predictor(DRIVE, ROBOT.limits).until_rest(SE2.identity(), np.zeros(3), [])
    assert not any(pose.xy_heading.any() for pose in at_rest)
