"""Correction of the pose by readings of `[[sensors]]` with a measurement model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tsd_twin.estimation.consistency import is_plausible
from tsd_twin.estimation.pose_uncertainty import PoseErrors, TwistErrors
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.sensors import MountedSensor
from tsd_twin.sensors.base import Bias, SensorModel


class LinearReading(NamedTuple):
    """Reading, linear in the error of a pose: `offset` = `rows` @ error + biases + noise."""

    offset: Array
    """(c,): reading minus prediction, with all biases zero."""
    rows: Array
    """(c, 3)."""
    bias_jacobian: Array
    """(c, m): with respect to all biases of the estimate, in standard deviations."""
    covariance: Array
    """(c, c): covariance of the noise."""

    def is_plausible(self, errors: PoseErrors) -> bool:
        """Return whether the offset is within the gate, for a pose with these errors."""
        by = self.rows @ errors.bias_jacobian + self.bias_jacobian
        expected = self.rows @ errors.noise_cov @ self.rows.T + by @ by.T + self.covariance
        return is_plausible(self.offset, expected)


class _Entry(NamedTuple):
    model: SensorModel
    channels: tuple[int, int]
    """First and last index of its readings among those of a step, as of a slice."""
    is_angle: Array
    """(c,): whether a channel is an angle in rad, which is known up to whole turns."""
    biases: tuple[int, int]
    """First and last index of its biases among those of the estimate."""
    sigmas: Array


class SensorCorrection:
    """Sensors of a robot that correct its pose, and the biases that they add to an estimate.

    Their biases are appended to the `own` biases of the odometry.
    """

    def __init__(
        self, other_channels: int, sensors: Sequence[MountedSensor], own_biases: int
    ) -> None:
        """`sensors` follow `other_channels` in the readings of a step."""
        self._own = own_biases
        self._entries: list[_Entry] = []
        self._biases: list[Bias] = []
        channel, bias = other_channels, own_biases
        for sensor, table in sensors:
            joints = sensor.channels(table)
            channels = (channel, channel + len(joints))
            channel, biases, model = channels[1], sensor.biases(table), sensor.model(table)
            if model is None:
                continue
            sigmas = np.array([each.sigma for each in biases])
            columns = (bias, bias + len(biases))
            is_angle = np.array([j.kind is JointKind.POSITION and not j.unit for j in joints])
            self._entries.append(_Entry(model, channels, is_angle, columns, sigmas))
            self._biases += biases
            bias = columns[1]
        self.bias_count = bias
        """Number of all biases of the estimate."""
        self._padded: tuple[TwistErrors | None, TwistErrors | None] = (None, None)

    def __bool__(self) -> bool:
        """Whether there are sensors."""
        return bool(self._entries)

    def bias_rows(self, own: Mapping[str, Array]) -> dict[str, Array]:
        """Return the Jacobian row (m,) of each parameter w.r.t. all biases."""
        count = self.bias_count
        rows = {name: np.pad(row, (0, count - len(row))) for name, row in own.items()}
        sensors = zip(self._biases, np.eye(count)[self._own :], strict=True)
        return rows | {bias.name: bias.sigma * row for bias, row in sensors}

    def twist_errors(self, own: TwistErrors) -> TwistErrors:
        """Return twist errors with columns for all biases; the same object for the same errors."""
        if self._own == self.bias_count:
            return own
        if own is not self._padded[0]:
            self._padded = own, replace(own, bias_jacobian=self.padded(own.bias_jacobian))
        return self._padded[1] or own

    def padded(self, jacobian: Array) -> Array:
        """Return a Jacobian (..., own) with zero columns for the biases of the sensors."""
        extra = self.bias_count - self._own
        if not extra:
            return jacobian
        return np.pad(jacobian, [(0, 0)] * (jacobian.ndim - 1) + [(0, extra)])

    def own_errors(self, errors: PoseErrors) -> PoseErrors:
        """Return pose errors whose part from the sensors' biases is noise."""
        by = errors.bias_jacobian[:, self._own :]
        return PoseErrors(errors.bias_jacobian[:, : self._own], errors.noise_cov + by @ by.T)

    def has_reading(self, readings: Array) -> bool:
        """Return whether any sensor has all its readings (s,) of a step."""
        return any(_is_complete(entry, readings) for entry in self._entries)

    def readings(self, readings: Array, pose: SE2) -> list[LinearReading]:
        """Return the readings (s,) of a step, linearized at a pose; NaN has none."""
        return [
            linear
            for entry in self._entries
            if (linear := self._linear(entry, readings, pose)) is not None
        ]

    def _linear(self, entry: _Entry, readings: Array, pose: SE2) -> LinearReading | None:
        if not _is_complete(entry, readings):
            return None
        reading = readings[slice(*entry.channels)]
        expected = entry.model.predict(pose)
        if expected is None:
            return None
        by = np.zeros((len(reading), self.bias_count))
        by[:, slice(*entry.biases)] = expected.bias_jacobian * entry.sigmas
        offset = reading - expected.value
        offset = np.where(entry.is_angle, wrap(offset), offset)
        return LinearReading(offset, expected.pose_jacobian, by, expected.covariance)


def _is_complete(entry: _Entry, readings: Array) -> bool:
    first, end = entry.channels
    reading = readings[first:end]  # It may be omitted.
    return len(reading) == end - first and bool(np.isfinite(reading).all())
