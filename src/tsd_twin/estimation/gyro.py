"""What a yaw gyro knows better than wheels."""

from __future__ import annotations

from tsd_twin.lie import Array


def with_gyro(
    twist: Array, covariance: Array, turn_rate: Array, sigma_rad_per_s: float
) -> tuple[Array, Array]:
    """Return planar twists (..., 3) and covariances, corrected by a yaw gyro's `turn_rate` (...).

    The gyro takes part by its share of certainty; what the wheels had wrong in the same way, as a
    slow wheel that both turns and shifts the robot, is corrected with it.
    """
    column = covariance[..., :, 2]
    gain = column / (column[..., 2:] + sigma_rad_per_s**2)
    off = turn_rate - twist[..., 2]
    return twist + gain * off[..., None], covariance - gain[..., :, None] * column[..., None, :]
