"""A dashboard in plain viser: sliders drive the robot of `tsd-demo`, and its meshes follow it."""

import sys
from collections.abc import Callable

import numpy as np
import viser

import tsd_twin
from tsd_twin.models import LinkGroup, glb, kinematic_tree, load_parts


class Dashboard:
    """Sliders, buttons and meshes of a robot."""

    def __init__(self, server: viser.ViserServer, robot: tsd_twin.RobotClient) -> None:
        self.server, self.robot, self.problem = server, robot, ""
        self.base = base = robot.control("own-dashboard", arm=False)
        self.kinematics, limits = robot.description.kinematics(), robot.description.limits
        self.text = server.gui.add_markdown("")
        ends = {"Forward (m/s)": limits.speed_mps, "Left (m/s)": limits.speed_mps}
        ends["Turn left (rad/s)"] = limits.turn_rate_rad_per_s
        self.sliders = [server.gui.add_slider(k, -v, v, 0.01, 0.0) for k, v in ends.items()]
        calls = {"STOP": robot.stop, "Reset": robot.reset, "Take control": base.acquire}
        for label, call in {**calls, "Arm": base.arm, "Release": base.release}.items():
            button = server.gui.add_button(label)
            button.on_click(lambda _, call=call: self.attempt(call))
        self.frames: dict[str, tuple[viser.FrameHandle, LinkGroup, int]] = {}
        self.add_meshes()

    def add_meshes(self) -> None:
        """Add a frame with the generated mesh for each link, below the frame of its parent."""
        scene, robot = self.server.scene, self.robot.description
        parts, tree = load_parts(robot), kinematic_tree(robot)
        self.body, self.height_m = scene.add_frame("/robot", show_axes=False), tree.height_m
        scene.add_glb("/robot/mesh", glb(parts["chassis"]))
        paths: dict[str, list[str]] = {}
        for group in tree.link_groups:
            above = paths.get(group.parent, ["/robot"] * group.count)
            paths[group.kind] = [f"{a}/{b}" for a, b in zip(above, group.names, strict=True)]
            for i, path in enumerate(paths[group.kind]):
                wxyz, at_m = group.turn.wxyz[i], group.at_m[i]
                frame = scene.add_frame(path, show_axes=False, wxyz=wxyz, position=at_m)
                scene.add_glb(f"{path}/mesh", glb(parts[group.kind]))
                self.frames[group.joints[i]] = frame, group, i

    def attempt(self, call: Callable[[], None]) -> None:
        """Call the robot, and show its reason if it refuses."""
        try:
            self.problem = ""
            call()
        except tsd_twin.ClientError as error:
            self.problem = str(error)

    def update(self) -> None:
        """Drive by the sliders while a browser is open, and show robot and joints."""
        state, (x, y, turn) = self.robot.state, (float(each.value) for each in self.sliders)
        ready = self.base.is_held and state.mode in ("ready", "driving")
        if ready and self.server.get_clients() and any((x, y, turn)):
            self.attempt(lambda: self.base.set_velocity(vx_mps=x, vy_mps=y, omega_rad_per_s=turn))
        elif state.mode != "disarmed" or not self.server.get_clients():
            for slider in self.sliders:  # Arming, a reset or a new page starts no motion.
                slider.value = 0.0
        joints = np.round(self.kinematics.inverse(np.array([x, y, turn])), 3).tolist()
        self.text.content = f"**{state.mode}** {self.problem}\n\nInverse kinematics: {joints}"
        self.body.position = (*state.odom.pose[:2], self.height_m)
        self.body.wxyz = state.odom.orientation
        for name, angle in zip(state.joints.names, state.joints.position_rad, strict=True):
            if name in self.frames and np.isfinite(angle):
                frame, group, i = self.frames[name]
                zero = tsd_twin.SO3(group.turn.wxyz[i])
                frame.wxyz = (zero @ tsd_twin.SO3.exp(angle * group.axes[i])).wxyz


with tsd_twin.connect(*sys.argv[1:]) as robot:
    dashboard = Dashboard(viser.ViserServer("127.0.0.1", verbose=False), robot)
    print(f"open http://localhost:{dashboard.server.get_port()}", flush=True)
    while True:
        dashboard.update()
        robot.sleep(0.02)
