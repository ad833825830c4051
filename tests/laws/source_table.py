"""Table of all command sources and all conditions that make a robot unsafe: which rule stops the
robot, and which one refuses it, is a property of the condition.

Where a source differs, the pair has a reason, and a fact that shows it.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tests.laws import command_sources as sources
from tests.laws.command_sources import CommandSource
from tests.support.virtual_robot import VirtualRobot
from tsd_twin.hardware.dynamixel.control_table import BoardMode
from tsd_twin.messages import topics
from tsd_twin.messages.events import duplicate_id_text

Strike = Callable[[VirtualRobot, CommandSource, random.Random], Awaitable[None]]

BOARD, NODE, REPLAY = "board", "node", "replay"


@dataclass(frozen=True)
class Rule:
    """One rule of a robot."""

    code: str
    """Name of a `Trip` or `Refusal` of the board, or of the rule of the node."""
    place: str = BOARD
    """Where it is enforced."""
    words: str = ""
    """Part of the sentence of a rule that has no code on the wire."""


FOLLOWING, NOT_NEUTRAL = Rule("FOLLOWING"), Rule("NOT_NEUTRAL")
SERVO, DRIVE = Rule("SERVO"), Rule("DRIVE")
RC_LOST, RECEIVER = Rule("RC_LOST"), Rule("RECEIVER")
STOPPED = Rule("STOPPED")
LATCHED = Rule("latched stop", NODE, "software stop by alice")
STALE = Rule("stale", NODE)
ONE_ID = Rule("one robot for each id", NODE, duplicate_id_text(VirtualRobot.id))
NODE_FOLLOWING = Rule("following error", NODE, "does not follow")
NODE_SERVO = Rule("silent servo", NODE, "no answer")
RECORDING = Rule("recording", REPLAY, "this is a recording")


@dataclass(frozen=True)
class Source:
    """One kind of command source."""

    name: str
    made: type[CommandSource]
    modules: tuple[str, ...]
    """Modules that send commands for it; a board's source has names of its `BoardMode`."""


SOURCES = (
    Source("page", sources.PageSource, ("tsd_twin.dashboard.sessions.teleop",)),
    Source(
        "client",
        sources.ScriptSource,
        tuple(
            f"tsd_twin.client.{name}"
            for name in (
                "base_control",
                "motions",
                "procedures",
                "sync",
                "virtual",
                "virtual_robot",
            )
        ),
    ),
    Source("Foxglove", sources.FoxglovePanel, ("tsd_twin.adapters.foxglove.live",)),
    Source("ROS", sources.RosPublisher, ("tsd_twin.adapters.ros.operator",)),
    Source("replay", sources.ReplayedDrive, ("tsd_twin.recording.player",)),
    Source("radio", sources.RadioControl, ("BoardMode.RC",)),
    Source("U2D2", sources.ServosAtComputer, ("tsd_twin.hardware.u2d2",)),
)


