"""Client and simulated robot import only numpy, zenoh and msgspec."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.withheld import PATIENCE_S

pytestmark = pytest.mark.system

SCRIPT = """
import sys

ALLOWED = {"numpy", "zenoh", "msgspec", "tsd_twin", "tsd_mock", "typing_extensions"}


class Gate:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in ALLOWED and top not in sys.stdlib_module_names:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)


sys.meta_path.insert(0, Gate())
import tsd_mock
import tsd_twin

for kind in ("tsd", "omni4", "kiwi", "mecanum"):
    with tsd_twin.SimulatedRobot(kind, seed=0) as robot, robot.control() as base:
        base.drive(vx_mps=0.2, duration_s=0.5)
        base.go_to(x_m=0.3, y_m=0.2, heading_rad=1.0)
        print(kind, robot.state.mode)
        try:
            base.follow_path([(0.5, 0.5), (1.0, 0.0), (1.5, 0.5)])
        except tsd_twin.TwinError as error:
            print(error)
try:
    tsd_twin.open_recording("drive.mcap")
except tsd_twin.TwinError as error:
    print(error)
"""


def test_client_and_simulation_need_no_extra() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *drives, recording = done.stdout.splitlines()
    assert [line.split()[0] for line in drives[::2]] == ["tsd", "omni4", "kiwi", "mecanum"]
    assert all("needs the extra `paths`" in line for line in drives[1::2])
    assert "needs the extra `record`" in recording
