"""Script with the client library: `python -m attack.script ENDPOINT ROBOT`, controlled by lines.

`ready AGE` takes control with a lease and arms, `push X` refreshes a velocity at 50 Hz, `release`
gives no further input. Each is answered with the time of the last input.
"""

from __future__ import annotations

import math
import sys
import threading
import time

import tsd_twin
from tsd_twin.errors import TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages.modes import LATCHED

PERIOD_S = 0.02


class Script:
    """Loop of a script that refreshes its velocity until it hangs."""

    def __init__(self, robot: tsd_twin.RobotClient) -> None:
        self._robot = robot
        self._turning = robot.description.kinematics().pose_type is SO3
        self._control: tsd_twin.RobotControl | None = None
        self._x: float | None = None
        self._lock = threading.Lock()
        self.given_s = -math.inf
        """Time of the last velocity."""
        threading.Thread(target=self._run, daemon=True).start()

    def act(self, word: str, *values: float) -> None:
        """Execute one line."""
        if word == "ready":
            self._get_ready(*values)
        with self._lock:
            self._x = values[0] if word == "push" else None

    def _get_ready(self, max_age_s: float) -> None:
        if self._control is not None:
            self._control.release()
        self._control = self._robot.control(
            "script", take_over=True, max_age_s=max_age_s, arm=False
        )
        self._control.acquire()
        if self._robot.state.mode in LATCHED:
            self._control.reset()
        self._control.arm()

    def _run(self) -> None:
        while True:
            time.sleep(PERIOD_S)
            with self._lock:
                if self._x is None or self._control is None:
                    continue
                try:
                    if self._turning:
                        self._control.set_turn_rate(wx_rad_per_s=self._x)
                    else:
                        self._control.set_velocity(vx_mps=self._x)
                    self.given_s = time.monotonic()
                except TwinError:
                    self._x = None


def main(endpoint: str, robot_id: str) -> None:
    """Serve lines until standard input ends."""
    with tsd_twin.connect(endpoint, robot=robot_id) as robot:
        script = Script(robot)
        print("ready: the script", flush=True)
        for line in sys.stdin:
            word, *values = line.split()
            try:
                script.act(word, *map(float, values))
                print(f"done {script.given_s:.6f}", flush=True)
            except TwinError as error:
                print(f"failed {error}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
