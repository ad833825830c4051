# SPDX-License-Identifier: GPL-3.0-or-later
"""Robot in a box: the compiled firmware, simulated in real time behind a pseudo-terminal.

Start it, then start the bridge with the printed path. Commands on standard input inject faults:
hang, reset, brownout 0.1, freeze 1, unplug 2, garbage 100, dead 3, alive 3, battery 11.2,
contactor open, fuse blown, kill on, manual on, sticks 0.5 0 0 1, lose, jam 2, loosen 2,
sensor 2 off, show. It runs on after the end of the input, until SIGINT or SIGTERM.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from firmware.simulator.faults import FaultCommands
from firmware.simulator.power import Wiring
from firmware.simulator.real_time import RealTimeSimulation
from firmware.simulator.simulation import FirmwareSimulation


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal arrives; `arguments` as in a shell."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.simulator",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--link", type=Path, help="name for the port that stays over an unplugging")
    parser.add_argument("--protocol", type=int, choices=(1, 2), default=2, help="of the servos")
    parser.add_argument("--no-receiver", action="store_true", help="without a radio control")
    drawn = Wiring()
    parser.add_argument(
        "--supply", choices=("servos", "usb", "both"), default=drawn.supply, help="of the board"
    )
    parser.add_argument("--auto-reset", action="store_true", help="opening the port resets it")
    parser.add_argument("--boot-loader", type=float, default=drawn.boot_loader_s, metavar="SECONDS")
    parser.add_argument(
        "--wheel-pulses", type=int, default=0, metavar="N", help="of the wheel sensors per turn"
    )
    flags = parser.parse_args(arguments)
    wiring = replace(
        drawn,
        supply=flags.supply,
        auto_reset=flags.auto_reset,
        boot_loader_s=flags.boot_loader,
    )
    robot = RealTimeSimulation(
        FirmwareSimulation(
            flags.protocol,
            receiver=not flags.no_receiver,
            wiring=wiring,
            wheel_pulses=flags.wheel_pulses,
        ),
        flags.link,
    )
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        # A handler that raises would be lost in a callback of the firmware.
        signal.signal(number, lambda *_: ended.set())
    print(f"ready: {robot.path}", flush=True)  # noqa: T201
    try:
        _run(robot, FaultCommands(robot), ended)
    finally:
        robot.close()
    return 0


def _run(robot: RealTimeSimulation, faults: FaultCommands, ended: threading.Event) -> None:
    source: int | None = sys.stdin.fileno()
    pending = b""
    while not ended.is_set():
        if not robot.step(source) or source is None:
            continue
        data = os.read(source, 4096)
        if not data:
            source = None
        *lines, pending = (pending + data).split(b"\n")
        for line in lines:
            faults.run(line.decode(errors="replace"))


if __name__ == "__main__":
    sys.exit(main())
