"""What one client wants to see."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from tsd_twin.dashboard.body import SLOWER
from tsd_twin.dashboard.client_view import Camera, ClientView, Truth
from tsd_twin.dashboard.layers import Layer
from tsd_twin.dashboard.viser_server import set_theme

_HINTS = {
    Layer.SETPOINT: "Cyan rings: where the gimbals are told to be",
    Layer.TRAIL: "Blue line: where the robot believes it was, the last 40 m",
    Layer.ROUTE: "Violet line: the path that is planned, for everybody to see",
    Layer.OTHER: "Rose cage: where the robot is by its other estimate, of robots that have two",
    Layer.ARROWS: "Yellow: direction and speed that each wheel gives the robot, or the ball on it",
    Layer.ELLIPSE: "Blue ellipse: where the robot is with 86 % certainty, two sigma",
    Layer.PREDICTED: "Pink cage: where the robot will be when a command sent now arrives",
    Layer.ENVELOPE: "Red area: where the robot can still get to if the link dies now",
    Layer.LABELS: "Metres on the axes of the floor, and names when there are several robots",
}


class ViewTab:
    """Switches for everything that can be hidden, the camera, and the colours."""

    def __init__(
        self,
        gui: viser.GuiApi,
        view: ClientView,
        clear_trails: Callable[[], None],
        *,
        dark: bool,
    ) -> None:
        self._gui = gui
        self._view = view
        self._clear_trails = clear_trails
        self._toggle("follow", view.follow, "The robot keeps its place in the picture")
        camera = gui.add_button_group(
            "camera", [str(side) for side in Camera], hint="Turn the camera to the robot"
        )
        for layer, hint in _HINTS.items():
            self._toggle(layer, lambda on, layer=layer: view.show(layer, on), hint)
        truth = gui.add_dropdown(
            "true pose",
            [str(choice) for choice in Truth],
            hint="Green cage: where a simulated robot really is",
        )
        clear = gui.add_button("Clear trail", hint="Forget where the robots were, for everybody")
        self._toggle("dark", lambda on: set_theme(gui, dark=on), "Dark colours", initial=dark)
        gui.add_markdown(f"Wheels on gimbals are drawn turning {SLOWER} times slower than they do.")
        camera.on_click(self._looked)
        truth.on_update(self._truth_chosen)
        clear.on_click(self._cleared)

    def _toggle(
        self, label: str, act: Callable[[bool], None], hint: str, *, initial: bool = True
    ) -> None:
        async def toggled(event: viser.GuiEvent[Any]) -> None:
            act(bool(event.target.value))

        self._gui.add_checkbox(label, initial, hint=hint).on_update(toggled)

    async def _looked(self, event: viser.GuiEvent[Any]) -> None:
        if event.target.value in list(Camera):  # A client may send anything.
            self._view.look(Camera(event.target.value))

    async def _truth_chosen(self, event: viser.GuiEvent[Any]) -> None:
        if event.target.value in list(Truth):
            self._view.show_truth(Truth(event.target.value))

    async def _cleared(self, _event: viser.GuiEvent[Any]) -> None:
        self._clear_trails()
