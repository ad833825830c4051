"""Protocols of a sensor: table, simulation, measurement model, biases and telemetry channels.

Each module of this package defines a complete sensor in `SENSOR`; see `docs/add_a_sensor.md`.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from tsd_twin.kinematics import Joint
from tsd_twin.lie import SE2, Array
from tsd_twin.tables import Name, Table

TableT = TypeVar("TableT", bound=Table, contravariant=True)


class SensorTable(Table, frozen=True, kw_only=True, tag_field="kind"):
    """Entry of `[[sensors]]`; a sensor adds its keys and sets `tag` to its kind."""

    name: Name
    """Name of this sensor, unique on the robot."""


class Bias(NamedTuple):
    """Constant error of a sensor, drawn once per run; the filter estimates it."""

    name: str
    """Ends with the unit of `sigma`, or with `_share` for a relative error."""
    sigma: float
    """Standard deviation before any measurement."""


class BodyMotion(NamedTuple):
    """True motion of simulated robots during one step."""

    pose: SE2
    """Pose (..., 3) in the world, at the end of the step."""
    twist: Array
    """(..., 3): twist in the base frame, at the end of the step."""


class SimulatedSensor(Protocol):
    """Sensor of simulated robots."""

    def advance(self, motion: BodyMotion, dt_s: float) -> None:
        """Advance by `dt_s`, to the given motion at its end."""
        ...

    def read(self) -> Array:
        """Return the reading (..., c) of all channels; NaN where none is due."""
        ...


class Prediction(NamedTuple):
    """Expected reading of a sensor at an estimated pose, with all biases zero."""

    value: Array
    """(c,)."""
    pose_jacobian: Array
    """(c, 3): with respect to x, y and heading in `odom`."""
    bias_jacobian: Array
    """(c, b): with respect to the biases, in their units."""
    covariance: Array
    """(c, c): noise covariance of a reading."""


class SensorModel(Protocol):
    """Measurement model of a sensor."""

    def predict(self, pose: SE2) -> Prediction | None:
        """Return the expected reading at a `pose` (3,), or None where the sensor sees nothing."""
        ...


class Sensor(Protocol[TableT]):
    """All that the twin knows about a kind of sensor."""

    def channels(self, table: TableT) -> tuple[Joint, ...]:
        """Return name and unit of each value; they are sent, plotted and recorded."""
        ...

    def biases(self, table: TableT) -> tuple[Bias, ...]:
        """Return the constant errors."""
        ...

    def simulate(
        self, table: TableT, batch: tuple[int, ...], random: np.random.Generator, scale: float
    ) -> SimulatedSensor:
        """Return the sensor of `batch` simulated robots; `scale` multiplies its errors."""
        ...

    def model(self, table: TableT) -> SensorModel | None:
        """Return the measurement model that corrects the pose.

        None if an odometry of the robot uses the sensor instead.
        """
        ...


MountedSensor: TypeAlias = tuple[Sensor[Any], Table]
"""Sensor of a robot, and its table."""
