"""Electronic speed controllers: nothing reaches a motor before zero throttle has been held."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsd_twin.lie import Array

_ARMING_SHARE = 0.9
"""Share of the described hold that controllers take to arm: a description leaves them a margin."""


class SpeedControllers:
    """The arming of speed controllers from power-up on; arrays have `shape`, one entry a motor.

    The hold starts with the first command, before which there is no signal, and again with each
    signal that is not zero throttle. Once armed, a controller stays so.
    """

    def __init__(self, shape: tuple[int, ...], zero_throttle: float, hold_s: float) -> None:
        self._zero_throttle = zero_throttle
        self._hold_s = _ARMING_SHARE * hold_s
        self._holding = np.zeros(shape, dtype=bool)
        self._held_s = np.zeros(shape)
        self._was_armed = np.zeros(shape, dtype=bool)
        self.signal: Array = np.full(shape, zero_throttle)
        """Newest signal commanded."""

    @property
    def armed(self) -> npt.NDArray[np.bool_]:
        """Controllers that pass their signal on."""
        return self._was_armed | (self._holding & (self._held_s >= self._hold_s))

    def command(self, signal: Array) -> Array:
        """Take a new throttle signal; return the one that reaches the motors until the next."""
        self._was_armed = self.armed
        self.signal = signal
        self._holding = signal <= self._zero_throttle
        self._held_s *= self._holding
        return np.where(self._was_armed, signal, self._zero_throttle)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        self._held_s += dt_s * self._holding
