# SPDX-License-Identifier: GPL-3.0-or-later
"""The robot in a box: the real firmware in real time behind a pseudo-terminal.

Start it, then point the bridge at the path that it prints. Commands on standard input do things to
it: hang, reset, freeze 1, unplug 2, garbage 100, dead 3, alive 3, battery 11.2, kill on, manual on,
sticks 0.5 0 0 1, lose, show. The end of the input is no end of it; SIGINT and SIGTERM are.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from firmware.simulator.box import Box
from firmware.simulator.faults import Faults
from firmware.simulator.rig import Rig


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until a signal comes; `arguments` as in a shell."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.simulator",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--link", type=Path, help="name for the port that stays over an unplugging")
    parser.add_argument("--protocol", type=int, choices=(1, 2), default=2, help="of the servos")
    parser.add_argument("--no-receiver", action="store_true", help="without a radio control")
    flags = parser.parse_args(arguments)
    box = Box(Rig(flags.protocol, receiver=not flags.no_receiver), flags.link)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    print(f"ready: {box.path}", flush=True)  # noqa: T201
    try:
        _run(box, Faults(box))
    except KeyboardInterrupt:
        return 0
    finally:
        box.close()


def _run(box: Box, faults: Faults) -> None:
    source: int | None = sys.stdin.fileno()
    pending = b""
    while True:
        if not box.step(source) or source is None:
            continue
        data = os.read(source, 4096)
        if not data:
            source = None
        *lines, pending = (pending + data).split(b"\n")
        for line in lines:
            faults.obey(line.decode(errors="replace"))


if __name__ == "__main__":
    sys.exit(main())
