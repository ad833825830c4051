"""Targets of all benchmarks: one row each, in the order of the report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """Limit of the ratio of a subject to its peer."""

    limit: float
    subject: str
    peer: str
    unit: str
    physics: str = ""
    """Reason for a peer that is a constant, independent of the machine's speed."""
    at_least: bool = False
    provisional: bool = True
    """Whether the limit still needs measurements on a quiet machine."""


_CPU = "ms CPU/s"

TARGETS: dict[str, Target] = {
    "kinematics.batch": Target(0.05, "a twist of a million", "wpimath", "us"),
    "kinematics.single": Target(6, "single call", "wpimath", "us"),
    "simulation.step": Target(20, "controller and plant", "plant alone", "us"),
    "simulation.drive": Target(11, "SimulatedRobot driving", "plant alone", "ms CPU/s"),
    "simulation.idle": Target(13, "SimulatedRobot idle", "plant alone", "ms CPU/s"),
    "simulation.batch": Target(2, "limits, plant and odometry", "plant alone", "us/robot"),
    "simulation.squares": Target(3.6, "open-loop square", "plant alone", "us/robot"),
    "simulation.growth": Target(1.01, "objects after a drive", "after its start", ""),
    "bus.put_p50": Target(1.3, "put to setpoint", "bare Zenoh loop", "ms"),
    "bus.put_p90": Target(1.3, "put to setpoint", "bare Zenoh loop", "ms"),
    "bus.client_p50": Target(1.3, "set_velocity to setpoint", "bare Zenoh loop", "ms"),
    "bus.client_p90": Target(1.3, "set_velocity to setpoint", "bare Zenoh loop", "ms"),
    "bus.stop_p50": Target(1.3, "stop to reply", "bare Zenoh query", "ms"),
    "bus.stop_p90": Target(1.3, "stop to reply", "bare Zenoh query", "ms"),
    "signatures.command": Target(
        1,
        "check of a signed command",
        "1 % of a core at 50 Hz",
        "us",
        "the share is the requirement",
    ),
    "router.delay_p50": Target(
        1, "set_velocity to setpoint, 20 robots", "direct link and 0.5 ms", "ms", provisional=False
    ),
    "router.delay_p99": Target(
        1, "set_velocity to setpoint, 20 robots", "direct link and 2 ms", "ms", provisional=False
    ),
    "router.cpu": Target(
        1, "router, 5 of 20 robots drive", "10 % of a core", _CPU, "the requirement"
    ),
    "router.memory": Target(1, "router", "allowed", "MB", "the requirement", provisional=False),
    "idle.node": Target(2.2, "idle node", "bare loop", _CPU),
    "idle.dashboard": Target(0.8, "dashboard without viewers", "bare subscriber", _CPU),
    "idle.fleet": Target(1, "20 idle robots", "40 % of a core", _CPU, "the requirement"),
    "foxglove.delay_p50": Target(1.3, "tsd-foxglove cmd_vel to setpoint", "bare forwarder", "ms"),
    "foxglove.delay_p90": Target(1.3, "tsd-foxglove cmd_vel to setpoint", "bare forwarder", "ms"),
    "foxglove.cpu": Target(7, "tsd-foxglove", "bare forwarder", _CPU),
    "ros.delay_p50": Target(1.3, "tsd-ros cmd_vel to setpoint", "bare forwarder", "ms"),
    "ros.delay_p90": Target(1.3, "tsd-ros cmd_vel to setpoint", "bare forwarder", "ms"),
    "ros.cpu": Target(7, "tsd-ros", "bare forwarder", _CPU),
    "firmware.simulator": Target(2.7, "driving board", "idle board", "ms CPU/s"),
    "firmware.interrupt": Target(
        1, "longest interrupt", "byte", "cycles", "1 Mbaud", provisional=False
    ),
    "firmware.wait": Target(1, "longest wait of a byte", "room", "cycles", "two bytes of buffer"),
    "firmware.stack": Target(1, "stack", "an eighth of what is free", "B", "memory of the board"),
    "bridge.cycle_p50": Target(1.3, "bridge cycle", "bare serial loop", "ms"),
    "bridge.cycle_p99": Target(1.5, "bridge cycle", "bare serial loop", "ms"),
    "bridge.cpu": Target(7, "bridge", "bare serial loop", _CPU),
    "dashboard.cpu_1": Target(3.3, "dashboard, 1 viewer", "plain viser", _CPU),
    "dashboard.cpu_20": Target(2.6, "dashboard, 20 viewers", "plain viser", _CPU),
    "dashboard.bytes": Target(3.2, "scene to each of 20", "plain viser", "kB/s"),
    "dashboard.delay_p50": Target(3.5, "pose to socket", "one viser node", "ms"),
    "dashboard.delay_p90": Target(3.5, "pose to socket", "one viser node", "ms"),
    "dashboard.fleet_cpu": Target(
        2.6, "dashboard, 20 robots and viewers", "plain viser at 60 Hz", _CPU
    ),
    "dashboard.fleet_bytes": Target(1, "scene to each of 20", "allowed", "kB/s", "the requirement"),
    "dashboard.fleet_delay": Target(
        1, "stick to setpoint, p99, 20 robots", "one robot and 5 ms", "ms", provisional=False
    ),
    "fleet.slow_arrived": Target(
        1, "commands, slow viewers", "required", "%", at_least=True, provisional=False
    ),
    "fleet.slow_p99": Target(
        1, "set_velocity to setpoint, slow viewers", "without and 3 ms", "ms", provisional=False
    ),
    "page.delay_p50": Target(1.6, "status to screen", "without the scene", "ms"),
    "page.delay_p90": Target(1.5, "status to screen", "without the scene", "ms"),
    "response.picture": Target(1, "portrait, mode and STOP", "allowed", "s", provisional=False),
    "response.command": Target(
        1, "stick to command, p99", "bare page and 8 ms", "ms", provisional=False
    ),
    "response.block": Target(1, "longest block while driving", "allowed", "ms", provisional=False),
    "pictures.age_p50": Target(3, "exposure to screen", "bare socket", "ms"),
    "pictures.age_p99": Target(3, "exposure to screen", "bare socket", "ms"),
    "pictures.command": Target(1, "command, p99", "without pictures and 5 ms", "ms"),
    "pictures.thin_rate": Target(
        1, "pictures", "required", "/s", "the requirement", at_least=True, provisional=False
    ),
    "pictures.thin_old": Target(
        1, "time older than 300 ms", "allowed", "%", "the requirement", provisional=False
    ),
    "pictures.thin_command": Target(1, "command, p99", "without pictures and 30 ms", "ms"),
    "camera.draw": Target(
        1, "three robots drawn", "20 % of a core at 30 Hz", "ms", "the requirement"
    ),
    "camera.find": Target(
        1, "three robots found", "35 % of a core at 30 Hz", "ms", "the requirement"
    ),
    "camera.poses": Target(2.5, "three robots found", "OpenCV's detector alone", "ms"),
    "plots.browser": Target(2.8, "browser, 8 plots of 10 min", "View tab", _CPU),
    "plots.dashboard": Target(1.3, "dashboard, 8 plots", "View tab", _CPU),
    "start.demo": Target(2, "tsd-demo ready", "imports", "s"),
    "recording.cpu": Target(1.7, "recorder", "bare subscriber", _CPU),
    "recording.size": Target(1.8, "file", "payloads as one zstd stream", "MB"),
    "recording.puts": Target(
        1, "puts on record", "counted by bare Zenoh", "", "none may be lost", at_least=True
    ),
    "recording.node": Target(1.1, "node beside a recorder", "alone", _CPU),
    "recording.dashboard": Target(1.1, "dashboard beside a recorder", "alone", _CPU),
    "recording.command": Target(1.2, "set_velocity beside a recorder", "alone", "ms"),
    "recording.lost": Target(2.5, "worst loss by kill -9", "flush period", "s", "period of 0.4 s"),
    "seek.open": Target(12, "recording opened", "mcap summary", "ms"),
    "seek.player_p50": Target(0.6, "seek", "mcap reads 0.4 s", "ms"),
    "seek.player_p90": Target(0.6, "seek", "mcap reads 0.4 s", "ms"),
    "seek.memory": Target(1.05, "player after more seeks", "before", "MB"),
    "seek.page_p50": Target(20, "seek to state in the page's socket", "player alone", "ms"),
    "seek.page_p90": Target(20, "seek to state in the page's socket", "player alone", "ms"),
    "seek.page_memory": Target(1.05, "dashboard after more seeks", "before", "MB"),
}
