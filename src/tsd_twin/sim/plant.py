"""The kinematic plant: rolling without slip, integrated to fourth order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.lie import SE2, Array

_SLOPES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])
"""Slopes at the start, middle and end of the parabola through three values there, times dt."""
_SIMPSON = np.array([[1.0, 4.0, 1.0]]) / 6.0


@dataclass(frozen=True, slots=True, eq=False)
class KinematicPlant:
    """A robot whose wheels roll as its drive says, and do nothing else."""

    drive: Drive[SE2]

    def tangent(self, joints: Array, dt_s: float) -> Array:
        """Return the tangent (..., 3) of the motion over a step of `dt_s` seconds.

        `joints` (3, ..., n) are the true joint vectors at its start, middle and end. Rates of the
        gimbals come from the parabola through them, so that Simpson's rule adds up to the angle
        turned through, exactly and over any number of steps.

        The twist changes during the step and turns do not commute with translations: the second
        term of the Magnus expansion keeps fourth order. Source: Iserles and Norsett, "On the
        solution of linear differential equations in Lie groups" (1999), with the sign for twists
        in the body frame.
        """
        by_node = joints.reshape(3, -1)
        rates = ((_SLOPES / dt_s) @ by_node).reshape(joints.shape)
        twists = self.drive.forward(joints, rates).twist
        tangent = ((dt_s * _SIMPSON) @ twists.reshape(3, -1)).reshape(twists.shape[1:])
        start, end = twists[0], twists[2]
        twelfth = dt_s * dt_s / 12.0
        tangent[..., 0] += twelfth * (end[..., 2] * start[..., 1] - start[..., 2] * end[..., 1])
        tangent[..., 1] += twelfth * (start[..., 2] * end[..., 0] - end[..., 2] * start[..., 0])
        return tangent

    def move(self, pose: SE2, joints: Array, dt_s: float) -> SE2:
        """Return the pose after a step of `dt_s` seconds; `joints` as in `tangent`."""
        return pose @ SE2.exp(self.tangent(joints, dt_s))
