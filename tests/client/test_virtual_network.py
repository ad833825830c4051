"""A robot in virtual time behind a bad link: messages arrive late, and arming still works."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.client import procedures
from tsd_twin.client.protocol import COMMAND_PERIOD_S, ControlProtocol
from tsd_twin.client.virtual import PERIOD_S, SimulationLink
from tsd_twin.link_emulation import LinkSpec
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.modes import Mode
from tsd_twin.simulation import SimRobot

ROBOT = robots.load_robot("kiwi")
AGE_S = 1.0


def ready(network: LinkSpec) -> tuple[SimulationLink, ControlProtocol]:
    link = SimulationLink(ROBOT, SimRobot(ROBOT, seed=network.seed), None, network)
    protocol = ControlProtocol(ROBOT.name, ROBOT, "far")
    link.attach(protocol)
    link.run(procedures.acquire(protocol, max_age_s=AGE_S))
    link.run(procedures.arm(protocol, link.now_s()))
    return link, protocol


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("jitter_s", [0.0, 0.05, 0.15])
def test_arming_succeeds_however_late_statuses_are(jitter_s: float, seed: int) -> None:
    """Statuses sent before the reply to arming show a disarmed robot."""
    _, protocol = ready(LinkSpec(delay_s=0.1, jitter_s=jitter_s, loss=0.02, seed=seed))
    assert protocol.mode is Mode.READY


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.3])
def test_a_command_takes_effect_one_way_later_and_is_seen_after_both(delay_s: float) -> None:
    link, protocol = ready(LinkSpec(delay_s=delay_s))
    began_s = link.now_s()
    moved_s = seen_s = None
    while seen_s is None and link.now_s() < began_s + 2.0:
        command = protocol.set_velocity([0.3, 0.0, 0.0], BASE, link.now_s())
        if command is not None:
            link.send(command)
        link.sleep_until(link.now_s() + COMMAND_PERIOD_S)
        now_s = link.now_s()
        if moved_s is None and np.hypot(*link.simulated.truth(now_s).twist[:2]) > 0.01:
            moved_s = now_s - began_s
        if np.hypot(*protocol.pose(now_s).xy_heading[:2]) > 1e-4:
            seen_s = now_s - began_s
    assert moved_s is not None
    assert seen_s is not None
    assert delay_s < moved_s < delay_s + 0.15
    assert moved_s + delay_s - 3.0 * PERIOD_S < seen_s < 2.0 * delay_s + 0.3


def test_nothing_arrives_over_a_link_that_loses_everything() -> None:
    link = SimulationLink(ROBOT, SimRobot(ROBOT, seed=0), None, LinkSpec(loss=1.0))
    protocol = ControlProtocol(ROBOT.name, ROBOT, "far")
    link.attach(protocol)
    first = protocol.status_seq
    link.sleep_until(2.0)
    assert protocol.status_seq == first
