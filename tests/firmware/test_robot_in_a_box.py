"""The robot in a box ends at SIGINT and SIGTERM, also in a callback of the firmware."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.withheld import PATIENCE_S

ROOT = Path(__file__).parents[2]

PROGRAM = """
import os, sys
from firmware.simulator import __main__ as program
from firmware.simulator import board

as_callback, requests = board._Request, 0

def entered(call):
    def callback(*arguments):
        global requests
        requests += 1
        if requests == 50:
            os.kill(os.getpid(), int(sys.argv[1]))
        call(*arguments)
    return as_callback(callback)

entered.from_param = as_callback.from_param
board._Request = entered
sys.exit(program.main([]))
"""
"""The signal arrives as C calls Python, where nothing catches an exception."""


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_callback_ends_the_robot_in_a_box(number: signal.Signals) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(int(number))],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PATIENCE_S,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("ready: ")
