"""Angle sensors: whole turns between reading and estimate are ignored."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.estimation.sensor_correction import SensorCorrection
from tsd_twin.kinematics import Joint, JointKind
from tsd_twin.lie import SE2
from tsd_twin.sensors.base import Bias, Prediction, SensorTable, SimulatedSensor


class Compass(SensorTable, frozen=True, kw_only=True, tag="compass"):
    """Compass that measures the heading in `odom`."""

    unit: str = ""


class CompassModel:
    """Measurement model of the compass."""

    def predict(self, pose: SE2) -> Prediction:
        heading = pose.xy_heading[2:]
        return Prediction(heading, np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 0)), np.eye(1))


class CompassSensor:
    """Sensor definition of the compass."""

    def channels(self, table: Compass) -> tuple[Joint, ...]:
        return (Joint(table.name, JointKind.POSITION, table.unit),)

    def biases(self, _table: Compass) -> tuple[Bias, ...]:
        return ()

    def simulate(self, *args: object) -> SimulatedSensor:
        raise NotImplementedError

    def model(self, _table: Compass) -> CompassModel:
        return CompassModel()


def offset(reading_rad: float, heading_rad: float, unit: str = "") -> float:
    table = Compass(name="compass", unit=unit)
    correction = SensorCorrection(0, [(CompassSensor(), table)], 0)
    pose = SE2(np.array([1.0, 2.0, heading_rad]))
    (linear,) = correction.readings(np.array([reading_rad]), pose)
    return float(linear.offset[0])


@given(error_rad=st.floats(-3.0, 3.0), heading_rad=st.floats(-50.0, 50.0), turns=st.integers(-9, 9))
def test_whole_turns_between_reading_and_heading_do_not_count(
    error_rad: float, heading_rad: float, turns: int
) -> None:
    reading_rad = heading_rad + error_rad + turns * 2.0 * np.pi
    assert offset(reading_rad, heading_rad) == pytest.approx(error_rad, abs=1e-9)


def test_a_channel_with_a_unit_is_no_angle() -> None:
    assert offset(7.0, 0.0, "m") == 7.0
