"""Each unsafe condition stops and refuses every source by the same rule, on the robot.

Node, bridge, firmware and all sources are real, in virtual time.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware.simulator.board import build_native
from tests.laws.command_sources import CommandSource, ReplayedDrive
from tests.laws.source_table import (
    BOARD,
    CONDITIONS,
    DEVIATIONS,
    SOURCES,
    STALE,
    Condition,
    Rule,
    Source,
    rules_of,
    tilt,
)
from tests.support.virtual_robot import ZERO_US, VirtualRobot
from tests.support.virtual_time import VirtualClock
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Refusal, Trip

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")
PAIRS = [(source, condition) for source in SOURCES for condition in CONDITIONS]


@pytest.fixture(scope="module")
def native() -> Path:
    return build_native()


@pytest.fixture
def patch() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as it:
        yield it


@pytest.mark.parametrize(
    ("source", "condition"), PAIRS, ids=[f"{s.name}-{c.name}" for s, c in PAIRS]
)
def test_every_source_is_stopped_and_refused_by_the_rule_of_the_condition(
    source: Source,
    condition: Condition,
    native: Path,
    patch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    dice = random.Random(f"{source.name} {condition.name}")  # noqa: S311
    clock = VirtualClock(patch)
    robot = VirtualRobot(clock, native, patch, bus_servos=source.made.bus_servos)
    try:
        clock.wait(2.2)  # The board holds zero throttle.
        made = source.made(robot)
        if isinstance(made, ReplayedDrive):
            made.path = tmp_path / "drive.mcap"
            clock.run(_replayed(robot, made, condition, dice))
        else:
            clock.run(_driven(robot, source, made, condition, dice))
    finally:
        robot.close()


async def _driven(
    robot: VirtualRobot,
    source: Source,
    made: CommandSource,
    condition: Condition,
    dice: random.Random,
) -> None:
    rules = rules_of(source, condition)
    deviation = DEVIATIONS.get((source.name, condition.name))
    await made.open()
    assert not await made.get_ready(), "nothing is wrong yet"
    await made.hold(dice.uniform(0.6, 1.0), dice.choice((0.5, -0.5)))
    assert tilt(robot) > 14, made.said
    await condition.strike(robot, made, dice)
    if rules is not None:
        _assert_stopped(robot, rules[0])
        await _try_again(robot, made, condition, rules[1])
    if deviation is not None:
        assert deviation.fact(robot, made), deviation.reason
    await made.close()


def _assert_stopped(robot: VirtualRobot, rule: Rule) -> None:
    if rule is STALE:
        assert robot.supervisor.mode == "ready"
        assert tilt(robot) == 0
        return
    assert robot.wheels_off
    if rule.place == BOARD:
        assert Trip(robot.telemetry.trip).name == rule.code
    else:
        assert rule.words in robot.supervisor.reason


async def _try_again(
    robot: VirtualRobot, made: CommandSource, condition: Condition, rule: Rule
) -> None:
    """Try to drive again by all means of an operator; the robot must not move."""
    robot.watch()
    if rule is STALE:
        await _push_old_inputs(robot, made)
        return
    await asyncio.sleep(2.2)  # Sticks are centred, and zero throttle is required.
    refusal = await made.get_ready(reset=condition.may_reset)
    assert refusal
    await made.hold(0.5, 0.5)
    assert robot.widest_us <= ZERO_US, "it moved"
    if rule.place != BOARD:
        assert rule.words in f"{refusal} {robot.supervisor.reason}"
    elif robot.telemetry.refusal != Refusal[rule.code]:
        assert robot.refusal_past_the_node().name == rule.code


async def _push_old_inputs(robot: VirtualRobot, made: CommandSource) -> None:
    """Send inputs that are too old, each by a different time."""
    limit_s = robot.robot.limits.max_command_age_s
    for age_s in (limit_s + 0.06, limit_s + 0.2, 0.6, 0.9):
        for _ in range(10):
            made.push(0.5, age_s)
            await asyncio.sleep(0.02)
            assert tilt(robot) == 0, f"an input that is {age_s:.2f} s old moved it"


async def _replayed(
    robot: VirtualRobot, made: ReplayedDrive, condition: Condition, dice: random.Random
) -> None:
    """Play a recording while a healthy robot, then a faulty one, is on the bus."""
    await made.open()
    robot.watch()
    assert "this is a recording" in await made.get_ready()
    await condition.strike(robot, made, dice)
    await made.hold(2.5, 0.0)
    assert robot.telemetry.mode == BoardMode.DISARMED
    assert robot.widest_us <= ZERO_US
    assert DEVIATIONS["replay", condition.name].fact(robot, made)
    await made.close()
