"""The viser server, made so that nothing but the gateway of this machine can reach it."""

from __future__ import annotations

import rich
import viser

from tsd_twin.dashboard import (
    palette,
    viser_key,
    viser_pose,
    viser_queue,
    viser_replay,
    viser_values,
)
from tsd_twin.dashboard.viser_private import refuse_sharing

LOOPBACK = "127.0.0.1"
CAMERA_M = (-0.78, -0.58, 0.62)
"""Where the camera starts, seen from the robot: behind it on its right, so that it drives away."""
LOOK_AT_M = (0.0, 0.0, 0.03)
FIELD_OF_VIEW_RAD = 0.80
PANEL_PX = 288
"""The narrowest that all tabs fit into in one row."""


def start(title: str, *, dark: bool = True) -> viser.ViserServer:
    """Return a running server on a free port of the loopback; `get_port()` says which.

    viser has no authentication and no check of origins, so the port asks for `viser_key.key()`. A
    port that the system chooses is free, so viser does not go looking for another one.

    Raises:
        TwinError: another version of viser is installed than the one that this is made for.
    """
    viser_replay.refuse_other_versions()
    viser_queue.fill_from_any_thread()
    viser_pose.set_quickly()
    viser_values.take_strictly()
    # viser announces itself on standard output, where our programs print one line only.
    rich.get_console().quiet = True
    with viser_key.locked():
        server = viser.ViserServer(host=LOOPBACK, port=0, label=title, verbose=False)
    refuse_sharing(server)
    viser_replay.skip_what_is_gone(server)
    set_theme(server.gui, dark=dark)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_PX)
    server.scene.set_up_direction("+z")
    server.initial_camera.position = CAMERA_M
    server.initial_camera.look_at = LOOK_AT_M
    server.initial_camera.fov = FIELD_OF_VIEW_RAD
    return server


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Give all clients, or the one whose `gui` this is, dark or light colours."""
    gui.configure_theme(
        control_width="small",
        dark_mode=dark,
        show_logo=False,
        show_share_button=False,
        brand_color=palette.BRAND,
    )
