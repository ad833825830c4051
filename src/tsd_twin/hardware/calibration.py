"""How the servos of one machine are mounted: what its description cannot know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from tsd_twin.hardware.errors import HardwareError

CENTRE = 2048


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML file; joints that it does not name are mounted as drawn."""

    neutral_step: dict[str, Annotated[int, Meta(ge=0, le=4095)]] = {}
    """Position that a servo reports with its gimbal upright; 2048 unless given."""
    reversed: Sequence[str] = ()
    """Joints whose servo turns the other way."""

    @staticmethod
    def read(file: str) -> Calibration:
        """Return the calibration in a file.

        Raises:
            HardwareError: it cannot be read, or is none.
        """
        try:
            return msgspec.toml.decode(Path(file).read_bytes(), type=Calibration)
        except (OSError, msgspec.MsgspecError) as error:
            raise HardwareError(f"{file} cannot be used as a calibration: {error}") from error

    def check(self, names: Sequence[str]) -> None:
        """See that it speaks of joints that there are.

        Raises:
            HardwareError: it names another.
        """
        for name in (*self.neutral_step, *self.reversed):
            if name not in names:
                raise HardwareError(
                    f"the calibration names a gimbal '{name}': there are {', '.join(names)}"
                )

    def neutral(self, names: Sequence[str]) -> list[int]:
        """Return the neutral step of each joint."""
        return [self.neutral_step.get(name, CENTRE) for name in names]

    def signs(self, names: Sequence[str]) -> list[int]:
        """Return +1 for each joint whose servo turns as drawn, -1 for each other."""
        return [-1 if name in self.reversed else 1 for name in names]
