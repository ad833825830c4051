"""Process with simulated X servos behind a pty; commands on its standard input inject faults.

python -m tests.app.x_series_box --link PORT --ids 1,2,3 --model 1060
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import select
import sys
import threading
import time
import tty
from pathlib import Path
from typing import Any

from tests.support.x_series import XBus, XServo

_TICK_S = 0.001


class Box:
    """Servos on a pty whose time runs whether or not anybody talks to them."""

    def __init__(self, link: Path, bus: XBus) -> None:
        self._link, self._bus = link, bus
        self._lock = threading.Lock()
        self._away_until_s = 0.0
        self._since_s = self._off_s = 0.0
        self._angles: list[float] = []
        self._ends: tuple[int, int] | None = None
        self._plug_in()

    def _plug_in(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))
        self._ends = (master, slave)

    def run(self) -> None:
        """Serve until the process ends."""
        while True:
            self._serve()
            now_s = time.monotonic()
            with self._lock:
                self._bus.live(now_s)
                if self._since_s and not self._off_s and not self.driven:
                    self._off_s = now_s - self._since_s

    def _serve(self) -> None:
        if self._ends is None:
            time.sleep(_TICK_S)
            if time.monotonic() > self._away_until_s:
                self._plug_in()
            return
        master, _ = self._ends
        if select.select([master], [], [], _TICK_S)[0]:
            try:
                data = os.read(master, 4096)
            except OSError:
                return
            with self._lock:
                answer = self._bus.answer(data, time.monotonic())
            os.write(master, answer)

    @property
    def driven(self) -> bool:
        """Whether any motor turns by command."""
        return any(servo.driven for servo in self._bus.servos)

    def obey(self, line: str) -> None:
        """Carry out a command; each fault starts the clock until no wheel is driven."""
        what, *numbers = line.split()
        with self._lock:
            if what == "show":
                sys.stdout.write(json.dumps(self._seen()) + "\n")
                sys.stdout.flush()
                return
            self._since_s, self._off_s = time.monotonic(), 0.0
            self._angles = [servo.angle_rad for servo in self._bus.servos]
            self._harm(what, [float(number) for number in numbers])

    def _harm(self, what: str, numbers: list[float]) -> None:
        servos = self._bus.servos
        one = servos[int(numbers[0]) - 1] if numbers else servos[0]
        match what:
            case "hot":
                one.temperature_c = numbers[1]
            case "limp":
                one.write(64, b"\x00")
            case "restart":
                one.restart()
            case "dead":
                one.dead = True
            case "jam":
                one.jammed = True
            case "power_off":
                for servo in servos:
                    servo.set_power(False)
            case "unplug" | "reset_adapter":
                self._unplug(numbers[0] if numbers else 1.0, cuts_power=what == "reset_adapter")
            case "mend":
                self._mend()
            case _:
                assert what == "mark", what

    def _unplug(self, seconds: float, *, cuts_power: bool) -> None:
        if self._ends is not None:
            for end in self._ends:
                os.close(end)
            self._ends = None
            self._link.unlink(missing_ok=True)
        self._away_until_s = time.monotonic() + seconds
        if cuts_power:
            for servo in self._bus.servos:
                servo.restart()

    def _mend(self) -> None:
        for servo in self._bus.servos:
            servo.temperature_c, servo.dead, servo.jammed = 35.0, False, False
            if servo.memory[70] or not servo.powered:
                servo.restart()
            servo.powered = True

    def _seen(self) -> dict[str, Any]:
        servos = self._bus.servos
        began = self._angles or [servo.angle_rad for servo in servos]
        return {
            "driven": [servo.driven for servo in servos],
            "speeds": [servo.speed_rad_per_s for servo in servos],
            "goals": [servo.goal for servo in servos],
            "expired": [servo.expired for servo in servos],
            "off_s": round(self._off_s, 3),
            "turned_rad": [s.angle_rad - a for s, a in zip(servos, began, strict=True)],
            "reserved": len(self._bus.reserved),
        }


def main() -> None:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--link", type=Path, required=True)
    parser.add_argument("--ids", default="1,2,3")
    parser.add_argument("--model", type=int, default=1060)
    parser.add_argument("--volts", type=float, default=11.1)
    args = parser.parse_args()
    ids = [int(number) for number in args.ids.split(",")]
    bus = XBus([XServo(number, args.model, volts=args.volts) for number in ids])
    box = Box(args.link, bus)
    threading.Thread(target=box.run, daemon=True).start()
    sys.stdout.write(f"ready: {args.link}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        box.obey(line)


if __name__ == "__main__":
    main()
