"""Panel of a client: tabs Drive, actuators, View, Plots, Health and Student."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Any, TypeAlias

import msgspec
import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.client_view import ClientView
from tsd_twin.dashboard.scene.robot_geometry import FLOOR_AXES, axis_limits, twist_axes_of
from tsd_twin.dashboard.scene.robot_visual import SPIN_SLOWDOWN, RobotVisual
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.student_robot import StudentPose
from tsd_twin.dashboard.scene.viser_compat import rename_tab, set_theme
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.dashboard.wire.view import (
    CameraPreset,
    Layer,
    TiltFactor,
    TruePoseDisplay,
    ViewSettings,
)
from tsd_twin.lie import Array
from tsd_twin.motion import TwistLimiter

_SLIDER_STEPS = 50
"""Slider steps from zero to the end."""


class SliderMode(StrEnum):
    """Mode of the sliders; the values are the labels in the panel."""

    PREVIEW = "preview"
    DRIVE = "drive"


OnSlidersMoved: TypeAlias = Callable[[float, float, float, SliderMode, bool], None]
"""Called with the twist components, the mode and whether it is latched."""


class DriveTab:
    """Drive tab: twist sliders, their mode, and the robot menu.

    Callbacks are coroutines that never wait, because viser runs others in arbitrary order.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        view: ClientView,
        on_moved: OnSlidersMoved,
        on_robot: Callable[[str], None],
    ) -> None:
        self._view = view
        self._on_moved = on_moved
        self._on_robot = on_robot
        self._robot: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "Robot", [""], hint="Robot to watch and to drive"
        )
        self._sliders = [
            gui.add_slider(
                one.label,
                -1.0,
                1.0,
                1.0 / _SLIDER_STEPS,
                0.0,
                hint=one.hint,
            )
            for one in FLOOR_AXES
        ]
        self._mode: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "Mode",
            [str(mode) for mode in SliderMode],
            hint="preview: only your picture moves; drive: the robot moves",
        )
        self._latch = gui.add_checkbox(
            "Keep value",
            initial_value=False,
            hint="In mode drive the robot drives on when you let go of a slider. Enter ticks it.",
        )
        zero = gui.add_button("Zero", hint="Set all sliders to zero")
        for slider in self._sliders:
            slider.on_update(self._on_slider)
        self._latch.on_update(self._on_slider)
        self._mode.on_update(self._on_zero)
        zero.on_click(self._on_zero)
        self._robot.on_update(self._on_robot_selected)
        self.update_controls()

    def update_controls(self) -> None:
        """Update the robot menu and the selected robot."""
        body, ids = self._view.visual, self._view.robot_ids
        self._robot.visible = len(ids) > 1
        for slider in self._sliders:
            slider.disabled = body is None
        if body is None:
            return
        self._robot.options = ids
        self._robot.value = body.id
        drive = body.link.kinematics
        for slider, component, end in zip(
            self._sliders,
            twist_axes_of(drive),
            axis_limits(drive, body.link.robot.limits),
            strict=True,
        ):
            slider.label = component.label
            slider.hint = component.hint
            slider.min, slider.max, slider.step = -end, end, end / _SLIDER_STEPS

    def reset_sliders(self) -> None:
        """Centre the sliders and end the preview."""
        for slider in self._sliders:
            slider.value = 0.0
        self._view.set_preview(None)

    async def _on_slider(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # Otherwise the program moved it.
            self._report()

    async def _on_zero(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            self.reset_sliders()  # A change of mode must not start a motion.
            self._report()

    async def _on_robot_selected(self, event: viser.GuiEvent[Any]) -> None:
        robot_id = self._robot.value
        if event.client is not None and robot_id in self._view.robot_ids:
            with self._view.lock:  # Another thread may deliver the selection of the page.
                self.reset_sliders()
                self._view.select_robot(robot_id)
                self.update_controls()
            self._on_robot(robot_id)

    def _report(self) -> None:
        body = self._view.visual
        if body is None:
            return
        twist = self._twist(body)
        mode = SliderMode.DRIVE if self._mode.value == SliderMode.DRIVE else SliderMode.PREVIEW
        tries = mode is SliderMode.PREVIEW and bool(twist.any())
        self._view.set_preview(body.kinematics.inverse(twist) if tries else None)
        first, second, third = (float(number) for number in twist)
        self._on_moved(first, second, third, mode, bool(self._latch.value))

    def _twist(self, body: RobotVisual) -> Array:
        """Return the sliders' twist (3,), clipped to the limits; clients may send any number."""
        numbers = [float(slider.value) for slider in self._sliders]
        twist = np.array([number if math.isfinite(number) else 0.0 for number in numbers])
        return TwistLimiter(body.kinematics, body.link.robot.limits).cap(twist)


_LAYER_HINTS = {
    Layer.SETPOINT: "Cyan rings: where the gimbals should be",
    Layer.TRAIL: "Blue line: estimated path of the last 40 m",
    Layer.ROUTE: "Violet line: planned path, in all pages",
    Layer.OTHER: "Rose cage: the other estimate, of robots that have two",
    Layer.ARROWS: "Orange arrows: push of each wheel",
    Layer.REGION: "Blue outline and wedge: position and heading are inside, 86 % certain each",
    Layer.PREDICTED: "Pink cage: where the robot will be when a command sent now arrives",
    Layer.ENVELOPE: "Red area: how far the robot can still get if the link fails now",
    Layer.LABELS: "Metres on the floor, and names of several robots",
}


OnViewChanged: TypeAlias = Callable[[ViewSettings], None]
"""Called with the settings changed in the panel."""


class ViewTab:
    """View tab: layer switches, camera, and colours."""

    def __init__(
        self,
        gui: viser.GuiApi,
        view: ClientView,
        clear_trails: Callable[[], None],
        on_changed: OnViewChanged,
        *,
        dark: bool,
    ) -> None:
        self._gui = gui
        self._view = view
        self._clear_trails = clear_trails
        self._on_changed = on_changed
        gui.add_html('<div data-tsd="presets"></div>')
        self._follow = self._toggle(
            "follow", "The camera moves with the robot", lambda on: {"follow": on}
        )
        camera = gui.add_button_group(
            "camera",
            [str(side) for side in CameraPreset],
            hint="Turn the camera to the robot: keys 1, 2 and 3. Chase turns along with it",
        )
        self._layers = {
            layer: self._toggle(layer, hint, lambda on, layer=layer: self._with_layer(layer, on=on))
            for layer, hint in _LAYER_HINTS.items()
        }
        self._true_pose: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "true pose",
            [str(choice) for choice in TruePoseDisplay],
            hint="Green cage: where a simulated robot really is",
        )
        self._tilt: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "tilt drawn",
            [str(factor) for factor in TiltFactor],
            hint="Gimbals in your picture lean this much more than they do; a label says so",
        )
        clear = gui.add_button("Clear trail", hint="Delete the trails of all robots, in all pages")
        self._dark = self._toggle("dark", "Dark colours", lambda on: {"dark": on}, initial=dark)
        gui.add_markdown(
            f"Wheels on gimbals are drawn {SPIN_SLOWDOWN} times slower than they turn."
        )
        camera.on_click(self._on_camera)
        self._true_pose.on_update(self._on_true_pose)
        self._tilt.on_update(self._on_tilt)
        clear.on_click(self._on_clear)

    def show(self, settings: ViewSettings) -> None:
        """Show the active settings."""
        self._follow.value = settings.follow
        for layer, box in self._layers.items():
            box.value = layer not in settings.hidden
        self._true_pose.value = str(settings.true_pose)
        self._tilt.value = str(settings.tilt)
        if settings.dark is not None:
            self._dark.value = settings.dark
            set_theme(self._gui, dark=settings.dark)

    def update_controls(self) -> None:
        """Show controls supported by the selected robot; only gimbals tilt."""
        body = self._view.visual
        self._tilt.visible = body is None or body.meshes.shape.tilts

    def _toggle(
        self,
        label: str,
        hint: str,
        changes: Callable[[bool], dict[str, Any]],
        *,
        initial: bool = True,
    ) -> viser.GuiCheckboxHandle:
        async def toggled(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # Otherwise the program set it.
                self._change(**changes(bool(event.target.value)))

        box = self._gui.add_checkbox(label, initial, hint=hint)
        box.on_update(toggled)
        return box

    def _with_layer(self, layer: Layer, *, on: bool) -> dict[str, Any]:
        hidden = {*self._view.settings.hidden} - {layer}
        return {"hidden": sorted(hidden if on else hidden | {layer})}

    def _change(self, *, look: bool = False, **changes: Any) -> None:
        with self._view.lock:  # Another thread may deliver the settings of the page.
            settings = msgspec.structs.replace(self._view.settings, **changes)
            self._view.apply(settings, look=look)
        if "dark" in changes:
            set_theme(self._gui, dark=changes["dark"])
        self._on_changed(settings)

    async def _on_camera(self, event: viser.GuiEvent[Any]) -> None:
        if event.target.value in list(CameraPreset):  # Clients may send any value.
            self._change(camera=CameraPreset(event.target.value), look=True)

    async def _on_true_pose(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None and event.target.value in list(TruePoseDisplay):
            self._change(true_pose=TruePoseDisplay(event.target.value))

    async def _on_tilt(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None and event.target.value in list(TiltFactor):
            self._change(tilt=TiltFactor(event.target.value))

    async def _on_clear(self, _event: viser.GuiEvent[Any]) -> None:
        self._clear_trails()


_ACTUATOR_TAB = "Gimbals"
"""Label of the actuator tab if no robot is selected."""


class Panel:
    """Panel of a client: tabs Drive, actuators, View, Plots, Health and Student.

    The actuators tab, Plots, Health, Student, the end of Drive and both ends of View are empty
    elements marked `data-tsd`. The page fills them from its own socket, so that data is not sent
    twice.
    """

    def __init__(
        self,
        scene: Scene,
        client: viser.ClientHandle,
        on_moved: OnSlidersMoved,
        on_robot: Callable[[str], None],
        on_view: OnViewChanged,
        *,
        dark: bool,
        watches: bool = False,
        plain: bool = False,
    ) -> None:
        """`watches`: omit controls for viewers. `plain`: the client has no graphics card."""
        self.client = client
        self._view = ClientView(scene, client, plain=plain)
        self._on_robot = on_robot
        gui = client.gui
        tabs = gui.add_tab_group()
        self._drive_tab: DriveTab | None = None
        self._view_tab: ViewTab | None = None
        if not watches:
            with tabs.add_tab("Drive"):
                self._drive_tab = DriveTab(gui, self._view, on_moved, self._chosen)
                gui.add_html('<div data-tsd="wheel_speed"></div>')
                gui.add_html('<div data-tsd="route"></div>')
        self._actuator_tab = tabs.add_tab(_ACTUATOR_TAB)
        with self._actuator_tab:
            gui.add_html('<div data-tsd="joints"></div>')
        if not watches:
            with tabs.add_tab("View"):
                self._view_tab = ViewTab(gui, self._view, scene.clear_trails, on_view, dark=dark)
                gui.add_html('<div data-tsd="page"></div>')
        with tabs.add_tab("Plots"):
            gui.add_html('<div data-tsd="plots"></div>')
        with tabs.add_tab("Health"):
            gui.add_html('<div data-tsd="health"></div>')
        with tabs.add_tab("Student"):
            gui.add_html('<div data-tsd="student"></div>')
        self._update_tabs()

    @property
    def robot_id(self) -> str | None:
        """Selected robot."""
        return self._view.robot_id

    def pick_sphere(self, origin: Array, direction: Array) -> tuple[float, float, float] | None:
        """Return the point of the robot's sphere hit by a ray (3,), (3,)."""
        return self._view.pick_sphere(origin, direction)

    def pick_floor(self, shares: Array) -> Array:
        """Return floor points (m, 2) in `odom` at screen positions, see `floor_points`."""
        return self._view.pick_floor(shares)

    def show_past(self, past: Snapshot | None, ago_s: float) -> None:
        """Draw the robot's state of `ago_s` ago next to the live one; None hides it."""
        self._view.show_past(past, ago_s)

    def preview(self, robot_id: str, joints: Array | None) -> None:
        """Preview a joint vector (n,) of the selected robot; None ends the preview."""
        self._view.preview(robot_id, joints)

    def show_student(self, pose: StudentPose | None) -> None:
        """Draw a robot in place of the selected one; None ends that."""
        self._view.show_student(pose)

    def set_view(self, settings: ViewSettings, *, look: bool) -> None:
        """Apply the view settings of the page; `look` points the camera at the robot."""
        self._view.apply(settings, look=look)
        if self._view_tab is not None:
            self._view_tab.show(settings)

    def on_robots_moved(self) -> None:
        """Update the view after the robot has moved."""
        self._view.on_robots_moved()

    def on_robots_changed(self) -> None:
        """Update after robots were added or removed."""
        self._view.on_robots_changed()
        self._update_tabs()
        if self._drive_tab is not None:
            self._drive_tab.update_controls()

    def _chosen(self, robot_id: str) -> None:
        self._update_tabs()
        self._on_robot(robot_id)

    def _update_tabs(self) -> None:
        body = self._view.visual
        rename_tab(
            self._actuator_tab,
            _ACTUATOR_TAB if body is None else view_of(body.link.robot).label,
        )
        if self._view_tab is not None:
            self._view_tab.update_controls()

    def reset_sliders(self) -> None:
        """Centre the sliders."""
        if self._drive_tab is not None:
            self._drive_tab.reset_sliders()

    def select_robot(self, robot_id: str) -> None:
        """Select the robot that was selected elsewhere on the page."""
        with self._view.lock:  # Another thread may deliver the selection in the panel.
            before = self._view.robot_id
            self._view.select_robot(robot_id)
            if self._view.robot_id != before:
                self.reset_sliders()
                self._update_tabs()
                if self._drive_tab is not None:
                    self._drive_tab.update_controls()
