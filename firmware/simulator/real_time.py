# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated robot in real time behind a pseudo-terminal that acts as its serial port."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import select
import termios
import time
import tty
from pathlib import Path

from firmware.simulator.simulation import FirmwareSimulation

_SLICE_S = 0.0005
"""Maximum delay of bytes to the board."""
_AT_ONCE = 10
"""Maximum time slices simulated before checking the port again."""
_OPENED_S = 1.0
"""After this time without bytes, the next byte counts as opening the port."""
_START_S = 0.01
"""Time until the firmware can receive."""
_BEHIND_S = 0.05
"""Maximum delay that is caught up; after a longer one, simulated time is skipped."""


class RealTimeSimulation:
    """Simulation in real time with its host line at `path`; call `step` continuously."""

    def __init__(self, simulation: FirmwareSimulation, link: Path | None = None) -> None:
        self.simulation = simulation
        self._link = link
        self._ends: tuple[int, int] | None = None
        self._frozen_until_s = 0.0
        self._unplugged_until_s = 0.0
        self._received_s = -math.inf
        self._locked = False
        simulation.run(_START_S)
        self._due_s = time.monotonic()
        self._plug_in()

    @property
    def path(self) -> str:
        """Path that programs must open; changes after unplugging, unless it is a link."""
        return str(self._link) if self._link else os.ttyname(self._need_ends()[1])

    def close(self) -> None:
        """Remove the port and free the simulation."""
        self.unplug(0.0)
        self.simulation.close()

    def unplug(self, seconds: float) -> None:
        """Remove the port for `seconds`."""
        self._unplugged_until_s = time.monotonic() + seconds
        if self._link:
            self._link.unlink(missing_ok=True)
        for end in self._ends or ():
            os.close(end)
        self._ends = None
        self.simulation.set_usb(plugged=False)

    def freeze(self, seconds: float) -> None:
        """Pause the board for `seconds`, including its watchdog and pulses."""
        self._frozen_until_s = time.monotonic() + seconds

    def garbage(self, data: bytes) -> None:
        """Inject bytes into the line to the PC."""
        if self._ends:
            os.write(self._ends[0], data)

    def step(self, also: int | None = None) -> bool:
        """Advance briefly in real time; return whether `also` is readable."""
        now_s = time.monotonic()
        if self._ends is None and now_s >= self._unplugged_until_s:
            self._plug_in()
        if now_s - self._received_s > _OPENED_S:
            self._unlock()
        frozen = now_s < self._frozen_until_s
        if frozen or now_s - self._due_s > _BEHIND_S:
            self._due_s = now_s
        watched = [also] if also is not None else []
        if self._ends and not frozen:
            watched.append(self._ends[0])
        wait_s = max(0.0, self._due_s - now_s) if not frozen else 0.01
        ready, _, _ = select.select(watched, [], [], wait_s)
        if self._ends and self._ends[0] in ready:
            self._forward(self._ends[0])
        if not frozen:
            self._catch_up()
        return also in ready

    def _catch_up(self) -> None:
        # Bounded, so that the port is read even if the computer cannot keep up.
        for _ in range(_AT_ONCE):
            if self._due_s > time.monotonic():
                return
            self._due_s += _SLICE_S
            self.simulation.run(_SLICE_S)
            data = self.simulation.board.receive()
            if data and self._ends:
                # A program that does not read loses bytes, as on a real port.
                with contextlib.suppress(BlockingIOError):
                    os.write(self._ends[0], data)

    def _forward(self, master: int) -> None:
        try:
            data = os.read(master, 4096)
            now_s = time.monotonic()
            # Opening a pty cannot be detected, so the first byte counts as opening.
            if now_s - self._received_s > _OPENED_S:
                self.simulation.open_port()
            self._received_s = now_s
            self._locked = True
            self.simulation.board.send(data)
        except OSError as error:
            if error.errno not in (errno.EIO, errno.EAGAIN):
                raise

    def _unlock(self) -> None:
        """Undo TIOCEXCL of a killed program; the last close would do it on a real port."""
        if not self._ends or not self._locked:
            return
        with contextlib.suppress(BlockingIOError):  # Another program has the port.
            fcntl.flock(self._ends[1], fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(self._ends[1], termios.TIOCNXCL)
            fcntl.flock(self._ends[1], fcntl.LOCK_UN)
            self._locked = False

    def _plug_in(self) -> None:
        # Keep the other end open, because the pty would disappear when a program closes it.
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._ends = (master, slave)
        self.simulation.set_usb(plugged=True)
        if self._link:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(slave))

    def _need_ends(self) -> tuple[int, int]:
        if self._ends is None:
            raise OSError("unplugged")
        return self._ends
