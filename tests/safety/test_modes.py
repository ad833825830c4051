"""Mode transitions occur exactly under the conditions in the table."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.safety.supervisor_harness import SupervisorHarness, disarm, reset, stop
from tsd_twin.messages.codes import Code
from tsd_twin.messages.modes import ARMED, Mode
from tsd_twin.safety import TRANSITIONS


def disarm_and_come_to_rest(stage: SupervisorHarness) -> None:
    stage.send()
    disarm(stage)
    stage.wait(0.01, at_rest=True)


WAYS: dict[tuple[Mode, Mode], Callable[[SupervisorHarness], object]] = {
    (Mode.DISARMED, Mode.ARMING): lambda s: s.supervisor.arm(s.lease, s.now_s),
    (Mode.ARMING, Mode.READY): lambda s: s.hold(2.1),
    (Mode.ARMING, Mode.DISARMED): disarm,
    (Mode.READY, Mode.DRIVING): lambda s: s.send(0.5),
    (Mode.READY, Mode.DISARMED): disarm,
    (Mode.DRIVING, Mode.READY): lambda s: s.hold(0.1, at_rest=True),
    (Mode.DRIVING, Mode.STOPPING): lambda s: s.wait(0.25),
    (Mode.STOPPING, Mode.DRIVING): lambda s: s.send(0.5),
    (Mode.STOPPING, Mode.READY): lambda s: s.wait(0.01, at_rest=True),
    (Mode.STOPPING, Mode.DISARMED): disarm_and_come_to_rest,
    (Mode.STOPPED, Mode.DISARMED): reset,
    (Mode.FAULT, Mode.DISARMED): reset,
    **{(mode, Mode.STOPPED): stop for mode in set(Mode) - {Mode.STOPPED}},
    **{(mode, Mode.FAULT): lambda s: s.wait(0.01, fault="it broke") for mode in ARMED},
}


@pytest.mark.parametrize(
    ("way", "go"), WAYS.items(), ids=lambda v: "-".join(v) if isinstance(v, tuple) else ""
)
def test_every_way_of_the_table_can_be_gone(
    way: tuple[Mode, Mode], go: Callable[[SupervisorHarness], object], stage: SupervisorHarness
) -> None:
    stage.bring_to(way[0])
    stage.supervisor.take_events()
    go(stage)
    assert stage.mode is way[1]
    changes = [event for event in stage.supervisor.take_events() if event.kind == "mode"]
    assert changes[-1].rule == TRANSITIONS[way]
    assert changes[-1].why.code == Code.MODE_CHANGED
    assert changes[-1].why.params == {"before": way[0], "after": way[1]}


def test_the_table_names_these_ways_and_no_others() -> None:
    assert set(WAYS) == set(TRANSITIONS)