async def stick_gimbal(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """Jam one of the tilted gimbals, and centre the stick."""
    tilted = [i for i, goal in enumerate(robot.goals) if abs(goal) > 14]
    robot.servos[dice.choice(tilted or range(6))].jammed = True
    await source.hold(1.4, 0.0)


async def silence_servo(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """Let one servo answer no more."""
    dice.choice(robot.servos).dead = True
    await source.hold(0.2, dice.choice((0.5, -0.5)))


async def open_circuit(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """Open the stop circuit."""
    robot.firmware.set_contactor(closed=False)
    await source.hold(0.1, dice.choice((0.5, -0.5)))


async def hold_back(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """End the input, and cut the link somewhat later; then deliver all that waited in it."""
    limit_s = robot.robot.limits.max_command_age_s
    cut_s = dice.uniform(0.0, 0.2)
    if not source.on_bus:
        source.push(0.5, age_s=1.0)
        await asyncio.sleep(limit_s + 0.3)
        return
    await asyncio.sleep(cut_s)
    robot.network.is_held = lambda key: "/cmd/" in key
    await asyncio.sleep(limit_s + robot.late_s - cut_s)
    assert not robot.obeys, "an input counts longer than a command may be old"
    await asyncio.sleep(dice.uniform(0.2, 0.6))
    robot.network.release()
    await asyncio.sleep(0.1)


async def double_id(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """Let another node with the same id appear, as where two networks are joined."""
    token = topics.instance_key(robot.id, f"{dice.getrandbits(64):016x}")
    source.open_bus().declare_token(token)
    await source.hold(0.1, dice.choice((0.5, -0.5)))


async def press_stop(robot: VirtualRobot, source: CommandSource, dice: random.Random) -> None:
    """Press STOP elsewhere."""
    stop = source.open_bus().publisher(topics.STOP.key(robot.id))
    stop.put(b'{"operator": "alice"}')
    await source.hold(0.1, dice.choice((0.5, -0.5)))


@dataclass(frozen=True)
class Condition:
    """A condition that makes a robot unsafe."""

    name: str
    strike: Strike
    stopped_by: Rule
    refused_by: Rule
    may_reset: bool = True
    """Whether the next attempt begins with a reset."""
    arms_again: bool = True
    """Whether the robot is shut off, so that the next attempt begins with arming."""


CONDITIONS = (
    Condition("stuck gimbal", stick_gimbal, FOLLOWING, NOT_NEUTRAL),
    Condition("silent servo", silence_servo, SERVO, SERVO),
    Condition("open stop circuit", open_circuit, DRIVE, DRIVE),
    Condition("stale input", hold_back, STALE, STALE, arms_again=False),
    Condition("duplicate id", double_id, ONE_ID, ONE_ID),
    Condition("latched", press_stop, LATCHED, LATCHED, may_reset=False),
)


@dataclass(frozen=True)
class Deviation:
    """A pair whose rules are others, or none, with the reason and a fact that shows it."""

    rules: tuple[Rule, Rule] | None
    reason: str
    fact: Callable[[VirtualRobot, CommandSource], bool]


def _no_servo_at_board(robot: VirtualRobot, _source: CommandSource) -> bool:
    return robot.setup.servos_expected == 0


def _past_the_bus(robot: VirtualRobot, _source: CommandSource) -> bool:
    return robot.telemetry.mode != BoardMode.ARMED and robot.supervisor.gate.accepted == 0


def _still_obeys_its_radio(robot: VirtualRobot, source: CommandSource) -> bool:
    return _past_the_bus(robot, source) and robot.telemetry.mode == BoardMode.RC


def _sends_no_command(robot: VirtualRobot, source: CommandSource) -> bool:
    assert isinstance(source, sources.ReplayedDrive)
    return source.commands > 0 and robot.supervisor.gate.accepted == source.counted


_AT_COMPUTER = "The board has no servos; the same rule is at the computer, which has them."
DEVIATIONS: Mapping[tuple[str, str], Deviation] = {
    ("radio", "stale input"): Deviation(
        (RC_LOST, RECEIVER),
        "Its pulses reach the board without a bus: an input that is old is one that is missing.",
        _past_the_bus,
    ),
    ("radio", "duplicate id"): Deviation(
        None,
        "Its receiver is wired to one board: no other robot hears it, whatever its id.",
        _still_obeys_its_radio,
    ),
    ("radio", "latched"): Deviation(
        (STOPPED, STOPPED),
        "The board keeps the STOP of the node for the source that bypasses the node.",
        _past_the_bus,
    ),
    ("U2D2", "stuck gimbal"): Deviation(
        (NODE_FOLLOWING, NODE_FOLLOWING), _AT_COMPUTER, _no_servo_at_board
    ),
    ("U2D2", "silent servo"): Deviation((NODE_SERVO, NODE_SERVO), _AT_COMPUTER, _no_servo_at_board),
    **{
        ("replay", condition.name): Deviation(
            (RECORDING, RECORDING),
            "A replay sends states only, and refuses every request.",
            _sends_no_command,
        )
        for condition in CONDITIONS
    },
}


def rules_of(source: Source, condition: Condition) -> tuple[Rule, Rule] | None:
    """Rules that stop and refuse a pair; None where the condition cannot concern the source."""
    deviation = DEVIATIONS.get((source.name, condition.name))
    if deviation is not None:
        return deviation.rules
    return condition.stopped_by, condition.refused_by


def tilt(robot: VirtualRobot) -> float:
    """Return the largest goal of a gimbal, steps."""
    return float(np.abs(robot.goals).max())


NO_SOURCES: Mapping[str, str] = {
    "tsd_twin.bus.session": "the bus itself, which knows no robots",
    "tsd_twin.calibration.bus_drive": "a script with the client library",
    "tsd_twin.calibration.turning": "a script with the client library",
    "tsd_twin.camera.publisher": "publishes pictures, and poses as a sensor",
    "tsd_twin.client.connection": "carries the commands of pages, scripts, Foxglove and ROS",
    "tsd_twin.client.protocol": "numbers and stamps the commands of all sources on the bus",
    "tsd_twin.hardware.arduino_mega": "the bridge, behind the rules of the node",
    "tsd_twin.hardware.board_cycle": "as arduino_mega: the exchange with the board",
    "tsd_twin.hardware.can_wheels": "as arduino_mega, for wheels on CAN",
    "tsd_twin.hardware.dynamixel_wheels": "as arduino_mega, for wheels that are servos",
    "tsd_twin.hardware.wheel_bus": "the line of dynamixel_wheels",
    "tsd_twin.adapters.cmd_vel_bridge": "behind Foxglove and ROS",
    "tsd_twin.lab.wear_drives": "a script with the client library",
    "tsd_twin.lab.remote": "drives only its own simulation, through the protocol of the client",
    "tsd_twin.node.robot_node": "the robot: it publishes states",
    "tsd_twin.node.input_log": "publishes the inputs of the controller",
    "tsd_twin.recording.recorder": "publishes notes of a person",
    "tsd_twin.adapters.ros.dds_port": "publishes in ROS: states, and what drives a robot of others",
    "tsd_twin.adapters.ros.zenoh_port": "as the other port",
    "tsd_mock": "publishes poses of a simulated camera",
}
"""Modules that can send commands but are not separate sources, with the reason."""


def documented() -> str:
    """Return the table of the safety page in Markdown."""
    head = "| Condition | " + " | ".join(source.name for source in SOURCES) + " |"
    lines = [head, "| --- " * (1 + len(SOURCES)) + "|"]
    for condition in CONDITIONS:
        cells = [_cell(rules_of(source, condition)) for source in SOURCES]
        lines.append(f"| {condition.name} | " + " | ".join(cells) + " |")
    reasons: dict[str, list[str]] = {}
    for (source, name), deviation in DEVIATIONS.items():
        reasons.setdefault(f"{source}|{deviation.reason}", []).append(name)
    notes = [
        f"- **{key.split('|')[0]}, {', '.join(names)}**: {key.split('|')[1]}"
        if len(names) < len(CONDITIONS)
        else f"- **{key.split('|')[0]}**: {key.split('|')[1]}"
        for key, names in reasons.items()
    ]
    return "\n".join([*lines, "", *notes])


def _cell(rules: tuple[Rule, Rule] | None) -> str:
    if rules is None:
        return "not concerned"
    codes = dict.fromkeys(rule.code for rule in rules)
    return ", ".join(f"`{code}`" if code.isupper() else code for code in codes)
