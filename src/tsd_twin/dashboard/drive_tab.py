"""The sliders that feed the inverse kinematics."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Any, TypeAlias

import numpy as np
import viser

from tsd_twin.dashboard.body import Body
from tsd_twin.dashboard.client_view import ClientView
from tsd_twin.dashboard.components import FLOOR, components, ends
from tsd_twin.lie import Array
from tsd_twin.motion import TwistLimiter

_STEPS = 50
"""Steps of a slider from zero to its end."""


class Mode(StrEnum):
    """What the sliders are for; the values are the words of the panel."""

    PREVIEW = "preview"
    DRIVE = "drive"


OnMoved: TypeAlias = Callable[[float, float, float, Mode, bool], None]
"""Called with the three numbers of the twist, the mode and whether it is latched."""


class DriveTab:
    """Sliders for the twist, what they are for, and the choice of a robot.

    Callbacks are coroutines that never wait: viser runs others in any order.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        view: ClientView,
        on_moved: OnMoved,
        on_robot: Callable[[str], None],
    ) -> None:
        self._view = view
        self._on_moved = on_moved
        self._on_robot = on_robot
        self._robot: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "robot", [""], hint="The robot to look at and to drive"
        )
        self._sliders = [
            gui.add_slider(
                one.label,
                -1.0,
                1.0,
                1.0 / _STEPS,
                0.0,
                hint=one.hint,
            )
            for one in FLOOR
        ]
        self._mode: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "mode",
            [str(mode) for mode in Mode],
            hint="preview shows in your picture what the joints would do; drive commands the robot",
        )
        self._latch = gui.add_checkbox(
            "latch",
            initial_value=False,
            hint="In mode drive: keep driving after you let go of a slider",
        )
        zero = gui.add_button("Zero", hint="All sliders back to zero")
        for slider in self._sliders:
            slider.on_update(self._slid)
        self._latch.on_update(self._slid)
        self._mode.on_update(self._zeroed)
        zero.on_click(self._zeroed)
        self._robot.on_update(self._chosen)
        self.refresh()

    def refresh(self) -> None:
        """Take in which robots there are, and which one this client looks at."""
        body, ids = self._view.body, self._view.robot_ids
        self._robot.visible = len(ids) > 1
        for slider in self._sliders:
            slider.disabled = body is None
        if body is None:
            return
        self._robot.options = ids
        self._robot.value = body.id
        drive = body.link.drive
        for slider, component, end in zip(
            self._sliders,
            components(drive),
            ends(drive, body.link.robot.limits),
            strict=True,
        ):
            slider.label = component.label
            slider.hint = component.hint
            slider.min, slider.max, slider.step = -end, end, end / _STEPS

    def reset(self) -> None:
        """Let the sliders spring back, and show the joints as they are."""
        for slider in self._sliders:
            slider.value = 0.0
        self._view.try_out(None)

    async def _slid(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # Otherwise it was moved by us.
            self._tell()

    async def _zeroed(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            self.reset()  # So nothing starts to move by a change of mode.
            self._tell()

    async def _chosen(self, event: viser.GuiEvent[Any]) -> None:
        robot_id = self._robot.value
        if event.client is not None and robot_id in self._view.robot_ids:
            with self._view.lock:  # Another thread may bring the choice of the rest of the page.
                self.reset()
                self._view.choose(robot_id)
                self.refresh()
            self._on_robot(robot_id)

    def _tell(self) -> None:
        body = self._view.body
        if body is None:
            return
        twist = self._twist(body)
        mode = Mode.DRIVE if self._mode.value == Mode.DRIVE else Mode.PREVIEW
        tries = mode is Mode.PREVIEW and bool(twist.any())
        self._view.try_out(body.drive.inverse(twist) if tries else None)
        first, second, third = (float(number) for number in twist)
        self._on_moved(first, second, third, mode, bool(self._latch.value))

    def _twist(self, body: Body) -> Array:
        """Return what the sliders say (3,), within the limits; a client may send any number."""
        numbers = [float(slider.value) for slider in self._sliders]
        twist = np.array([number if math.isfinite(number) else 0.0 for number in numbers])
        return TwistLimiter(body.drive, body.link.robot.limits).cap(twist)
