"""A child process forked while its parent controls a robot fails at once with an error."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.robot_node import RunningNode
from tests.support.withheld import PATIENCE_S

pytestmark = pytest.mark.system

SCRIPT = """
import os, sys, tsd_twin

with tsd_twin.connect(sys.argv[1]) as robot, robot.control("script") as base:
    base.set_velocity(vx_mps=0.1)
    child = os.fork()
    if child == 0:
        if sys.argv[2] == "uses":
            try:
                base.set_velocity(vx_mps=0.1)
            except tsd_twin.TwinError as error:
                print(error, flush=True)
        raise KeyError("it leaves")
    _, status = os.waitpid(child, 0)
    print("ended", status >> 8, flush=True)
    base.drive(vx_mps=0.1, duration_s=0.1)
"""


@pytest.mark.parametrize("way", ["uses", "leaves"])
def test_a_forked_child_raises_and_its_parent_drives_on(node: RunningNode, way: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT, node.endpoint, way],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *said, end = done.stdout.splitlines()
    assert end == "ended 1"
    sentence = "belongs to the parent of this process: connect again in the child"
    assert len(said) == (way == "uses")
    assert all(sentence in each for each in said)
    assert sentence in done.stderr
